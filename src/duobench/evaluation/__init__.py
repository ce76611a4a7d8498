"""Evaluation: rollouts of a policy on a suite of tasks, their records, and what they add up to.

From the inside out: `rollout` plays an episode, `episode` makes a record of it, `executor` plays
many (here, or in each `worker`), `evaluate` writes them into a `folder`, and `report` adds them up.
"""
