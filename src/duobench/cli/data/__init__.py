"""Look at data sets, check them, put them together and take them apart."""
