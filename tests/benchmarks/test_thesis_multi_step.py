"""Why the thesis's multi-step did not reach: the table of the docs, and the file that it and a notebook come from."""

import json

import numpy as np
import pytest

from benchmarks.logs import FOLDER
from kinreach.baselines import read_curve

pytest.importorskip("stable_baselines3")

from benchmarks.studies.tables import DATA, as_csv
from benchmarks.studies.thesis_multi_step import COLUMNS, VARIANTS, table

FILE = FOLDER / "sb3-multi-long" / "variants.csv"


def rows() -> list[dict[str, float]]:
    columns = read_curve(FILE)
    assert tuple(columns) == COLUMNS
    return [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]


def test_the_published_table_is_that_of_the_file():
    assert as_csv(table(rows())) == (DATA / "what-reaching-pays.csv").read_text(encoding="utf-8")


def test_every_variant_has_the_same_seeds():
    seeds = [
        [row["seed"] for row in rows() if (row["ends"], row["learned"]) == kind]
        for kind in ((1, 1), (0, 1), (1, 0), (0, 0))
    ]
    assert seeds[0] == list(range(len(seeds[0])))
    assert seeds == 4 * [seeds[0]]


def test_variants_differ_from_the_recipe_in_what_the_table_says():
    """Beside the name of the folder; the rate of the learner that has a schedule is the thesis's and does not adapt."""
    base, *others = (json.loads(json.dumps(recipe.to_dict())) for recipe in VARIANTS.values())
    changed = [{key for key in base if other[key] != base[key]} for other in others]
    assert changed == [{"options"}, {"algorithm", "settings"}, {"options", "algorithm", "settings"}]
    for other in others[1:]:
        assert {key for key in other["settings"] if key not in base["settings"]} == {"exploration", "adaptive"}
        assert all(other["settings"][key] == value for key, value in base["settings"].items())
        adaptive = other["settings"]["adaptive"]
        assert {adaptive[key] for key in ("first", "lowest", "highest")} == {base["settings"]["learning_rate"]}


def test_what_the_text_says_of_the_variants():
    found = {kind: [row for row in rows() if (row["ends"], row["learned"]) == kind] for kind in ((1, 1), (1, 0))}
    reached = np.array([row["reached"] for group in found.values() for row in group])
    assert len(reached) >= 2
    assert (reached == 0).all()
