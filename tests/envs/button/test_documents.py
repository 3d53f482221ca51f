"""docs/studies/appendix/button.md shows what its command prints."""

import pytest

from benchmarks.studies.button_actuation import column
from kinreach.envs.inside import ACTUATIONS

MEASURED_ON = 20  # targets; enough to see that the command works
SAME_EVERYWHERE = ("gears [N m]", "time of a step", "joint 1 after one action from rest", "analytic: pressed")


@pytest.mark.parametrize("name", list(ACTUATIONS))
@pytest.mark.slow
def test_the_table_is_that_of_the_benchmark(name, root):
    page = (root / "docs/studies/appendix/button.md").read_text(encoding="utf-8")
    section = page.split("\n## Two sets of actuation\n")[1]
    lines = section.split("\n##")[0].splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("|")]
    head, _, *rows = rows
    assert head[1:] == list(ACTUATIONS)
    written = {row[0]: row[head.index(name)] for row in rows}
    measured = column(ACTUATIONS[name], MEASURED_ON, 0)
    assert list(written) == list(measured)
    for row in SAME_EVERYWHERE:
        assert written[row] == measured[row]
