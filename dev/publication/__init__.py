"""`make publication`: the folder of what would be published, made from nothing."""
