"""`make -f dev/Makefile release`: build every distribution, check it, and install it where there is no network."""
