"""Playing a suite under many shifts."""
