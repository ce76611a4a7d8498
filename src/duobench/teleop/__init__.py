"""Teleoperation: a person, or a program in the place of one, leads the arms and is recorded."""
