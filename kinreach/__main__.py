"""`python -m kinreach COMMAND ...`, the same as the console script `kinreach`."""

from kinreach.cli import main

if __name__ == "__main__":
    raise SystemExit(main(prog="python -m kinreach"))
