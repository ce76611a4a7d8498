"""Parametric objects: one description gives collision geometry, image, printable mesh, mass."""
