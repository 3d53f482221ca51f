"""The tables of the environment's docstring agree with the code."""

import ast
import inspect

import numpy as np
import pytest

from kinreach.envs._button.button_task import ACTIONS, INCREMENTS, PRESS_RADIUS, ButtonReward
from kinreach.envs._button.env import ButtonPressEnv
from kinreach.envs._button.episodes import ButtonStarts
from kinreach.envs.inside import ACTUATIONS
from kinreach.robots import get_arm


def test_actions(doc_tables):
    rows, _ = doc_tables(ButtonPressEnv.__doc__, "Action Space")
    assert len(rows) >= 10
    for number, *added, press in rows:
        action = int(number)
        assert 0 <= action < ACTIONS
        assert [float(x) for x in added] == INCREMENTS[action % 27].tolist()
        assert press == ("yes" if action >= 27 else "no")


def numbers(cell):
    return [float(x) for x in cell.split(",")]


def test_actuations(doc_tables):
    _, rows = doc_tables(ButtonPressEnv.__doc__, "Action Space")
    assert [ast.literal_eval(row[0].strip("`")) for row in rows] == list(ACTUATIONS)
    for row, actuation in zip(rows, ACTUATIONS.values(), strict=True):
        gears, damping, armature = map(numbers, row[1:4])
        assert (gears, damping) == (list(actuation.gears), list(actuation.damping))
        assert armature == list(actuation.armature)
        assert [float(x) for x in row[4:]] == [actuation.timestep, actuation.frame_skip]


def test_targets(doc_tables):
    (rows,) = doc_tables(ButtonPressEnv.__doc__, "Starting State")
    assert [ast.literal_eval(row[0].strip("`")) for row in rows] == list(ACTUATIONS)
    for row, actuation in zip(rows, ACTUATIONS.values(), strict=True):
        region = actuation.targets or get_arm("arm3").workcell.goals
        assert [numbers(cell.replace(" to ", ",")) for cell in row[1:3]] == [list(region.across), list(region.height)]
        drawn = region.sample(np.random.default_rng(0), 50_000)
        assert 100 * (1 - ButtonStarts().reachable(drawn).mean()) == pytest.approx(float(row[3]), abs=0.15)


def test_observations(doc_tables):
    (rows,) = doc_tables(ButtonPressEnv.__doc__, "Observation Space")
    space = ButtonPressEnv().observation_space
    assert [row[0] for row in rows] == [str(i) for i in range(19)]
    assert [float(row[2]) for row in rows] == space.low.tolist()
    assert [float(row[3]) for row in rows] == space.high.tolist()


def test_rewards(doc_tables):
    (rows,) = doc_tables(ButtonPressEnv.__doc__, "Rewards")
    assert [row[0].strip("`") for row in rows] == ["distance", "near", "wrong_press", "press"]
    near, far = PRESS_RADIUS - 1e-9, PRESS_RADIUS
    for column, actuation in enumerate(ACTUATIONS.values(), start=1):
        distance, press = np.array([near, far, near, far]), np.array([False, False, True, True])
        terms = ButtonReward(actuation).score(distance, np.zeros((4, 3)), press, distance).terms
        for name, *values, when in rows:
            value = values[column - 1]
            paid = terms[name.strip("`")].tolist()
            assert (
                when
                == {
                    (True,) * 4: "always",
                    (True, False, True, False): f"d < {PRESS_RADIUS} m",
                    (False, False, False, True): f"pressed, and d >= {PRESS_RADIUS} m",
                    (False, False, True, False): "the press counts",
                }[tuple(x != 0 for x in paid)]
            )
            assert value == "-d" if when == "always" else set(paid) == {0.0, float(value)}
        assert terms["distance"].tolist() == (-distance).tolist()


def test_arguments_and_sections(doc_tables):
    doc = ButtonPressEnv.__doc__
    (rows,) = doc_tables(doc, "Arguments")
    arguments = {row[0].strip("`"): ast.literal_eval(row[1].strip("`")) for row in rows}
    assert arguments == {p.name: p.default for p in inspect.signature(ButtonPressEnv).parameters.values()}
    for heading in ("Description", "Starting State", "Episode End", "Info", "Version History"):
        assert f"## {heading}" in doc
