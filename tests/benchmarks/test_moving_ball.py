"""The study of the moving ball: its table, cells that are kept, and its map."""

from contextlib import closing
from importlib import resources

import numpy as np
import pytest

pytest.importorskip("torch")
from benchmarks.studies import moving_ball
from kinreach.compare import get_task

PRETRAINED = resources.files("kinreach.baselines") / "pretrained"


def test_the_table_is_resumed_and_the_map_is_drawn(tmp_path, capsys, monkeypatch):
    arguments = ["--methods", "last-sight", "ppo", "--speeds", "0.2", "--balls", "6", "--out", str(tmp_path)]
    assert moving_ball.main(arguments) == 0
    table = capsys.readouterr().out
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()[2:]]
    assert [row[:2] for row in rows] == [
        [rule, f"`{name}`"] for rule in moving_ball.RULES for name in ("last-sight", "ppo")
    ]
    assert rows[3][2].startswith("100.0")
    assert float(rows[1][2].split()[0]) < 50.0
    monkeypatch.setattr(moving_ball, "rollout", None)  # nothing is played again
    assert moving_ball.main(arguments) == 0
    assert capsys.readouterr().out == table
    monkeypatch.undo()
    monkeypatch.setattr(moving_ball, "WORLDS", {"as trained": {}, "noise 10 mm": {"noise": 0.01}})
    figure = tmp_path / "map.png"
    assert moving_ball.main([*arguments, "--map", "--figure", str(figure)]) == 0
    assert figure.stat().st_size > 10_000


def test_beliefs_are_a_row_for_each_world_and_method(tmp_path, capsys, monkeypatch):
    """A planner that believes a noise has a row where that is wrong; the learned method depends on the rule."""
    monkeypatch.setattr(moving_ball, "BELIEFS", {"as trained": {}, "noise 10 mm": {"noise": 0.01}})
    given = ["--beliefs", "--balls", "1", "--out", str(tmp_path)]
    for rule, speeds, learned in (("ignored", "0.4, 0.8, 1.2", "ppo"), ("count", "0.2, 0.4, 0.6", "ppo-moving-clear")):
        assert moving_ball.main([*given, "--rule", rule]) == 0
        head, _, *rows = capsys.readouterr().out.splitlines()
        cells = [[cell.strip("` ") for cell in row.strip("|").split("|")] for row in (head, *rows)]
        assert cells[0] == ["world", "method", *(f"{speed} m/s" for speed in speeds.split(", "))]
        assert [row[:2] for row in cells[1:]] == [
            ["as trained", "interception"],
            ["as trained", learned],
            ["noise 10 mm", "interception"],
            ["noise 10 mm", moving_ball.WRONG],
            ["noise 10 mm", learned],
        ]


def test_faults_are_a_row_for_each_world_and_method(tmp_path, capsys):
    given = ["--faults", "--methods", "last-sight", "--speeds", "0.4", "--balls", "1", "--out", str(tmp_path)]
    assert moving_ball.main(given) == 0
    rows = [row.strip("|").split("|")[0].strip() for row in capsys.readouterr().out.splitlines()[2:]]
    assert rows == list(moving_ball.FAULTS)


def test_base_joints_alone_are_weaker():
    """The first three go as far in a frame as half of the limit of acceleration leads."""
    moved = []
    for options in ({}, {"base_strength": 0.5}):
        with closing(moving_ball.make_world(options)) as env:
            _, info = env.reset(seed=0)
            *_, after = env.step((info["q"] + 1.0) / np.pi)
            moved.append(after["q"] - info["q"])
    np.testing.assert_allclose(moved[1] / moved[0], [0.5, 0.5, 0.5, 1.0, 1.0, 1.0], rtol=1e-6)


def test_a_planner_is_told_the_true_noise_or_a_wrong_one(tmp_path, monkeypatch):
    told = []

    def acting(env, *, noise):
        told.append(noise * 1.5382)
        return get_task("moving").methods["first-sight"].make(env)

    monkeypatch.setattr(moving_ball, "Interception", acting)
    for name in (moving_ball.TOLD, moving_ball.WRONG):
        moving_ball.touched(name, 0.4, {"noise": 0.003}, balls=1, seed=0, out=tmp_path)
    np.testing.assert_allclose(told, [0.003, 0.00014], rtol=1e-4)


def test_the_delay_that_is_believed_is_observed():
    given = {"delay": 0.065, "believed_delay": 0.05}
    with closing(moving_ball.make_world(given)) as env, closing(moving_ball.make_world({"delay": 0.065})) as true:
        ages = []
        for world in (env, true):
            world.reset(seed=0)
            *_, (observation, *_) = (world.step(world.unwrapped.home / np.pi) for _ in range(4))
            ages.append(observation[3])
    assert ages[0] == pytest.approx(ages[1] / 1.3)


@pytest.mark.parametrize("share", [0.7, 1.0, 1.3])
def test_how_late_the_sights_are_is_found(share):
    """By `interception`, from when the ball begins to move in them; a delay that is believed rightly stays as it is."""
    found = []
    with closing(moving_ball.make_world({"delay": 0.05 * share, "believed_delay": 0.05})) as env:
        method = get_task("moving").methods["interception"].make(env)
        for seed, path in enumerate(("straight", "circle", "random")):
            observation, info = env.reset(seed=seed, options={"speed": 0.8, "path": path})
            method.reset(observation, info)
            for _ in range(10):
                method.act(observation)
                observation, *_ = env.step(env.unwrapped.home / np.pi)
            found.append(method._fit.age)
    if share == 1.0:
        np.testing.assert_allclose(found, 0.05, rtol=1e-12)
    else:
        np.testing.assert_allclose(found, 0.05 * share, atol=0.003)


@pytest.mark.parametrize("late", [0, 1, 3])
def test_how_late_the_arm_is_is_found(late):
    """By `interception`, once an action that differs from the first posture was done."""
    found = []
    with closing(moving_ball.make_world({"late": late, "strength": 0.8, "collisions": False})) as env:
        method = get_task("moving").methods["interception"].make(env)
        for seed in range(3):
            observation, info = env.reset(seed=seed)
            method.reset(observation, info)
            for _ in range(late + 4):
                q = observation[4:10]
                observation, *_ = env.step(method.act(observation))
            found.append((method._late, round(method._limits["speed"] / env.unwrapped.speed_limit, 6)))
    assert np.abs(observation[4:10] - q).max() > 1e-3
    assert found == 3 * [(late, 0.8)]


def test_an_arm_that_follows_is_behind():
    """After a frame by what is left of the way, after many by nothing."""
    env = moving_ball.make_world({"following": 0.05, "collisions": False})
    with closing(env):
        env.reset(seed=0)
        wanted = env.unwrapped.home / np.pi + 0.001
        env.step(wanted)
        assert env._doing[0] - wanted[0] == pytest.approx(-0.001 * np.exp(-1 / 1.5))
        for _ in range(40):
            observation, *_ = env.step(wanted)
        np.testing.assert_allclose(observation[4:10], np.pi * wanted, atol=1e-6)


def test_one_kind_of_path_alone(tmp_path, capsys):
    """The first sight is on the way of a ball on a circle again, and not of a straight one."""
    shares = {}
    for path in ("circle", "straight"):
        given = ["--methods", "first-sight", "--speeds", "0.6", "--balls", "2", "--out", str(tmp_path)]
        assert moving_ball.main([*given, "--paths", path]) == 0
        shares[path] = float(capsys.readouterr().out.splitlines()[-1].split("|")[3].split()[0])
    assert shares == {"circle": 100.0, "straight": 0.0}


def test_how_long_decisions_take(capsys):
    """Each decision is counted, and the 95th percentile lies between the median and the longest."""
    assert moving_ball.main(["--times", "--methods", "last-sight", "--balls", "2"]) == 0
    name, decisions, *spent = (cell.strip() for cell in capsys.readouterr().out.splitlines()[2].strip("|").split("|"))
    middle, high, longest = map(float, spent)
    assert name == "`last-sight`"
    assert int(decisions) > 6
    assert 0.0 < middle <= high <= longest


def test_what_policies_collide_with(capsys):
    """A policy that learned without collisions puts its fingers into the table, tilted, near the ball."""
    assert moving_ball.main(["--causes", "ppo-moving", "--balls", "12", "--seed", "3"]) == 0
    (row,) = (
        [cell.strip() for cell in line.strip("|").split("|")] for line in capsys.readouterr().out.splitlines()[2:]
    )
    collided, causes, time, away, tilt, depth = row[2:]
    assert row[0] == "`ppo-moving`"
    assert float(collided.split()[0]) > 80.0
    hits = {cause: int(count) for cause, _, count in (part.rpartition(": ") for part in causes.split(", "))}
    assert sum(hits.values()) == round(0.12 * float(collided.split()[0]))
    assert max(hits, key=hits.__getitem__) in ("finger_right - table", "finger_left - table")
    assert 0.0 < float(time) < 3.0
    assert 5.0 < float(tilt) < 60.0
    assert float(away) < 100.0
    assert 0.0 < float(depth) < 60.0


@pytest.fixture
def trainings(tmp_path):
    """Two policies as the seeds of a recipe."""
    for seed, name in enumerate(("gradient-moving", "ppo-moving")):
        (folder := tmp_path / f"seed-{seed}").mkdir()
        (folder / "policy.safetensors").write_bytes((PRETRAINED / f"{name}.safetensors").read_bytes())
    return tmp_path


def test_the_map_of_all_seeds(trainings, capsys, monkeypatch):
    """The last method's cells are means over the trainings, and their interval holds them both."""
    monkeypatch.setattr(moving_ball, "WORLDS", {"as trained": {}})
    figure, shown = trainings / "map.png", ["--methods", "last-sight", "ppo", "--speeds", "0.4", "--balls", "12"]
    given = [*shown, "--out", str(trainings / "cells"), "--map", "--figure", str(figure)]
    assert moving_ball.main([*given, "--trainings", str(trainings)]) == 0
    _, _, _, row = capsys.readouterr().out.splitlines()
    world, name, cell = (cell.strip() for cell in row.strip("|").split("|"))
    assert (world, name) == ("as trained", "`ppo`")
    middle, low, high = (float(part.strip("[,]")) for part in cell.split())
    assert 30.0 < middle < 75.0  # 13 and 92 of the 60 balls of the table
    assert low < 20.0
    assert high > 80.0
    assert figure.stat().st_size > 10_000


def test_every_seed_of_a_recipe_at_every_speed(trainings, capsys):
    """Slow balls are touched, where collisions are ignored."""
    assert moving_ball.main(["--trainings", str(trainings), "--balls", "12", "--speeds", "0.1", "0.6"]) == 0
    head, _, counted, ignored = (
        [cell.strip() for cell in line.strip("|").split("|")] for line in capsys.readouterr().out.splitlines()
    )
    assert head == ["collisions", "0.1 m/s", "0.6 m/s"]
    assert (counted[0], ignored[0]) == ("count", "ignored")
    assert float(counted[1].split()[0]) < 50.0 < 90.0 < float(ignored[1].split()[0])
    assert float(ignored[2].split()[0]) < 60.0
