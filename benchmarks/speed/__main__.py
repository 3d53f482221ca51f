"""`python -m benchmarks.speed`."""

from kinreach.cli import run

if __name__ == "__main__":
    raise SystemExit(run("benchmarks.speed.cli", prog="python -m benchmarks.speed"))
