"""The robot as bodies of the model: two arms, two grippers, wrist cameras, and their meshes."""
