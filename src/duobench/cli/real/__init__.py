"""Lead, record and evaluate on real arms; not yet tried on an arm."""
