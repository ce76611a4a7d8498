"""What LeRobot calls things: columns of a data set, and where a training puts its checkpoint."""

STATE, ACTION = "observation.state", "action"
"""Proprioception, and the actions."""
IMAGE_PREFIX = "observation.images."
"""What the name of a camera's images begins with."""
DOMAIN = "domain"
"""Column of an export that says where a row is from; the index of one of `DOMAINS`."""
DOMAINS = ("sim", "real")
"""What the numbers 0 and 1 of that column stand for, for mixed training."""
LAST = "checkpoints/last/pretrained_model"
"""The last checkpoint, in the folder of a training."""
STEP = "checkpoints/last/training_state/training_step.json"
"""How many steps it was trained for."""
EXECUTED = 30
"""Actions that are executed of each chunk [paper]."""
