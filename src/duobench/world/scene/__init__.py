"""The scene: data in, `MjSpec` out. Table, two arms with grippers, cameras, and a task's props."""
