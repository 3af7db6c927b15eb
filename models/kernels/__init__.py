"""Compiled kernels that the full and the incremental evaluation share.

Some loops that copy the sixteen joints from one array to another run to the width of an array,
which is also sixteen. The compiler would unroll a loop of constant length before it checks whether
the arrays overlap, and then not vectorise it.
"""
