"""`python -m kinreach.view`, the same as `kinreach view`."""

from kinreach.cli import run_command

if __name__ == "__main__":
    raise SystemExit(run_command("view", prog="python -m kinreach.view"))
