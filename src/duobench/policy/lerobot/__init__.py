"""Policies of LeRobot: its checkpoints as policies of ours.

Modules that need LeRobot and torch are imported only when such a policy is made.
"""
