"""The tables of the environment's docstring agree with the code."""

import ast
import inspect

import numpy as np

from kinreach.envs._button import ACTUATIONS, ButtonPressEnv
from kinreach.envs._button.task import ACTIONS, INCREMENTS, PRESS_RADIUS, button_reward


def test_actions(doc_tables):
    rows, _ = doc_tables(ButtonPressEnv.__doc__, "Action Space")
    assert len(rows) >= 10
    for number, *added, press in rows:
        action = int(number)
        assert 0 <= action < ACTIONS
        assert [float(x) for x in added] == INCREMENTS[action % 27].tolist()
        assert press == ("yes" if action >= 27 else "no")


def test_actuations(doc_tables):
    _, rows = doc_tables(ButtonPressEnv.__doc__, "Action Space")
    assert [ast.literal_eval(row[0].strip("`")) for row in rows] == list(ACTUATIONS)
    for row, actuation in zip(rows, ACTUATIONS.values(), strict=True):
        gears, damping = ([float(x) for x in cell.split(",")] for cell in row[1:3])
        assert (gears, damping) == (list(actuation.gears), list(actuation.damping))
        assert [float(x) for x in row[3:]] == [actuation.armature, actuation.timestep, actuation.frame_skip]


def test_observations(doc_tables):
    (rows,) = doc_tables(ButtonPressEnv.__doc__, "Observation Space")
    space = ButtonPressEnv().observation_space
    assert [row[0] for row in rows] == [str(i) for i in range(19)]
    assert [float(row[2]) for row in rows] == space.low.tolist()
    assert [float(row[3]) for row in rows] == space.high.tolist()


def test_rewards(doc_tables):
    (rows,) = doc_tables(ButtonPressEnv.__doc__, "Rewards")
    assert len(rows) == 4
    near, far = PRESS_RADIUS - 1e-9, PRESS_RADIUS
    _, terms = button_reward(np.array([near, far, near, far]), np.array([False, False, True, True]))
    expected = {
        "distance": ([-near, -far, -near, -far], "always"),
        "near": ([0.1, 0.0, 0.1, 0.0], f"d < {PRESS_RADIUS} m"),
        "wrong_press": ([0.0, 0.0, 0.0, -1.0], f"pressed at d >= {PRESS_RADIUS} m"),
        "press": ([0.0, 0.0, 100.0, 0.0], f"pressed at d < {PRESS_RADIUS} m"),
    }
    for name, value, when in rows:
        values, condition = expected.pop(name.strip("`"))
        assert terms[name.strip("`")].tolist() == values
        assert when == condition
        assert value == "-d" or float(value) in values


def test_arguments_and_sections(doc_tables):
    doc = ButtonPressEnv.__doc__
    (rows,) = doc_tables(doc, "Arguments")
    arguments = {row[0].strip("`"): ast.literal_eval(row[1].strip("`")) for row in rows}
    assert arguments == {p.name: p.default for p in inspect.signature(ButtonPressEnv).parameters.values()}
    for heading in ("Description", "Starting State", "Episode End", "Info", "Version History"):
        assert f"## {heading}" in doc
