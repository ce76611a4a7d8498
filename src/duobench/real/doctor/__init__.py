"""Whether a rig is fit for a session: computer, arms, grippers and cameras, each looked at."""
