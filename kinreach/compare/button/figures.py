"""Comparisons of episodes as pictures: how soon the button is pressed, how near, and at what cost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from kinreach.compare.button.summary import decision_ms
from kinreach.compare.strips import by_method, colours_in, draw_strips, origin
from kinreach.compare.tasks.button import EpisodeSettings
from kinreach.compare.trials import EpisodeTrial
from kinreach.envs.button.task import PRESS_RADIUS
from kinreach.plots.style import FAINT, key, label_ends, new_figure


def draw_pressed(trials: Sequence[EpisodeTrial], results: Mapping[str, Any]) -> Figure:
    """Share of goals pressed so far against the steps of the episode, a line per method, in the end with interval."""
    figure, (axes,) = new_figure("Share of goals pressed so far", size=(7.6, 4.4), note=origin(results), grid="both")
    episode = EpisodeSettings(**results["settings"]["episode"])
    most = episode.max_steps
    pressed = by_method(trials, results, lambda t: t.steps if t.reached else None)
    colours = dict(zip(pressed, colours_in(results), strict=True))
    ends = {}
    for rank, method in enumerate(results["methods"]):
        name = method["name"]
        steps = np.sort(pressed[name])
        shares = 100 * np.arange(len(steps) + 1) / method["goals"]
        axes.step([0, *steps, most], [*shares, shares[-1]], where="post", color=colours[name], lw=1.8)
        end = 100 * method["pressed"]
        low, high = 100 * np.array(method["pressed_ci"])
        at = most * (1 + 0.012 * (1 + rank))  # side by side, so that equal methods do not hide each other
        axes.errorbar(at, end, [[end - low], [high - end]], color=colours[name], marker="o", ms=4, elinewidth=1.4)
        ends[name] = (at, end)
    axes.set(
        xlim=(0, most * (1.02 + 0.012 * len(ends))),
        ylim=(-3, 103),
        xlabel=f"steps of the episode, {1e3 * episode.options.actuation.period:g} ms each",
    )
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0f} %"))
    label_ends(axes, ends, colours)
    key(axes, "dot: at the end of the episodes, with its 95 % interval")
    return figure


def draw_episodes(trials: Sequence[EpisodeTrial], results: Mapping[str, Any]) -> Figure:
    """Of every episode: distance at the end, wrong presses, energy, time of a decision."""
    size = (9.6, 2.0 + 1.2 * len(results["methods"]))
    figure, axes = new_figure(
        "How episodes end, and what they take", size=size, rows=2, columns=2, note=origin(results), grid="x"
    )
    end, wrong, energy, decision = axes
    colours = colours_in(results)
    distances = by_method(trials, results, lambda t: 1e3 * t.distance)
    draw_strips(end, distances, colours, "distance at the end of the episode [mm]")
    end.axvline(1e3 * PRESS_RADIUS, color=FAINT, lw=1, ls="--", zorder=0)
    presses = by_method(trials, results, lambda t: t.wrong_presses)
    draw_strips(wrong, presses, colours, "wrong presses in an episode", counts=True)
    draw_strips(energy, by_method(trials, results, lambda t: t.energy), colours, "energy, sum of torque² dt [N²m²s]")
    draw_strips(decision, by_method(trials, results, decision_ms), colours, "wall time per decision, one thread [ms]")
    for right in (wrong, decision):
        right.tick_params(labelleft=False)
    key(end, "dot: one goal · bar: median · dashed: within this a press counts")
    return figure
