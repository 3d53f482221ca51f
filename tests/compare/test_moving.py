"""Rolling balls: who looks ahead touches them, and who looks down touches nothing else."""

from collections import Counter
from contextlib import closing

import gymnasium as gym
import numpy as np
import pytest
from matplotlib.text import Text

from kinreach.baselines import rollout
from kinreach.cli import EXIT_ERROR, main
from kinreach.compare import compare, get_task
from kinreach.envs.moving import PATHS, moved, travel_times

METHODS = ["interception", "last-sight", "first-sight", "gradient-moving"]


@pytest.fixture(scope="module", params=[True, False])
def results(request):
    options = {"speeds": (0.05, 0.6), "collisions": request.param}
    entries = compare("moving", METHODS, goals=12, options=options)["methods"]
    return request.param, {entry["name"]: entry for entry in entries}


def test_paths_are_drawn_for_each_method_and_kind_with_what_became_of_the_ball(texts):
    methods = [{"name": name, "colour": "#0072B2"} for name in ("near", "far")]
    trials = [
        {"method": name, "goal_index": index, "speed": 0.4, "path": path, "reached": name == "near"}
        for name in ("near", "far")
        for index, path in enumerate(PATHS)
    ]

    def replay(name, goal):
        turns = np.linspace(0.0, 1.0, 5)
        return [
            {"goal": [0.4, 0.1 * t, 0.0], "q": [t, -1.5, 1.5, -1.5, -1.5, 0.0], "is_success": name == "near",
             "distance": 0.0123} for t in turns
        ]  # fmt: skip

    settings = {"goals": len(PATHS), "seed": 0, "command": "again"}
    figure = get_task("moving").paths(trials, {"methods": methods, "settings": settings}, replay)
    said = texts(figure)
    assert {f"{path}: {verdict}" for path in PATHS for verdict in ("touched", "missed by 12.3 mm")} <= {*said}
    assert min(text.get_fontsize() for text in figure.findobj(Text) if text.get_text()) >= 7
    assert len(figure.axes) == 2 * len(PATHS) == 6


@pytest.mark.slow
def test_who_touches(results):
    collisions, found = results
    for speed in ("0.05", "0.6"):
        assert found["interception"]["touched"][speed] >= 0.8
        assert found["first-sight"]["touched"][speed] < 0.5
    assert found["last-sight"]["touched"]["0.6"] < 0.5
    assert found["last-sight"]["touched"]["0.05"] >= 0.9 - 0.9 * collisions
    assert found["gradient-moving"]["touched"]["0.05"] >= 0.9 - 0.9 * collisions
    assert found["interception"]["touched"]["0.2"] is None
    assert found["interception"]["impossible"] <= 0.2 * collisions
    assert (found["first-sight"]["impossible"] > 0.3) == collisions


@pytest.mark.parametrize("strength", [1.0, 0.9, 0.7])
def test_the_share_of_its_limits_that_the_arm_keeps_is_found(strength):
    """From the second frame on, whatever the methods were told."""
    task, found = get_task("moving"), []
    with closing(gym.make(task.environment, **{**task.options, "strength": strength, "collisions": False})) as env:
        method = task.methods["interception"].make(env)
        for seed in range(5):
            observation, info = env.reset(seed=seed)
            method.reset(observation, info)
            for _ in range(4):
                observation, *_ = env.step(method.act(observation))
            found.append(method._limits["speed"] / env.unwrapped.speed_limit)
    np.testing.assert_allclose(found, strength, rtol=0.0, atol=1e-9)
    assert len(found) == 5


def test_it_checks_no_collisions_where_they_do_not_count(monkeypatch):
    task = get_task("moving")
    with closing(gym.make(task.environment, **{**task.options, "collisions": False})) as env:
        method = task.methods["interception"].make(env)
        monkeypatch.setattr(method, "_checker", None)
        observation, info = env.reset(seed=0, options={"speed": 0.8, "path": "circle"})
        method.reset(observation, info)
        over = False
        while not over:
            observation, _, over, _, info = env.step(method.act(observation))
    assert info["is_success"]


@pytest.mark.slow
def test_it_keeps_a_way_out_if_sights_are_noisy():
    """Of 60 such balls it collided with 21 before, and touched 37."""
    options, ends = {"noise": 0.01, "speeds": (0.4,)}, Counter()
    task = get_task("moving").with_options(options)
    with closing(gym.make(task.environment, **task.options | options)) as env:
        for trial in rollout(env, task.methods["interception"].make(env), task.resets(4, 2, env)):
            ends[trial["reached"], trial["impossible"]] += 1
    assert ends.total() == 4
    assert not ends[False, True]
    assert ends[True, False] >= 3


@pytest.mark.slow
def test_travel_times_are_those_of_the_arm():
    """As the environment moves joints, at a thousandth of a second: no earlier, and hardly later."""
    rng, checked = np.random.default_rng(1), 0
    for _ in range(30):
        q, v, target = rng.uniform(-1, 1, 6), rng.uniform(-3, 3, 6), rng.uniform(-1.5, 1.5, 6)
        said = travel_times(q, v, target[None], speed=3.0, acceleration=10.0)[0]
        there, now, dt = np.full(6, np.nan), 0.0, 1e-3
        while np.isnan(there).any() and now < 5.0:
            q, v = moved(q, v, target, dt, speed=3.0, acceleration=10.0)
            now += dt
            there = np.where(np.isnan(there) & (np.abs(q - target) < 1e-4) & (np.abs(v) < 0.05), now, there)
        np.testing.assert_allclose(there, said, atol=0.03)
        checked += 6
    assert checked == 180


@pytest.mark.slow
def test_on_disk(tmp_path, capsys):
    arguments = ["--task", "moving", "--goals", "3", "--speeds", "0.1,0.3", "--methods", "first-sight,last-sight"]
    assert main(["compare", *arguments, "--out", str(tmp_path)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "rolling ball" in said
    assert "No goal is left for balls at 0.3 m/s: give at least 6." in said
    files = said.split(f"In {tmp_path}: ")[1].split(" No picture")[0].split(", ")
    assert sorted(files) == sorted(path.name for path in tmp_path.iterdir())
    assert (tmp_path / "speeds.png").stat().st_size > 10_000


@pytest.mark.parametrize(("arguments", "said"), [
    (["--speeds", "5"], "the arm's tip is no faster"),
    (["--speeds", "fast"], "--speeds must be numbers with commas between them, such as 0.05,0.1, got 'fast'"),
])  # fmt: skip
def test_bad_input(arguments, said, tmp_path, capsys):
    assert main(["compare", "--task", "moving", *arguments, "--out", str(tmp_path)]) == EXIT_ERROR
    assert said in capsys.readouterr().err


def test_who_plans_for_many_futures_leaves_the_way_to_the_likeliest():
    """Where nothing can be touched it takes a better motion; its observations are those of `interception`."""
    task, others = get_task("moving"), 0
    options = {"collisions": False, "delay": 0.2, "speeds": (0.8,)}
    with closing(gym.make(task.environment, **{**task.options, **options})) as env:
        for seed in range(3):
            planners = [task.methods[name].make(env) for name in ("interception", "scenarios")]
            observation, info = env.reset(seed=seed)
            over = False
            for planner in planners:
                planner.reset(observation, info)
            while not over:
                one, other = (planner.act(observation) for planner in planners)
                others += bool(np.abs(one - other).max() > 1e-6)
                observation, _, terminated, truncated, _ = env.step(one)
                over = terminated or truncated
    assert others > 3
