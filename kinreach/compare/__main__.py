"""`python -m kinreach.compare`, the same as `kinreach compare`."""

from kinreach.cli import run_command

if __name__ == "__main__":
    raise SystemExit(run_command("compare", prog="python -m kinreach.compare"))
