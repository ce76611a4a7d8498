"""Playing on a Ray cluster: each process of an evaluation is beside an actor, on any node.

Nothing here is imported unless a cluster was asked for; `ray` is imported nowhere else.
"""
