"""What every method of three tasks decides in its first steps, as it did.

`KINREACH_KEEP=1 pytest tests/compare/test_decisions.py` keeps it as it is now; read the change in git.
"""

import json
import os
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from kinreach.compare import get_task
from kinreach.compare._methods import learned
from kinreach.compare._runner import Environments, resets_of

KEPT = Path(__file__).parents[1] / "data" / "decisions.json"
#: Options with which they are quick, how many steps are compared, and how exactly.
TASKS = {
    "real-arm": ({"budgets": (0, 5), "again": 2, "errors": ("all",)}, 6, 1e-5),
    "moving": ({"speeds": (0.4,), "paths": ("circle",)}, 8, 1e-3),
    "obstacles": ({"clutter": (3,)}, 2, 1e-3),
}


def decided(task, steps):
    """Actions of every method: the numbers of one, mean and spread of many."""
    with ExitStack() as stack:
        environments = Environments(task, stack)
        (reset,) = resets_of(task, 1, 5, environments.default)
        for name, method in task.methods.items():
            env, policy, numbers = environments.of(method), environments.policy(method), []
            observation, info = env.reset(**reset)
            policy.reset(observation, info)
            for _ in range(steps):
                action = np.asarray(policy.act(observation), dtype=float)
                numbers += [*action.mean(axis=0), *action.std(axis=0)] if action.ndim > 1 else action.tolist()
                observation, _, terminated, truncated, _ = env.step(action)
                if terminated or truncated:
                    break
            yield name, numbers


@pytest.mark.parametrize("name", TASKS)
def test_methods_decide_as_they_did(name, monkeypatch):
    monkeypatch.setattr(learned, "ARMS", 300)
    learned._trained.cache_clear()
    options, steps, exactness = TASKS[name]
    found = dict(decided(get_task(name).with_options(options), steps))
    learned._trained.cache_clear()
    assert len(found) >= 6
    kept = json.loads(KEPT.read_text(encoding="utf-8")) if KEPT.exists() else {}
    if os.environ.get("KINREACH_KEEP"):
        kept[name] = {method: [round(number, 6) + 0.0 for number in numbers] for method, numbers in found.items()}
        KEPT.write_text(json.dumps(kept).replace("], ", "],\n") + "\n", encoding="utf-8")
    assert found.keys() == kept[name].keys()
    for method, numbers in found.items():
        np.testing.assert_allclose(numbers, kept[name][method], rtol=0, atol=exactness, err_msg=method)
