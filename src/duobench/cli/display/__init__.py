"""What the verbs show: messages, tables and the progress of long work."""
