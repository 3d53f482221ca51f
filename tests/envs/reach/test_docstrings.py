"""The tables of the environments' docstrings agree with the code."""

import inspect
import re

import numpy as np
import pytest

from kinreach.envs.reach import UR5MultiStepEnv, UR5SingleStepEnv


def table(docstring, heading):
    section = docstring.split(f"## {heading}")[1].split("\n    ## ")[0]
    rows = re.findall(r"^    \|.*$", section, re.MULTILINE)
    return [[cell.strip() for cell in row.strip().strip("|").split("|")] for row in rows][2:]


@pytest.mark.parametrize("environment", [UR5SingleStepEnv, UR5MultiStepEnv])
def test_the_docstring_says_what_the_code_does(environment):
    env = environment(backend="kinematic")
    doc = type(env).__doc__
    actions, observations = table(doc, "Action Space"), table(doc, "Observation Space")
    assert [row[0] for row in actions] == [str(i) for i in range(6)]
    assert [row[0] for row in observations] == [str(i) for i in range(13)]
    for rows, space in ((actions, env.action_space), (observations, env.observation_space)):
        np.testing.assert_allclose([float(row[2]) for row in rows], space.low, atol=1e-6)
        np.testing.assert_allclose([float(row[3]) for row in rows], space.high, atol=1e-6)
    arguments = {row[0].strip("`"): row[1].strip("`") for row in table(doc, "Arguments")}
    parameters = inspect.signature(type(env)).parameters.values()
    quoted = {p.name: f'"{p.default}"' if isinstance(p.default, str) else repr(p.default) for p in parameters}
    assert arguments == quoted
    for heading in ("Description", "Rewards", "Starting State", "Episode End", "Version History"):
        assert f"## {heading}" in doc
