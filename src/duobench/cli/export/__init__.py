"""Write data sets in the formats that policies are trained on."""
