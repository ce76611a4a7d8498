"""The robot and its workcell as numbers, for simulated and real arms; needs NumPy alone."""
