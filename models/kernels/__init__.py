"""Compiled kernels that the full and the incremental evaluation share.

Loops over the sixteen joints that carry numbers from one array to another run to the width of
an array, which is sixteen too. A number known in advance would be unrolled into sixteen single
steps, before the compiler asks whether the arrays overlap; so it asks, and takes a row at once.
"""
