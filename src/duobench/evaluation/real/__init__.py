"""Recording what policies do on a rig, with an operator beside it."""
