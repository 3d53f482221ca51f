"""What a benchmark suite is given and hands back: plain data that goes to JSON, Markdown and a figure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

#: Cell of a table. Floats are shown with three significant digits; None is an empty cell.
Cell = str | int | float | None


@dataclass(frozen=True)
class Options:
    """What the user asked for.

    Attributes:
        rounds: How often each contender is timed.
        quick: Sizes that show that it works rather than how fast it is; targets are judged all the same, unless a
            suite says that its target is meant for the full size.
        seed: Of poses, goals and postures.
    """

    rounds: int = 7
    quick: bool = False
    seed: int = 0


@dataclass(frozen=True)
class Target:
    """A bound that a measured number is held against.

    Attributes:
        what: The number, and the row that it is about.
        bound: Where it has to stay.
        kind: Whether `bound` is the largest or the smallest good value.
        measured: What it was.
        unit: Of both, as written behind the number ("x EAIK", "%", "steps/s").
        why: Where it falls short: what bounds it, from a profile.
    """

    what: str
    bound: float
    kind: Literal["at most", "at least"]
    measured: float
    unit: str
    why: str = ""

    @property
    def met(self) -> bool:
        """Whether the number is on the good side of its bound."""
        return self.measured <= self.bound if self.kind == "at most" else self.measured >= self.bound


@dataclass(frozen=True)
class Chart:
    """One panel of the figure: either bars or lines.

    Attributes:
        title: Above it.
        bars: Name -> value, drawn on a logarithmic axis.
        lines: Name -> points (x, y), drawn on two logarithmic axes.
        x: Label of the axis of the values for bars, of the horizontal one for lines.
        y: Label of the vertical axis of lines.
        peers: Names of the bars that are somebody else's, which are drawn in another colour.
    """

    title: str
    bars: dict[str, float] = field(default_factory=dict)
    lines: dict[str, list[tuple[float, float]]] = field(default_factory=dict)
    x: str = ""
    y: str = ""
    peers: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Section:
    """A table of the report and what belongs to it.

    Attributes:
        title: Heading.
        text: What was measured and how, and what bounds the numbers; Markdown.
        columns: Heads of the table.
        rows: Cells, as many in each row as there are columns.
        again: The command that measures this again.
        targets: Bounds that numbers of this section are held against.
        missing: Name of each peer that did not take part -> why.
        charts: Panels of the figure.
        samples: Name -> what was measured in every round [s per unit], for the JSON file.
    """

    title: str
    text: str
    columns: tuple[str, ...]
    rows: list[list[Cell]]
    again: str
    targets: list[Target] = field(default_factory=list)
    missing: dict[str, str] = field(default_factory=dict)
    charts: list[Chart] = field(default_factory=list)
    samples: dict[str, list[float]] = field(default_factory=dict)

    @property
    def rounds(self) -> int:
        """How often each contender was timed; 0 where nothing was."""
        return max(map(len, self.samples.values()), default=0)

    def to_json(self) -> dict[str, Any]:
        """Plain dictionaries and lists, each target with its verdict."""
        data = asdict(self)
        for target, written in zip(self.targets, data["targets"], strict=True):
            written["met"] = target.met
        return data

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> Section:
        """The section that `to_json` wrote."""
        targets = [Target(**{k: v for k, v in target.items() if k != "met"}) for target in data["targets"]]
        charts = [
            Chart(**chart | {"lines": {name: [(x, y) for x, y in line] for name, line in chart["lines"].items()}})
            for chart in data["charts"]
        ]
        return cls(**data | {"columns": tuple(data["columns"]), "targets": targets, "charts": charts})


#: Called with what is being measured, and how much of it is done: progress("batch of 100000", 3, 7).
Progress = Callable[[str, int, int], None]
