"""Which trained policies are compared: those of the package, and files; what results say of them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kinreach.baselines.policies import pretrained_names, read_policy, save_policy
from kinreach.compare import Settings, compare
from kinreach.compare.deciding import GIVEN
from kinreach.compare.methods import METHODS, new_method
from kinreach.compare.policies import VARIANTS, PolicyMethod
from kinreach.compare.tasks import UR5Task
from kinreach.errors import InputError

SINGLE, MULTI = VARIANTS
PRETRAINED = {"ppo-single": SINGLE, "ppo-multi": MULTI, "single": SINGLE, "multi": MULTI, "thesis-single": SINGLE}

pytestmark = pytest.mark.usefixtures("no_figures")


def test_results_say_which_policies_and_what_each_kind_is_given(tmp_path: Path, clumsy: Path) -> None:
    file = str(clumsy / "single.safetensors")
    results = compare(Settings(methods=("lm", "ranked-multi", "hybrid", file), goals=1), tmp_path)
    methods = [(method["name"], method["kind"]) for method in results["methods"]]
    assert methods == [
        ("lm", "solver"), ("ranked-multi", "policy"), ("hybrid", "seeded solver"), ("single", "policy")
    ]  # fmt: skip
    digests = {name: text for name, text in results["versions"].items() if name.startswith("policy ")}
    assert list(digests) == ["policy multi", "policy single", f"policy {file}"]
    assert len(set(digests.values())) == 3
    terms = results["settings"]["terms"]
    assert {terms[f"given to a {kind}"] for kind in GIVEN} == set(GIVEN.values())
    assert json.loads((tmp_path / "results.json").read_text())["settings"]["methods"][-1] == file


def test_another_file_under_the_same_name_does_not_go_on(tmp_path: Path, clumsy: Path) -> None:
    file = clumsy / "mine.safetensors"
    settings = Settings(methods=(str(file),), goals=2)

    def interrupt(done: int, total: int) -> None:
        if done == 1:
            raise KeyboardInterrupt

    for source, kept in (("single", 1), ("multi", 0)):
        file.write_bytes((clumsy / "single.safetensors").read_bytes())
        with pytest.raises(KeyboardInterrupt):
            compare(settings, tmp_path / "out", fresh=True, progress=interrupt)
        file.write_bytes((clumsy / f"{source}.safetensors").read_bytes())
        seen: list[int] = []
        compare(settings, tmp_path / "out", progress=lambda done, total, seen=seen: seen.append(done))
        assert seen[0] == kept


def test_files_that_are_no_policies_of_this_task_are_refused(tmp_path: Path, clumsy: Path) -> None:
    (tmp_path / "text.safetensors").write_text("not a policy")
    card, network = read_policy(clumsy / "single.safetensors")
    with pytest.raises(InputError, match=r"text\.safetensors is no policy"):
        compare(Settings(methods=(str(tmp_path / "text.safetensors"),), goals=1), tmp_path / "out")
    wide = replace(network, gain=np.ones(54), shift=np.zeros(54), layers=[(np.zeros((54, 19)), np.zeros(54))])
    wide = replace(wide, mean=np.zeros(19), scale=np.ones(19), waves=np.zeros(0))
    other = replace(card, environment="kinreach/ButtonPress-v0", meaning="preferences")
    save_policy(tmp_path / "button.safetensors", other, wide)
    with pytest.raises(InputError, match=r"is for kinreach/ButtonPress-v0, not for one of: kinreach/UR5SingleStep-v0"):
        compare(Settings(methods=(str(tmp_path / "button.safetensors"),), goals=1), tmp_path / "out")


def test_the_policies_of_the_package_are_for_what_their_methods_say() -> None:
    task = UR5Task()
    assert set(PRETRAINED) <= set(pretrained_names())
    for policy, environment in PRETRAINED.items():
        method = PolicyMethod(task.arm, policy)
        variant = VARIANTS[environment]
        assert (method.moves, method.two_phase) == (variant.max_steps, variant.two_phase)
    assert [name for name in METHODS["ur5"] if new_method(task, name).moves == 100] == ["ppo-multi", "ranked-multi"]


def test_a_comparison_of_policies_loads_no_learning_library(run_python: Any) -> None:
    code = (
        "import sys\n"
        "from kinreach.cli import main\n"
        "code = main(['compare', '--goals', '2', '--out', 'out'])\n"
        "print(code, sorted({'torch', 'stable_baselines3', 'tensorboard'} & set(sys.modules)))"
    )
    done = run_python("-c", code)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "0 []"
    assert all(name in done.stdout for name in METHODS["ur5"])
