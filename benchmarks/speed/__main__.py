"""`python -m benchmarks.speed`, the same as `kinreach bench`."""

from kinreach.cli import run_command

if __name__ == "__main__":
    raise SystemExit(run_command("bench", prog="python -m benchmarks.speed"))
