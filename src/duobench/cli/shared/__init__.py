"""What verbs share: messages, tables, progress, advice, and how they end."""
