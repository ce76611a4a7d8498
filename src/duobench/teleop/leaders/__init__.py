"""Leader arms: their joints are those of the robot."""
