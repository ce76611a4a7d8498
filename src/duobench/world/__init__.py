"""The simulated world: robot, objects, scene, looks, physics and images; nothing of a task."""
