"""`python -m graindamp` is the command line."""

from graindamp.cli.main import main

if __name__ == "__main__":
    main()
