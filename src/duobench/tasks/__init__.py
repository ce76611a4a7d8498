"""Tasks: data and a few pure functions, one file each."""
