"""Which methods are best, and which cannot be told from them: by paired tests on the same goals.

All methods get the same goals, so two are compared goal by goal. Of goals reached the test is McNemar's, exact; of
distances and times it is the sign test. Both ask whether either method is as likely to be the better one on a goal.
Medians must also differ by more than the measurement resolves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

from kinreach._checks import listed
from kinreach._statistics import CONFIDENCE, Column, Trial, number, paired_p
from kinreach.compare._task import CHANCE, POLICY, Task

Summary = Mapping[str, Any]

#: Parts of a table, by which its methods are grouped.
PARTS = ("Models: solvers, controllers, planners", "Learned", "The thesis's settings", "Chance")
#: Measures of a ranking, smaller is better -> what one method does, what several do, and the unit.
RANKED = {
    "distance_mm": ("comes nearest", "come nearest", "mm"),
    "decision_ms": ("decides fastest", "decide fastest", "ms"),
    "solve_ms": ("decides fastest", "decide fastest", "ms"),
}
#: Medians that differ by less are not told apart. Distances [mm]: a simulated move counts as ended while a joint still
#: creeps by up to 4e-5 rad, at an arm's reach of 0.85 m 0.03 mm of the tip; as exactly an e-Series repeats. Times: as a
#: share.
RESOLVED_MM, RESOLVED_TIME = 0.03, 0.1


#: Goals from which on a paired test can tell two methods apart: with five that are all better for one, p is 0.06.
MIN_GOALS = 6


class Test(NamedTuple):
    """A method beside the best: on how many goals it is better and worse, the p value, and whether they differ."""

    best: str
    better: int
    worse: int
    p: float
    same: bool

    def words(self, reached: bool) -> str:
        """Say what was counted, of goals reached or of another measure."""
        if reached:
            return (
                f"reached only here: {self.better}, only by {self.best}: {self.worse}; McNemar's exact {p_text(self.p)}"
            )
        close = ", but less apart than is resolved" if self.same and self.p < 1 - CONFIDENCE else ""
        counted = f"smaller than {self.best}'s on {self.better} goals, larger on {self.worse}"
        return f"{counted}; sign test {p_text(self.p)}{close}"


@dataclass(frozen=True, eq=False)
class Ranking:
    """The methods of a comparison beside each other.

    Attributes:
        task: With the columns, and the measures that rank.
        results: As in `results.json`.
        trials: Of all methods.
    """

    task: Task
    results: Mapping[str, Any]
    trials: Sequence[Trial]

    @cached_property
    def _own(self) -> dict[str, dict[int, Trial]]:
        found: dict[str, dict[int, Trial]] = {entry["name"]: {} for entry in self.results["methods"]}
        for trial in self.trials:
            found[trial["method"]][trial["goal_index"]] = trial
        return found

    @cached_property
    def reached(self) -> dict[str, Test]:
        """Each method, by name, beside the one that reaches most goals; that one first. None if no goal is reached.

        Who reaches none is never as good as the best, however few goals there are.
        """
        shares = sorted((entry for entry in self.results["methods"] if entry.get("reached") is not None), key=_share)
        if not shares or not shares[0]["reached"]:
            return {}
        best, found = shares[0]["name"], {}
        for entry in shares:
            better, worse, p = self._test(entry["name"], best, lambda trial: -float(trial["reached"]))
            found[entry["name"]] = Test(best, better, worse, p, entry["reached"] > 0 and p >= 1 - CONFIDENCE)
        return found

    @cached_property
    def reaching(self) -> list[Summary]:
        """The method that reaches most goals, and those that cannot be told from it."""
        entries = [
            entry for entry in self.results["methods"] if (test := self.reached.get(entry["name"])) and test.same
        ]
        return sorted(entries, key=_share)

    @cached_property
    def _measured(self) -> dict[str, dict[str, Test]]:
        return {column.key: self._compared(column) for column in self.task.columns if column.key in self.task.ranked}

    def measured(self, key: str) -> dict[str, Test]:
        """Return each method that reaches as many goals as any, beside the one with the least median of a measure.

        The best comes first. If a method lacks the measure, or the task does not rank by it, return none.
        """
        return self._measured.get(key, {})

    def _compared(self, column: Column) -> dict[str, Test]:
        medians: dict[str, Any] = {
            entry["name"]: (entry.get(column.key) or {}).get("median") for entry in self.reaching
        }
        if not medians or None in medians.values():
            return {}
        order = sorted(medians, key=medians.__getitem__)
        least, found = float(medians[order[0]]), {}
        resolved = RESOLVED_MM if column.key.endswith("_mm") else RESOLVED_TIME * least
        for name in order:
            better, worse, p = self._test(name, order[0], column.of)
            close = float(medians[name]) - least < resolved
            found[name] = Test(order[0], better, worse, p, close or p >= 1 - CONFIDENCE)
        return found

    def best(self, key: str) -> list[str]:
        """Return the names of the best by a measure: the first, and those that cannot be told from it."""
        return [name for name, test in self.measured(key).items() if test.same]

    def _test(self, name: str, best: str, value: Callable[[Trial], Any]) -> tuple[int, int, float]:
        """Count the goals on which a method's value is smaller, and larger, and return the p value."""
        better = worse = 0
        others = self._own[best]
        for goal, trial in self._own[name].items():
            if goal in others:
                mine, other = value(trial), value(others[goal])
                if mine is not None and other is not None:
                    better, worse = better + (mine < other), worse + (mine > other)
        return better, worse, paired_p(better, worse)

    def finding(self) -> list[str]:
        """Return the finding in a few sentences; none if the task has no column of goals that were reached.

        Methods are ranked only among those that reach as many goals as any, and only by `MIN_GOALS` or more.
        """
        entries, goals = self.results["methods"], self.results["settings"]["goals"]
        if any(entry.get("reached") is None for entry in entries):
            return []
        ranked = self.reaching
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
        if len(entries) > 1 and goals < MIN_GOALS:
            fewer = [entry for entry in entries if entry not in top]
            said = f"{listed(_names(fewer))} {'reach' if len(fewer) > 1 else 'reaches'} fewer"
            apart = f"It takes {MIN_GOALS} goals or more to tell methods apart"
            return [f"{part}." for part in (sentence, *([said] if fewer else []), apart)]
        if near:
            sentence += f"; {self._shares(near)} {'are' if len(near) > 1 else 'is'} indistinguishable"
        sentences = [sentence]
        if len(ranked) > 1:
            measures = [key for key in RANKED if key in self.task.ranked and self.measured(key)]
            if "decision_ms" in measures and "solve_ms" in measures:
                measures.remove("solve_ms")
            sentences += [self._first(key) for key in measures]
        rest = [entry for entry in entries if entry not in ranked]
        if rest:
            sentences.append(f"Not ranked, because fewer goals are reached: {self._shares(rest)}")
        return [f"{sentence}." for sentence in sentences]

    def _first(self, key: str) -> str:
        """Name the best, or the several that cannot be told apart."""
        names, (one, several, unit) = self.best(key), RANKED[key]
        medians = [entry[key]["median"] for entry in self.reaching if entry["name"] in names]
        least, most = number(min(medians)), number(max(medians))
        if len(names) == 1:
            return f"{names[0]} {one}: {least} {unit} in the median"
        span = least if least == most else f"{least} to {most}"
        return f"{listed(names)} {several}, indistinguishable: {span} {unit} in the median"

    def _shares(self, entries: Sequence[Summary]) -> str:
        """Write shares with their p values against the best."""
        parts = []
        for entry in entries:
            test = self.reached.get(entry["name"])
            parts.append(f"{entry['name']} ({100 * entry['reached']:.1f} %{f', {p_text(test.p)}' if test else ''})")
        return listed(parts)


def part_of(entry: Mapping[str, Any]) -> int:
    """Return the part of a table that a method is in, an index of `PARTS`."""
    if entry["kind"] == CHANCE:
        return 3
    return 0 if entry["kind"] != POLICY else 2 if entry["name"].startswith("thesis-") else 1


def p_text(p: float) -> str:
    """Write a p value."""
    return "p < 0.001" if p < 0.001 else f"p = {p:.2g}"


def _share(entry: Summary) -> float:
    return -float(entry["reached"])


def _names(entries: Sequence[Summary]) -> list[str]:
    return [entry["name"] for entry in entries]
