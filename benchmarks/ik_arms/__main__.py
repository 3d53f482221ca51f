"""`python -m benchmarks.ik_arms`."""

from kinreach.cli import run

if __name__ == "__main__":
    raise SystemExit(run("benchmarks.ik_arms.cli", prog="python -m benchmarks.ik_arms"))
