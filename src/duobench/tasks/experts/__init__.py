"""Scripted experts: one script a task, proof that it can be solved through the action space."""
