"""Mistakes that the tests should notice.

`python -m tools.mutants.by_hand` makes those of a list, `python -m tools.mutants.drawn` random changes of the sources.
"""
