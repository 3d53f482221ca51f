"""Comparisons of postures as tables for people, and what their numbers mean."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich.table import Table
from rich.text import Text

from kinreach.compare.budget import Budget
from kinreach.compare.observation import CameraSettings
from kinreach.compare.tables import narrowed, new_table, number, pair, share
from kinreach.compare.trials import COMPLETED


def methods_table(results: Mapping[str, Any], *, title: str) -> Table:
    """One row per method, at most `TABLE_WIDTH` characters wide; a column more where the cameras looked."""
    looked = results["settings"].get("camera") is not None
    table = new_table(
        title, "reached % [95 % CI]", *(["seen\nmm"] if looked else []), "distance mm\nmedian / p95", "< 1 mm\n%",
        "impos-\nsible %", "reward\nmean", "solve ms\nmedian / p95", "move s\nmedian",
    )  # fmt: skip
    for method in results["methods"]:
        table.add_row(
            Text(method["name"]),
            Text(share(method["reached"], method["reached_ci"])),
            *([number(method["observed_error_mm"]["median"])] if looked else []),
            pair(method["distance_mm"]),
            f"{100 * method['success_at_mm']['1']:.1f}",
            f"{100 * method['impossible']:.1f}",
            number(method["reward_mean"]),
            pair(method["solve_ms"]),
            number(method["move_s"]["median"]),
        )
    return narrowed(table)


def budget_table(results: Mapping[str, Any]) -> Table:
    """What each method's mean distance consists of, and what its decisions took; as wide as `methods_table` at most."""
    table = new_table(
        "Where the distance comes from", "seeing\nmm", "+ deciding\nmm", "+ moving\nmm", "= distance\nmean mm",
        "iterations\nmedian / p95", "restarts\nmedian / p95",
    )  # fmt: skip
    for method in results["methods"]:
        parts = (number(method["budget_mm"][name]) for name in (*Budget._fields, "distance"))
        table.add_row(Text(method["name"]), *parts, _counts(method["iterations"]), _counts(method["restarts"]))
    return table


def notes(results: Mapping[str, Any]) -> list[str]:
    """What the tables' numbers mean."""
    settings = results["settings"]
    reached = settings["terms"]["reached"]
    return [
        *_impossible(results["methods"]),
        f"{settings['goals']} goals, seed {settings['seed']}. Reached: {reached}; its 95 % interval is Wilson's.",
        *_seen(results),
        "Distance, move: simulated in MuJoCo. Solve: wall time on one thread, acceptance tests included.",
        "Iterations: a solver's steps, a policy's decisions. Seeing, deciding and moving sum to the distance:",
        "the component of each error along the line from the goal to the tip, mean over completed moves.",
    ]


def _seen(results: Mapping[str, Any]) -> list[str]:
    """What the column of what the cameras saw means, if they looked."""
    camera, method = results["settings"].get("camera"), results["methods"][0]
    if camera is None:
        return []
    error, look = method["observed_error_mm"], method["look_ms"]
    return [
        f"Seen: the cameras' median error ({CameraSettings(**camera)}); p95 {number(error['p95'])} mm.",
        f"One look per goal, {number(look['median'])} ms beside solve, alike for all; judged against the true ball.",
    ]


def _impossible(methods: Sequence[Mapping[str, Any]]) -> list[str]:
    """A line per method that says what made goals impossible, if any were."""
    causes = {
        m["name"]: [f"{n} {status}" for status, n in m["outcomes"].items() if status != COMPLETED] for m in methods
    }
    return [f"Impossible for {name}: {', '.join(found)}." for name, found in causes.items() if found]


def _counts(summary: Mapping[str, float | None]) -> str:
    return " / ".join("-" if count is None else f"{count:.3g}" for count in (summary["median"], summary["p95"]))
