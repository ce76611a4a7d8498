"""What each verb does, a file a verb; those on real arms lie in `duobench.cli.real`."""
