"""Read a rig's file; nothing is connected."""
