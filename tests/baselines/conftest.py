"""What the tests of trainings share."""

from __future__ import annotations

from importlib.util import find_spec

import pytest


@pytest.fixture(scope="session", autouse=True)
def observations_are_drawn_once():
    """The 2048 first observations that scale a network take half of a small training; they are drawn once a recipe."""
    if find_spec("stable_baselines3") is None:
        yield
        return
    from kinreach.baselines import _algorithms as algorithms

    draw, drawn = algorithms.first_observations, {}

    def first_observations(environment, options, *, seed):
        key = environment, repr(sorted(options.items())), seed
        if key not in drawn:
            drawn[key] = draw(environment, options, seed=seed)
        return drawn[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(algorithms, "first_observations", first_observations)
        yield
