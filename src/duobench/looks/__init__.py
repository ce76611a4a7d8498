"""Looks: how images of a scene look, as values. `sim` renders them."""
