"""Playing in processes of their own: workers with a simulator each, and policies without one."""
