"""The simulation: runs a compiled scene and answers questions about it."""
