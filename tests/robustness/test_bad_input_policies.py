"""Policies, logs, comparisons and statistics under fuzz."""

import numpy as np
import pytest
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from benchmarks.logs import trace
from kinreach._statistics import bootstrap_intervals, median, wilson_interval
from kinreach.baselines import _training as training
from kinreach.baselines import evaluate, get_recipe, load_policy, read_curve
from kinreach.baselines._batch import make_batch
from kinreach.baselines.inside import pretrained_names
from kinreach.compare import get_task
from kinreach.compare._runner import _check_numbers, _check_observation
from kinreach.compare.inside import resolve_methods
from kinreach.errors import InputError
from tests.robustness.fuzzing import NUMBERS, bad_arrays, things

NAMES = pretrained_names()
WORDS = ["ur5", "arm3", "button", "lm", "qp,lm", "geometric", "camera", "hybrid", "thesis", "tuned", "a.safetensors"]
PATHS = (
    things() | st.text(max_size=20) | st.sampled_from(["/", "/proc/self/mem", "/dev/zero", ".", "x" * 300, "~", "*"])
)


@pytest.mark.parametrize("name", NAMES)
def test_acting(name, fuzzed):
    policy = load_policy(name)
    env = make_batch(policy.card.environment, 1, policy.card.recipe["options"])
    size, space = len(env.single_observation_space.low), env.single_action_space
    env.close()
    joints = len(policy.network.gain)

    def run(observation):
        action = policy.act(observation)
        shape = np.shape(observation)[:-1]
        assert np.shape(action) == (shape if policy.card.meaning == "preferences" else (*shape, joints))
        for one in np.reshape(action, (-1,) if policy.card.meaning == "preferences" else (-1, joints)):
            assert space.contains(one if policy.card.meaning == "preferences" else one.astype(np.float32))

    good = arrays(np.float64, size, elements=st.floats(-3, 3)) | arrays(
        np.float64, (3, size), elements=st.floats(-3, 3)
    )
    large = arrays(np.float64, size, elements=st.floats(-1e6, 1e6))
    fuzzed(good | large | bad_arrays((size,)) | bad_arrays((2, size)), run)


def test_names_and_paths_of_policies(fuzzed):
    def run(case):
        policy, environment = case
        loaded = load_policy(policy, environment=environment)
        assert loaded.card.environment == environment or environment is None

    paths = PATHS | st.sampled_from(NAMES)
    environments = st.none() | things() | st.sampled_from(["kinreach/UR5SingleStep-v0", "CartPole-v1"])
    fuzzed(st.tuples(paths, environments), run)


def test_arguments_of_a_training(fuzzed, tmp_path, monkeypatch):
    """The training itself is replaced; what it is given is what it can use."""

    def trained(recipe, folder, identity, **_):
        assert folder.is_dir()
        assert identity["recipe"]["steps"] == recipe.steps > 0
        assert 0 <= identity["seed"] < 2**31
        return ()

    monkeypatch.setattr(training, "segments", trained)
    monkeypatch.setattr(training, "_run_in", lambda folder: None)
    monkeypatch.setattr(training.torch, "set_num_threads", lambda count: None)
    recipe = get_recipe("ranked-single")
    odd = NUMBERS | things() | st.integers(-3, 2**40)

    def run(case):
        recipe, folder, seed, steps, threads = case
        training.train(recipe, folder, seed=seed, steps=steps, threads=threads)

    good = [st.just(recipe), st.just(tmp_path / "run"), st.integers(0, 9), st.none(), st.just(1)]
    bad = [things(), st.sampled_from([None, 3, b"", "x" * 300, "/proc/x", "a\0"]), odd, odd, odd]
    fuzzed(st.integers(0, 4).flatmap(lambda k: st.tuples(*good[:k], bad[k], *good[k + 1 :])) | st.tuples(*good), run)
    with pytest.raises(InputError, match="recipe"):
        get_recipe(None)


def test_learning_curves(fuzzed, tmp_path):
    file = tmp_path / "curve.csv"

    def run(content):
        file.write_bytes(content)
        columns = read_curve(file)
        assert len({column.shape for column in columns.values()}) <= 1

    cell = st.sampled_from(["1", "nan", "inf", "", "x", '"', "\0", "1e999", "-", "é", "\r", "9" * 200_000])
    rows = st.lists(st.lists(cell, max_size=4).map(",".join), max_size=4).map("\n".join)
    fuzzed(st.binary(max_size=60) | rows.map(str.encode) | rows.map(lambda text: f"steps,b\n{text}".encode()), run)


def test_settings_of_comparisons(fuzzed):
    def run(case):
        task = get_task(case.get("task", "ur5"))
        _check_numbers(case.get("goals", 1), case.get("seed", 0))
        _check_observation(task, case.get("observation", "geometric"))
        assert all(isinstance(name, str) for name in resolve_methods(task, case.get("methods", ())))

    value = things() | NUMBERS | st.integers(-5, 10**12) | st.sampled_from(WORDS) | st.booleans()
    names = st.lists(st.sampled_from(WORDS), max_size=2) | value | st.lists(things() | st.text(max_size=3), max_size=3)

    @st.composite
    def cases(draw):
        case = {name: draw(value) for name in ("goals", "seed", "observation", "task") if draw(st.integers(0, 3)) == 0}
        if draw(st.booleans()):
            case["methods"] = draw(names)
        return case

    fuzzed(cases(), run)


def test_evaluations_and_traces(fuzzed):
    policy = load_policy("ranked-single")

    def run(case):
        kind, value = case
        options = {"backend": "kinematic"}
        if kind == "trace":
            found = trace(policy, value, options=options)
            assert found.distance.shape == (2, len(value))
            assert np.isfinite(found.distance).all()
        else:
            evaluation = evaluate(policy, **{"goals": 2, "options": options, kind: value})
            assert np.isfinite(evaluation.measures["distance"]).all()

    near = arrays(np.float64, (2, 3), elements=st.floats(-0.6, 0.6))
    traces = st.tuples(st.just("trace"), near | bad_arrays((2, 3)))
    counts = things() | NUMBERS | st.integers(-3, 5)
    fuzzed(traces | st.tuples(st.sampled_from(["goals", "seed"]), counts), run, share=0.4)


def test_statistics(fuzzed):
    def run(case):
        values, successes, total = case
        low, high = bootstrap_intervals(values, (median,), resamples=20)[0]
        assert np.min(np.asarray(values).astype(float)) <= low <= high <= np.max(np.asarray(values).astype(float))
        low, high = wilson_interval(successes, total)
        assert 0 <= low <= successes / total <= high <= 1

    values = arrays(np.float64, st.integers(0, 9), elements=st.floats(-1e300, 1e300)) | bad_arrays((4,))
    counts = st.integers(-3, 20) | NUMBERS | things()
    fuzzed(st.tuples(values, st.integers(0, 9) | counts, st.integers(9, 20) | counts), run)


@pytest.mark.parametrize("methods", ["lm", ["a\nb"], ["\ud800.safetensors"], ["\u202eevil.safetensors"], [b"lm"], 5])
def test_names_that_cannot_be_printed_are_refused(methods):
    if methods == "lm":
        assert list(resolve_methods(get_task("ur5"), methods)) == ["lm"]
        return
    with pytest.raises(InputError, match=r"printable|a method is a name|methods must be a list"):
        resolve_methods(get_task("ur5"), methods)
