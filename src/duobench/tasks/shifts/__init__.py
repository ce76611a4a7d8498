"""What differs from the usual episodes, one axis at a time or all together."""
