"""Lenses and places of cameras, measured with a printed board.

Tried with rendered views of the board, and on no camera.
"""
