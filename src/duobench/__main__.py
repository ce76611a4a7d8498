"""`python -m duobench` is the command `duobench`."""

from duobench.cli import main

if __name__ == "__main__":
    main()
