"""People at a rig: recording, teleoperation, and evaluations on real arms."""
