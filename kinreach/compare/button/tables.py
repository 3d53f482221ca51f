"""Comparisons of episodes as a table for people, and what its numbers mean."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.table import Table
from rich.text import Text

from kinreach.compare.button.episodes import DIVERGED
from kinreach.compare.tables import narrowed, new_table, number, pair, share
from kinreach.envs.button.task import PRESS_RADIUS


def methods_table(results: Mapping[str, Any], *, title: str) -> Table:
    """One row per method, at most `TABLE_WIDTH` characters wide."""
    table = new_table(
        title, "pressed % [95 % CI]", "steps\nmedian / p95", "time s\nmedian", "wrong\npresses\nmean",
        "energy\nN²m²s\nmedian", "decision ms\nmedian / p95", "reward\nmean",
    )  # fmt: skip
    for method in results["methods"]:
        table.add_row(
            Text(method["name"]),
            Text(share(method["pressed"], method["pressed_ci"])),
            f"{method['steps']['median']:.0f} / {method['steps']['p95']:.0f}",
            number(method["move_s"]["median"]),
            number(method["wrong_presses"]["mean"]),
            number(method["energy"]["median"]),
            pair(method["decision_ms"]),
            number(method["reward_mean"]),
        )
    return narrowed(table)


def notes(results: Mapping[str, Any]) -> list[str]:
    """What the table's numbers mean."""
    settings = results["settings"]
    episode = settings["episode"]
    diverged = {m["name"]: m["outcomes"][DIVERGED] for m in results["methods"] if DIVERGED in m["outcomes"]}
    return [
        *(f"The simulation diverged for {name}: {count} episodes." for name, count in diverged.items()),
        f"{settings['goals']} goals, seed {settings['seed']}, at most {episode['max_steps']} steps for all methods, "
        f"actuation {episode['actuation']}.",
        f"A press counts at d < {1e3 * PRESS_RADIUS:g} mm; the 95 % interval of the share pressed is Wilson's.",
        "Steps, wrong presses, energy (sum of torque² dt), reward: of whole episodes, pressed or not.",
        "Time: simulated in MuJoCo, of pressed episodes. Decision: wall time of one, on one thread.",
    ]
