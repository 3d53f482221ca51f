"""`python -m kinreach.evaluate`, the same as `kinreach evaluate`."""

from kinreach.cli import run_command

if __name__ == "__main__":
    raise SystemExit(run_command("evaluate", prog="python -m kinreach.evaluate"))
