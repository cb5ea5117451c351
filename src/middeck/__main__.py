"""`python -m middeck` runs the command line."""

from middeck.cli.main import run

if __name__ == "__main__":
    run()
