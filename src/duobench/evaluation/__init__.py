"""Evaluation: rollouts of a policy on a suite of tasks, their records, and what they add up to."""
