"""`duobench real`: real arms, or the simulated drivers in their place."""
