"""Trials on real arms: a person places the objects, a policy plays, the person judges.

Nothing here was tried on an arm yet. It was tested on simulated drivers.
"""
