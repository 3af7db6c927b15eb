"""How sure the answer is: of space, of objects, of joints, of what hides them, of the camera.

Everything here is a plain statistic of draws that does not depend on how draws are numbered or
on which layout they belong to.
"""
