"""Parts that commands share: messages, tables, progress, advice, and how they end."""
