"""`python -m benchmarks.paths`."""

from kinreach.cli import run

if __name__ == "__main__":
    raise SystemExit(run("benchmarks.paths.cli", prog="python -m benchmarks.paths"))
