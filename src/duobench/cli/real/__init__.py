"""Lead, record and evaluate on real arms, or in a rehearsal; not yet tried on an arm."""
