"""Measure lenses and places of cameras with a printed board; not yet tried on a camera."""
