"""Inverse kinematics, for simulated and real arms; MuJoCo and mink are loaded at first use."""
