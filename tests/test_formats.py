"""What the page of file formats says is what the files have: every column and every key, and no other."""

from __future__ import annotations

import json
import re
from dataclasses import fields, replace
from pathlib import Path

import pytest
from safetensors import safe_open

from benchmarks import speed as bench
from kinreach.baselines import evaluate, load_policy, train
from kinreach.baselines._policy_file import FORMAT, PolicyCard
from tests.baselines.small_runs import small

PAGE = (Path(__file__).parents[1] / "docs" / "reference/files.md").read_text(encoding="utf-8")
SCHEMA = Path(bench.__file__).with_name("results.schema.json")


def tables(heading: str) -> list[set[str]]:
    """Names in the first columns of the tables under a heading, table by table."""
    (section,) = re.findall(rf"^#+ {re.escape(heading)}\n(.*?)(?=^#|\Z)", PAGE, re.MULTILINE | re.DOTALL)
    found = re.findall(r"^\|---.*\n((?:\|.*\n?)+)", section, re.MULTILINE)
    return [
        {name for row in rows.splitlines() for name in re.findall(r"`([^`]+)`", row.split("|")[1])} for rows in found
    ]


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    train(replace(small("ranked-single"), trace_after=100), folder, export=True)
    return folder


def header(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8").partition("\n")[0].split(",")


def test_files_of_a_training(run):
    (said,) = tables("Files of a training")
    written = {path.name + "/" * path.is_dir() for path in run.iterdir()}
    assert written == said
    assert tables("curve.csv") == [set(header(run / "curve.csv"))]
    assert tables("episode.csv") == [set(header(run / "episode.csv"))]
    assert tables("run.json") == [json.loads((run / "run.json").read_text(encoding="utf-8")).keys()]


def test_the_card_and_the_tensors(run):
    card, tensors = tables("policy.safetensors")
    assert card == {"format", *(field.name for field in fields(PolicyCard))}
    assert FORMAT == 1
    with safe_open(run / "policy.safetensors", framework="numpy") as file:
        names = set(file.keys())
    assert {name for name in names if not re.match(r"layer[1-9]", name)} == tensors


@pytest.mark.parametrize("name", ["ranked-single", "button"])
def test_an_evaluation(name):
    (said,) = tables("Files of an evaluation")
    found = {key for key in evaluate(load_policy(name), goals=3).summary() if not key.endswith("_ci")}
    assert found <= said
    assert said - found <= (
        {"wrong_presses", "energy"} if name == "ranked-single" else {"posture_error", "success_at_mm"}
    )


def test_a_benchmark():
    schema = json.loads(SCHEMA.read_text(encoding="utf-8"))
    results, section = tables("Files of a benchmark")
    assert results == schema["properties"].keys()
    assert section == schema["$defs"]["section"]["properties"].keys()
    for part in ("target", "chart"):
        for name in schema["$defs"][part]["properties"]:
            assert f"`{name}`" in PAGE, name
