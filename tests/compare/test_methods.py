"""Methods as users have them: objects, classes, functions, modules, files."""

import importlib
import math
import textwrap
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from kinreach._provenance import digest
from kinreach.baselines import load_policy
from kinreach.baselines.inside import pretrained_names
from kinreach.compare import Method, compare, get_task
from kinreach.compare.inside import resolve_methods
from kinreach.errors import InputError
from kinreach.kinematics import URKinematics
from tests.policy_files import copy_policy


def act(observation):
    return observation + 0.001


class Steady:
    """A policy that is given the environment, and remembers the episode."""

    name = "steady"

    def __init__(self, env):
        self.space = env.action_space

    def reset(self, observation, info):
        self.goal = info["goal"]

    def act(self, observation):
        return self.goal[:1]


class Predicting:
    """What stable-baselines3's models look like."""

    def predict(self, observation, deterministic=False):
        return (observation if deterministic else observation + 1.0), None


class Silent:
    """Finds no action."""

    reason = "nothing found"

    def act(self, observation):
        return None


def test_objects_classes_and_functions_are_methods(toy):
    results = compare(toy, [act, Steady, Predicting(), Silent(), "right"], goals=4)
    names = [entry["name"] for entry in results["methods"]]
    assert names == ["act", "steady", "Predicting", "Silent", "right"]
    assert [entry["reached"] for entry in results["methods"]] == [1.0, 1.0, 1.0, 0.0, 1.0]
    silent = results["methods"][3]
    assert (silent["impossible"], silent["outcomes"]) == (1.0, {"forfeited": 4})
    assert results["methods"][0]["distance_mm"]["median"] == pytest.approx(1.0)


def test_a_mapping_gives_names(toy):
    results = compare(toy, {"mine": act, "theirs": "right"}, goals=2)
    assert [entry["name"] for entry in results["methods"]] == ["mine", "theirs"]


def test_a_module_of_the_working_directory(toy, tmp_path, monkeypatch):
    (tmp_path / "my_methods.py").write_text(
        textwrap.dedent("""
        def exact(observation):
            return observation
        """)
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    results = compare(toy, ["my_methods:exact"], goals=2)
    assert [entry["name"] for entry in results["methods"]] == ["exact"]
    assert any(name.startswith("my_methods:") for name in results["versions"])
    with pytest.raises(InputError, match="cannot import the method my_methods:other"):
        compare(toy, ["my_methods:other"])
    with pytest.raises(InputError, match="cannot import the method no_such_module"):
        compare(toy, ["no_such_module:thing"])


def test_a_class_of_a_module_has_the_name_that_it_has_in_python(toy, tmp_path, monkeypatch):
    (tmp_path / "my_named_methods.py").write_text(
        textwrap.dedent("""
        class Exact:
            name = "the exact one"

            def act(self, observation):
                return observation


        class Nameless(Exact):
            name = property(lambda self: "known later")
        """)
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    exact = importlib.import_module("my_named_methods").Exact
    given = (["my_named_methods:Exact"], [exact], ["my_named_methods:Nameless"])
    names = [method["name"] for methods in given for method in compare(toy, methods, goals=1)["methods"]]
    assert names == ["the exact one", "the exact one", "Nameless"]


def test_colours_are_a_methods_own_or_chosen(toy):
    entries = compare(toy, {"a": Method(lambda env: act, colour="#123456"), "b": act, "c": act}, goals=1)["methods"]
    assert entries[0]["colour"] == "#123456"
    assert len({entry["colour"] for entry in entries}) == 3


@pytest.mark.parametrize("name", ["", "a\nb", "\x1b[2J", "\udcff"])
def test_names_must_be_printable(toy, name):
    with pytest.raises(InputError, match="printable text"):
        compare(toy, {name: act})


def test_files_of_one_name_are_told_apart_by_their_folders(tmp_path):
    content = (files("kinreach.baselines") / "pretrained" / "ranked-single.safetensors").read_bytes()
    runs = [tmp_path / run / name for run in ("one", "two") for name in ("policy.safetensors", "best.safetensors")]
    for path in runs:
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)
    task = get_task("ur5")
    parent = tmp_path.name
    assert list(resolve_methods(task, [str(runs[0])])) == ["policy"]
    named = list(resolve_methods(task, ["lm", *map(str, runs)]))
    assert named == ["lm", f"{parent}/one", "one/best", f"{parent}/two", "two/best"]
    with pytest.raises(InputError, match="named twice"):
        resolve_methods(task, [str(runs[0]), str(runs[0])])


def test_a_policys_file_acts_where_its_card_says(tmp_path):
    task = get_task("ur5")
    for name, environment in zip(("single", "multi"), task.variants, strict=True):
        content = (files("kinreach.baselines") / "pretrained" / f"ranked-{name}.safetensors").read_bytes()
        (tmp_path / f"mine-{name}.safetensors").write_bytes(content)
        (method,) = resolve_methods(task, [str(tmp_path / f"mine-{name}.safetensors")]).values()
        assert method.environment == environment
        assert method.kind == "policy"
        assert len(method.versions) == 1
    with pytest.raises(InputError, match="is for kinreach/UR5SingleStep-v0"):
        resolve_methods(get_task("button"), [str(tmp_path / "mine-single.safetensors")])


def test_shipped_policies_are_methods():
    assert {"ranked-single", "ranked-multi", "ppo-single", "ppo-multi", "thesis-ppo-single", "button"} <= set(
        pretrained_names()
    )


def test_what_cannot_be_made_is_left_out_of_all_but_not_of_some(toy):
    from dataclasses import replace

    from kinreach.errors import InstallationError

    def broken(env):
        raise InstallationError("placo is missing")

    task = replace(toy, methods={**toy.methods, "broken": Method(broken, "solver")})
    results = compare(task, goals=1)
    assert [entry["name"] for entry in results["methods"]] == ["right", "near", "wild"]
    assert results["settings"]["left_out"] == {"broken": "placo is missing"}
    with pytest.raises(InstallationError, match="placo is missing"):
        compare(task, ["broken"], goals=1)


def test_a_policy_of_other_shape_is_refused(toy):
    def wrong(observation):
        return np.zeros(5)

    with pytest.raises(InputError, match="shape"):
        compare("ur5", [wrong], goals=1)


class WithoutAccept:
    def solve(self, goal, seed):
        return None


class Arrays:
    def solve(self, goal, seed, *, accept=None):
        return np.zeros(6)


class Elsewhere:
    def __init__(self):
        self.kin = URKinematics("ur5-thesis")

    def solve(self, goal, seed, *, accept=None):
        raise AssertionError("never asked")


@pytest.mark.parametrize(("solver", "said"), [
    (WithoutAccept(), "must take accept="),
    (Arrays(), "must return an IKResult"),
    (Elsewhere(), "solves for the tip 'tool0' in 'base_link', the task asks for 'tcp' in 'world'"),
])  # fmt: skip
def test_solvers_that_cannot_be_used_say_why(solver, said):
    with pytest.raises(InputError, match=said):
        compare("ur5", [solver], goals=1)


def test_a_task_must_give_as_many_goals_as_asked_for(toy):
    from dataclasses import replace

    for resets in (lambda count, seed, env: [{}], lambda count, seed, env: None):
        with pytest.raises(InputError, match="must return"):
            compare(replace(toy, resets=resets), goals=4)
    with pytest.raises(InputError, match="has no environment"):
        compare(replace(toy, environment="kinreach/Nope-v0"), goals=1)


def test_a_policy_of_another_arm_is_refused(tmp_path):
    recipe = {**load_policy("ranked-single").card.recipe, "options": {"backend": "kinematic", "arm": "ur3-thesis"}}
    copy_policy("ranked-single", tmp_path / "mine.safetensors", recipe=recipe)
    with pytest.raises(InputError, match="was trained on the arm 'ur3-thesis', not on 'ur5-thesis'"):
        compare("ur5", [str(tmp_path / "mine.safetensors")], goals=1)
    (found,) = compare("ur5", [str(tmp_path / "mine.safetensors")], arm="ur3-thesis", goals=1)["methods"]
    assert found["goals"] == 1


def test_two_columns_of_one_key_are_refused(toy):
    with pytest.raises(InputError, match="different keys, got two with 'reached'"):
        replace(toy, columns=(*toy.columns, toy.columns[0]))


def test_the_source_of_a_method_is_its_file_or_nothing_for_one_without(toy):
    own, built_in = resolve_methods(toy, {"own": act, "built-in": math.sin}).values()
    assert own.versions == {f"{__name__}:act": digest(Path(__file__).read_bytes())}
    assert built_in.versions == {"math:sin": digest(b"")}
    assert digest(b"") != digest(Path(__file__).read_bytes())
