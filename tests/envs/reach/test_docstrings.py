"""The tables of the environments' docstrings agree with the code."""

import inspect

import numpy as np
import pytest

from kinreach.envs._reach.env import UR5MultiStepEnv, UR5SingleStepEnv


@pytest.mark.parametrize("environment", [UR5SingleStepEnv, UR5MultiStepEnv])
def test_the_docstring_says_what_the_code_does(environment, doc_tables):
    env = environment(backend="kinematic")
    doc = type(env).__doc__
    (actions,), (observations,) = doc_tables(doc, "Action Space"), doc_tables(doc, "Observation Space")
    assert [row[0] for row in actions] == [str(i) for i in range(6)]
    assert [row[0] for row in observations] == [str(i) for i in range(13)]
    for rows, space in ((actions, env.action_space), (observations, env.observation_space)):
        np.testing.assert_allclose([float(row[2]) for row in rows], space.low, atol=1e-6)
        np.testing.assert_allclose([float(row[3]) for row in rows], space.high, atol=1e-6)
    arguments = {row[0].strip("`"): row[1].strip("`") for row in doc_tables(doc, "Arguments")[0]}
    parameters = inspect.signature(type(env)).parameters.values()
    quoted = {p.name: f'"{p.default}"' if isinstance(p.default, str) else repr(p.default) for p in parameters}
    assert arguments == quoted
    for heading in ("Description", "Rewards", "Starting State", "Episode End", "Version History"):
        assert f"## {heading}" in doc
