"""Parametric objects: one description gives collision geometry, picture, printable mesh, mass."""
