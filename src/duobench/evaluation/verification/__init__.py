"""How one record is verified: its targets are played again, and its claims compared."""
