"""From thirty targets a second to smooth motion: bounded references, and ways that are free."""
