"""From episodes to the numbers of `results.json`, each with its 95 % confidence interval."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from kinreach.compare.summary import MEDIAN_P95, spread, what_all_tasks_say
from kinreach.compare.trials import EpisodeTrial
from kinreach.statistics import mean

#: Sums over an episode that are often zero: the mean says more than the median.
_WITH_MEAN = {**MEDIAN_P95, "mean": mean}


def summarise(name: str, kind: str, trials: Sequence[EpisodeTrial]) -> dict[str, Any]:
    """One entry of `methods` in `results.json` for episodes of the button task.

    Beyond `what_all_tasks_say`, where completed means pressed: steps, wrong presses, energy and times of decisions are
    over all episodes, an unpressed one counts as long as it lasted.

    Args:
        name: Of the method.
        kind: Of the method.
        trials: Its episodes, at least one.
    """
    common = what_all_tasks_say(name, kind, trials)
    return {
        **common,
        "pressed": common["reached"],
        "pressed_ci": common["reached_ci"],
        **spread("steps", trials, lambda t: t.steps, _WITH_MEAN),
        **spread("wrong_presses", trials, lambda t: t.wrong_presses, _WITH_MEAN),
        **spread("energy", trials, lambda t: t.energy, _WITH_MEAN),
        **spread("decision_ms", trials, decision_ms),
    }


def decision_ms(trial: EpisodeTrial) -> float | None:
    """Wall time of a decision, mean over the episode [ms]."""
    return None if trial.solve_s is None else 1e3 * trial.solve_s / trial.steps
