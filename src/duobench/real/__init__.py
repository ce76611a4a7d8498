"""Two real arms with grippers and cameras, behind the interface of the simulated ones.

Nothing here was tried on an arm yet. It was tested against simulators of the robot's interface.
"""
