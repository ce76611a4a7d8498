"""`duobench real`: real arms, or a rehearsal in their place."""
