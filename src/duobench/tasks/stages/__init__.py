"""Task stages: pure questions about a moment, and the rule that turns them into progress."""
