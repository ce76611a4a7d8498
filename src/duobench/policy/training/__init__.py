"""Training of policies: the command of LeRobot's trainer, and the settings of each kind."""
