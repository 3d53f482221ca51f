"""`python -m kinreach.demo`, the same as `kinreach demo`."""

from kinreach.cli import run_command

if __name__ == "__main__":
    raise SystemExit(run_command("demo", prog="python -m kinreach.demo"))
