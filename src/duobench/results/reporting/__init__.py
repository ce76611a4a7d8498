"""What the report of a run says beyond numbers: what was run, how it failed, how long it took."""
