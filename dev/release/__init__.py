"""`make -f dev/Makefile release`: build the distributions, check and install them."""
