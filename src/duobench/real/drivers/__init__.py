"""One module a device: how it is asked and told; libraries are imported at its first use."""
