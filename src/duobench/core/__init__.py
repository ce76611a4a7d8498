"""Words and helpers that every wing shares: types, errors, files, randomness."""
