"""Searches: what a file may say, what a trial is, and one that Tune runs."""

import csv
import json
import sys
from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace

import pytest

from kinreach.baselines import _search
from kinreach.baselines import _train_cli as train_cli
from kinreach.baselines._evaluation import VALIDATION
from kinreach.baselines._recipes import get_recipe
from kinreach.baselines._search import JUDGES, Search, read_search, search, trial
from kinreach.cli import main
from kinreach.errors import InputError, KinreachError
from tests.ray_cluster import private_folder

SAID = """
recipe: ppo-single
ranges:
  settings.learning_rate: {loguniform: [1.0e-4, 1.0e-2]}
  networks.hidden: {choice: [[32, 32], [64, 64]]}
  num_envs: {randint: [8, 16]}
trials: 3
steps: 400
goals: 20
judge: return
"""


@pytest.fixture
def file(tmp_path):
    def write(text):
        path = tmp_path / "mine.yaml"
        path.write_text(text)
        return path

    return write


def test_a_file_is_a_search(file):
    found = read_search(file(SAID))
    assert (found.recipe, found.trials, found.steps, found.goals, found.judge) == ("ppo-single", 3, 400, 20, "return")
    recipe = found.tried({"settings.learning_rate": 0.5, "networks.hidden": [8, 9], "num_envs": 4})
    assert (recipe.settings["learning_rate"], recipe.networks.hidden, recipe.num_envs) == (0.5, (8, 9), 4)
    assert recipe.settings["gamma"] == get_recipe("ppo-single").settings["gamma"]
    assert recipe.steps == 400


def test_the_searches_of_the_docs_can_be_read(root):
    found = {path.stem: read_search(path) for path in (root / "benchmarks/studies/searches").glob("*.yaml")}
    assert all(given.tried({}).name == name for name, given in found.items())
    assert {name: given.recipe for name, given in found.items()} == {
        "td3-single": "benchmarks.learners:td3_single", "td3-multi": "benchmarks.learners:td3_multi",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "is not YAML"),
        ("[]", "must have at least recipe and ranges"),
        ("recipe: ppo-single", "must have at least recipe and ranges"),
        (SAID.replace("ppo-single", "nobody"), "unknown recipe 'nobody'"),
        (SAID + "colour: red", "unknown entry of .* 'colour'"),
        (SAID.replace("trials: 3", "trials: 0"), "trials must be"),
        (SAID.replace("judge: return", "judge: taste"), "unknown judge 'taste'; available: distance_mm, reached"),
        (SAID + "searcher: magic", "unknown searcher 'magic'"),
        (SAID + "scheduler: magic", "unknown scheduler 'magic'"),
        (SAID.replace("1.0e-4", "1e-4"), "1e-4 is a text and 1.0e-4 a number"),
        (SAID.replace("1.0e-4", "-1"), "the lower one first"),
        (SAID.replace("[8, 16]", "[16, 8]"), "the lower one first"),
        (SAID.replace("loguniform", "normal"), "unknown range of settings.learning_rate 'normal'"),
        (SAID.replace("num_envs", "name"), "unknown field of a recipe 'name'"),
        (SAID.replace("networks.hidden", "networks.depth"), "unknown field of networks 'depth'"),
        (SAID.replace("num_envs", "settings"), "an entry of networks, settings, options"),
        ("recipe: ppo-single\nranges: {}", "ranges are a range"),
        ("ranges: " + "[" * 1000, "is not YAML"),
    ],
)  # fmt: skip
def test_what_a_file_cannot_say(text, message, file):
    with pytest.raises(KinreachError, match=message):
        read_search(file(text))


@pytest.mark.slow
def test_a_trial_is_judged_after_every_segment():
    given = Search("ppo-single", {"num_envs": {"choice": [8]}}, steps=400, goals=10)
    found = list(trial(given, {"num_envs": 8}))
    assert len(found) >= 2
    steps = [done for done, _ in found]
    assert steps == sorted(set(steps))
    assert steps[-1] >= 400
    assert all(set(scores) == set(JUDGES) for _, scores in found)


def test_one_of_the_two(capsys):
    for arguments in ([], ["ranked-single", "--search", "x.yaml"]):
        assert main(["train", *arguments]) == 2
        assert "give a RECIPE, or a --search" in capsys.readouterr().err


@pytest.fixture
def own_ray_folder(monkeypatch):
    with private_folder() as folder:
        for name, value in folder.items():
            monkeypatch.setenv(name, value)
        yield


@pytest.mark.slow
def test_tune_runs_a_search_and_keeps_it(file, tmp_path, run_python, own_ray_folder):
    command = ("-m", "kinreach.train", "--search", str(file(SAID)), "--out", str(tmp_path / "out"))
    done = run_python(*command)
    assert done.returncode == 0, done.stderr
    folder = tmp_path / "out" / "search-mine"
    results = json.loads((folder / "results.json").read_text())
    with (folder / "results.csv").open() as csv_file:
        rows = list(csv.DictReader(csv_file))
    assert len(rows) == len(results["trials"]) == 3
    returns = [trial["return"] for trial in results["trials"]]
    assert returns == sorted(returns, reverse=True)
    assert results["best"]["settings"]["learning_rate"] == results["trials"][0]["settings.learning_rate"]
    assert {trial["status"] for trial in results["trials"]} <= {"finished", "ended early"}
    again = run_python(*command, "--resume")  # all trials are there
    assert again.returncode == 0, again.stderr
    assert json.loads((folder / "results.json").read_text())["trials"] == results["trials"]


class Tune(SimpleNamespace):
    """Stands in for Ray Tune: notes what it is asked for, and runs the trials that it is given."""

    def __init__(self, trials, restores=False):
        super().__init__(asked={}, reports=[], trials=trials)
        self.Tuner = type("Tuner", (), {
            "__init__": lambda tuner, run, **options: self.asked.update(run=run, **options),
            "can_restore": staticmethod(lambda path: restores),
            "restore": staticmethod(lambda path, run, **more: self.asked.update(run=run, path=path, **more) or self),
            "fit": self.fit,
        })  # fmt: skip
        self.TuneConfig = self.RunConfig = self.FailureConfig = dict
        self.choice = self.randint = self.loguniform = lambda *values: values

    def with_resources(self, run, resources):
        self.asked["resources"] = resources
        return run

    def report(self, values):
        self.reports.append(values)

    def fit(self, tuner=None):
        found = []
        for config, error in self.trials:
            if not error:
                self.asked["run"](config)
            found.append(SimpleNamespace(config=config, error=error, metrics=None if error else self.reports[-1]))
        return found


TRIED = {"settings.learning_rate": 1e-3, "networks.hidden": [32, 32], "num_envs": 8}


def with_tune(monkeypatch, tune):
    options = {"loaded": []}

    def load(name, extra):
        options["loaded"].append(name)
        if name == "ray.tune":
            return tune
        kind = {"basic_variant": "BasicVariantGenerator", "optuna": "OptunaSearch", "schedulers": "ASHAScheduler"}
        kind = kind.get(name.rpartition(".")[2], name)
        return SimpleNamespace(**{kind: lambda **given: options.setdefault(kind, given) and kind})

    def trial(given, values, threads):
        yield 130, {"return": -1.0, "reached": 0.0}
        yield given.tried(values).steps, {"return": 1e3 * values["settings.learning_rate"] * threads}

    monkeypatch.setattr(_search, "load_extra", load)
    monkeypatch.setattr(_search, "trial", trial)
    return options


@pytest.mark.parametrize("searcher", ["random", "optuna"])
def test_what_tune_is_asked_for(searcher, file, tmp_path, monkeypatch):
    given = replace(read_search(file(SAID)), searcher=searcher)
    tune = Tune([({**TRIED, "settings.learning_rate": rate}, None) for rate in (1e-4, 1e-2)] + [(TRIED, "it broke")])
    options = with_tune(monkeypatch, tune)
    results = search(given, tmp_path, threads=2)
    asked = tune.asked
    assert asked["resources"] == {"cpu": 2}
    assert tune.reports[0] == {"steps": 130, "return": -1.0, "reached": 0.0}
    assert asked["param_space"] == {
        "settings.learning_rate": (1e-4, 1e-2), "networks.hidden": ([[32, 32], [64, 64]],), "num_envs": (8, 16),
    }  # fmt: skip
    kinds = {"random": ("BasicVariantGenerator", "random_state"), "optuna": ("OptunaSearch", "seed")}
    kind, seed = kinds[searcher]
    assert asked["tune_config"] == {
        "metric": "return", "mode": "max", "num_samples": 3, "search_alg": kind, "scheduler": "ASHAScheduler",
    }  # fmt: skip
    assert ("optuna" in options.pop("loaded")) == (searcher == "optuna")
    assert options == {
        kind: {seed: 0},
        "ASHAScheduler": {"time_attr": "steps", "max_t": 400, "grace_period": 44, "reduction_factor": 3},
    }
    assert asked["run_config"] == {
        "name": "tune", "storage_path": str(tmp_path), "verbose": 0, "failure_config": {"max_failures": 0},
    }  # fmt: skip
    rows = results["trials"]
    assert [row["status"] for row in rows] == ["finished", "finished", "failed"]
    assert [row["return"] for row in rows] == [20.0, 0.2, None]
    assert [row["steps"] for row in rows] == [400, 400, None]
    assert results["best"]["settings"]["learning_rate"] == rows[0]["settings.learning_rate"]
    assert {"torch", "stable-baselines3", "ray", "optuna", "kinreach"} <= set(results["versions"])
    assert (tmp_path / "results.json").read_text() == json.dumps(results, indent=2) + "\n"
    with (tmp_path / "results.csv").open() as csv_file:
        assert [row["num_envs"] for row in csv.DictReader(csv_file)] == ["8"] * 3


def test_a_search_goes_on_or_says_why_it_found_nothing(file, tmp_path, monkeypatch):
    given = replace(read_search(file(SAID)), scheduler="none")
    tune = Tune([(TRIED, None)], restores=True)
    with_tune(monkeypatch, tune)
    assert len(search(given, tmp_path, resume=True)["trials"]) == 1
    assert tune.asked["path"] == str(tmp_path / "tune")
    assert (tune.asked["resume_unfinished"], tune.asked["restart_errored"]) == (True, True)
    tune = Tune([(TRIED, "Traceback\nValueError: it broke")], restores=True)
    assert with_tune(monkeypatch, tune) == {"loaded": []}
    with pytest.raises(InputError, match=r"came to anything: ValueError: it broke$"):
        search(given, tmp_path)
    assert tune.asked["tune_config"]["scheduler"] is None


def test_a_trial_is_trained_anew_and_judged_on_validation_goals(monkeypatch):
    asked = []

    def segments(recipe, folder, identity, *, resume):
        asked.append((recipe.num_envs, recipe.steps, folder.is_dir(), identity["seed"], identity["threads"], resume))
        for steps in (200, 400):
            yield SimpleNamespace(card=SimpleNamespace(steps=steps))

    def judged(policy, *, goals, seed, options):
        asked.append((goals, seed, options))
        return SimpleNamespace(summary=lambda: {"reached": 0.5, "return": {"mean": -1.0}})

    monkeypatch.setattr(_search, "segments", segments)
    monkeypatch.setattr(_search, "evaluate", judged)
    given = Search("ppo-multi", {"num_envs": {"choice": [8]}}, steps=400, goals=10, seed=3)
    scores = {"reached": 0.5, "return": -1.0}
    assert list(trial(given, {"num_envs": 8}, 2)) == [(200, scores), (400, scores)]
    judging = (10, VALIDATION, {"backend": "kinematic"})
    assert asked == [(8, 400, True, 3, 2, False), judging, judging]


def test_the_command_shows_the_best_trials(file, tmp_path, monkeypatch, capsys):
    rows = [
        {**TRIED, "steps": 400, "reached": 0.123456, "distance_mm": None, "return": -1.0, "status": "finished"}
    ] * 12
    asked = []

    def found(given, out, **options):
        asked.append((given.recipe, out, options))
        return {"trials": rows}

    @contextmanager
    def engine(*given):
        asked.append(given)
        yield

    monkeypatch.setattr(_search, "search", found)
    monkeypatch.setattr(train_cli, "open_engine", engine)
    command = ["train", "--search", str(file(SAID)), "--out", str(tmp_path), "--threads", "2", "--address", "auto"]
    assert main([*command, "--resume"]) == 0
    out = tmp_path / "search-mine"
    assert asked == [("ray", "auto"), ("ppo-single", out, {"resume": True, "threads": 2})]
    said = capsys.readouterr().out
    assert said.count("0.1235") == 10
    for words in (
        "ppo-single, 20 validation goals",
        "settings.learning_rate",
        "[32, 32]",
        "finished",
        "None",
        str(out),
    ):
        assert words in said
    monkeypatch.setitem(sys.modules, "kinreach.baselines._search", None)
    assert main(command) == 2
    assert "pip install 'kinreach[train]'" in capsys.readouterr().err
