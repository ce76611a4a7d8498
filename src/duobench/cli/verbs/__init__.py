"""What verbs do, by what they are about; those that move real arms are in `cli.real`."""
