"""Rank methods by their intervals: which reach the goals, and which of those are nearest and fastest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from kinreach._checks import listed
from kinreach._statistics import number

Summary = Mapping[str, Any]
#: Measures of a ranking, smaller is better -> a sentence about the best method.
RANKED = {
    "distance_mm": "comes nearest: {} mm in the median",
    "decision_ms": "decides fastest: {} ms in the median",
    "solve_ms": "decides fastest: {} ms in the median",
}


def reaching(entries: Sequence[Summary]) -> list[Summary]:
    """Return the methods with the largest share of goals reached, and those whose intervals overlap with it."""
    shares = [entry for entry in entries if entry.get("reached")]
    if not shares:
        return []
    best = max(shares, key=lambda entry: entry["reached"])
    found = [entry for entry in shares if _overlap(entry["reached_ci"], best["reached_ci"])]
    return sorted(found, key=lambda entry: -entry["reached"])


def best_in(entries: Sequence[Summary], key: str) -> list[Summary]:
    """Return the entry with the least median of a measure, then those that do not differ significantly.

    If an entry lacks the measure, return none.
    """
    medians = [(entry.get(key) or {}).get("median") for entry in entries]
    if not entries or None in medians:
        return []
    order = sorted(entries, key=lambda entry: float(entry[key]["median"]))
    bounds = order[0][f"{key}_ci"]["median"]
    return [entry for entry in order if entry is order[0] or _overlap(entry[f"{key}_ci"]["median"], bounds)]


def finding(results: Mapping[str, Any]) -> list[str]:
    """Return the finding in a few sentences; none if the task has no column of goals that were reached.

    Methods are ranked only among those that reach as many goals as any, and are called indistinguishable where their
    95 % intervals overlap.
    """
    entries, goals = results["methods"], results["settings"]["goals"]
    if any(entry.get("reached") is None for entry in entries):
        return []
    ranked = reaching(entries)
    if not ranked:
        return [f"No method reaches any of {goals} goals."]
    share = ranked[0]["reached"]
    top = [entry for entry in ranked if entry["reached"] == share]
    near = ranked[len(top) :]
    every = f"every one of {goals} goals" if goals > 1 else "the goal"
    share_text = every if share == 1 else f"{100 * share:.1f} % of {goals} goals"
    who = listed(_names(top)) if len(top) <= 3 else f"{len(top)} of {len(entries)} methods"
    if len(top) == len(entries) > 1:
        who = "Both methods" if len(top) == 2 else f"All {len(top)} methods"
    sentence = f"{who} {'reach' if len(top) > 1 else 'reaches'} {share_text}"
    if near:
        sentence += f"; {_shares(near)} {'are' if len(near) > 1 else 'is'} indistinguishable"
    sentences = [sentence]
    if len(ranked) > 1:
        measures = [key for key in RANKED if all((entry.get(key) or {}).get("median") for entry in ranked)]
        if "decision_ms" in measures:
            measures.remove("solve_ms")
        sentences += [_first(ranked, key) for key in measures]
    rest = [entry for entry in entries if entry not in ranked]
    if rest:
        sentences.append(f"Not ranked, because fewer goals are reached: {_shares(rest)}")
    return [f"{sentence}." for sentence in sentences]


def _first(ranked: Sequence[Summary], key: str) -> str:
    first, *same = best_in(ranked, key)
    text = f"{first['name']} {RANKED[key].format(number(first[key]['median']))}"
    return f"{text}; {listed(_names(same))} {'are' if len(same) > 1 else 'is'} indistinguishable" if same else text


def _overlap(one: Sequence[float], other: Sequence[float]) -> bool:
    return one[0] <= other[1] and other[0] <= one[1]


def _names(entries: Sequence[Summary]) -> list[str]:
    return [entry["name"] for entry in entries]


def _shares(entries: Sequence[Summary]) -> str:
    return listed([f"{entry['name']} ({100 * entry['reached']:.1f} %)" for entry in entries])
