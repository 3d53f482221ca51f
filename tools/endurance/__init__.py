"""Checks that take too long for every change: faults, long runs, many processes. `python -m tools.endurance` runs all.

The tests in `tests/robustness` call the same functions with small numbers.
"""
