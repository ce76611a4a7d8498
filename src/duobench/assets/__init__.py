"""The mesh store: a manifest of mesh files, where to find them, and light copies for use.

`meshes` is the door: it hands out decimated pictures and small convex hulls by logical name.
"""
