"""What real arms record beside their rows: videos of their cameras, and their full state."""
