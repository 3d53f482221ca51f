"""`python -m kinreach.train`, the same as `kinreach train`."""

from kinreach.cli import run_command

if __name__ == "__main__":
    raise SystemExit(run_command("train", prog="python -m kinreach.train"))
