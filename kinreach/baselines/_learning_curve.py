"""Learning curves in windows of environment steps."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv, VectorWrapper

from kinreach._files import read_text
from kinreach.baselines._batch import last_value
from kinreach.errors import InputError

Array = np.ndarray[Any, Any]

#: Largest file [bytes]; a row has some 60.
MAX_BYTES = 256 * 1024 * 1024
#: Columns of a learning curve. Steps and episodes count from the start; the rest is of one window: the mean reward of
#: a step and return of an episode (both of the environment, exploration included); of the episodes that ended in it,
#: the share that reached the goal, and the means of the last distance [m] and posture error [rad]; and the share of
#: steps that were impossible. Empty where the environment has no such thing, or no episode ended.
COLUMNS = ("steps", "episodes", "reward", "return", "reached", "distance", "posture_error", "impossible")

#: Columns of a traced episode: steps so far, distance after the step [m] (empty without one), reward of the step.
TRACE_COLUMNS = ("steps", "distance", "reward")


class LearningCurve(VectorWrapper[Any, Any, Any]):
    """A vector environment that records its learning curve.

    An episode that a reset cuts short counts as ended. A step's info has `reached_lately`, for rewards that depend on
    the progress of the training.

    Args:
        env: With `AutoresetMode.SAME_STEP`.
        window: Environment steps of a row.
        trace_after: Steps after which the next whole episode of the first environment is kept step by step.

    Attributes:
        rows: Finished rows, values in the order of `COLUMNS`.
        steps, episodes: Counts so far.
        trace: That episode, values in the order of `TRACE_COLUMNS`.
        traced: Whether it is over.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any], *, window: int, trace_after: int | None = None) -> None:
        super().__init__(env)
        self.window = window
        self.trace: list[list[float | None]] = []
        self.traced = trace_after is None
        self._trace_after = trace_after or 0
        self.rows: list[list[float | None]] = []
        self.steps = self.episodes = 0
        self._returns = np.zeros(env.num_envs)
        self._begun = np.zeros(env.num_envs, dtype=np.bool_)
        self._info: dict[str, Any] = {}
        self._clear()

    @property
    def reached_lately(self) -> float:
        """Share of the episodes that reached the goal, from the last row in which one ended; 0 before."""
        column = COLUMNS.index("reached")
        return next((share for row in reversed(self.rows) if (share := row[column]) is not None), 0.0)

    def reset(self, **kwargs: Any) -> tuple[Any, dict[str, Any]]:
        self.cut()
        return self.env.reset(**kwargs)

    def cut(self) -> None:
        """Count the episodes in progress as ended; a reset must follow."""
        self._end(self._begun.copy())

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        observations, rewards, terminated, truncated, self._info = self.env.step(actions)
        self.steps += self.num_envs
        self._counted += self.num_envs
        self._sums["reward"] += float(rewards.sum())
        if (impossible := last_value(self._info, "impossible")) is not None:
            self._sums["impossible"] = self._sums.get("impossible", 0.0) + float(np.sum(impossible))
        self._returns += rewards
        if not self.traced:
            self._keep(float(rewards[0]), over=bool(terminated[0] or truncated[0]))
        self._begun[:] = True
        self._end(terminated | truncated)
        if self._counted >= self.window:
            self._close_row()
        return observations, rewards, terminated, truncated, {**self._info, "reached_lately": self.reached_lately}

    def _keep(self, reward: float, *, over: bool) -> None:
        """Add a step to the traced episode, if it has begun or begins now."""
        if not self._begun[0]:
            self.trace = []  # one that a reset cut short does not count
        if self.steps > self._trace_after and (self.trace or not self._begun[0]):
            distances = last_value(self._info, "distance")
            self.trace.append([self.steps, None if distances is None else float(distances[0]), reward])
            self.traced = over

    def _end(self, over: Array) -> None:
        if not over.any():
            return
        self.episodes += int(over.sum())
        self._ended += int(over.sum())
        self._sums["return"] += float(self._returns[over].sum())
        # column of the curve -> name in the info
        columns = {"reached": "is_success", "distance": "distance", "posture_error": "posture_error"}
        for column, name in columns.items():
            if (values := last_value(self._info, name)) is not None:
                self._sums[column] = self._sums.get(column, 0.0) + float(values[over].sum())
        self._returns[over] = 0.0
        self._begun[over] = False

    def _close_row(self) -> None:
        row: dict[str, float] = {"steps": self.steps, "episodes": self.episodes}
        for name, value in self._sums.items():
            count = self._counted if name in ("reward", "impossible") else self._ended
            if count:
                row[name] = value / count
        self.rows.append([row.get(name) for name in COLUMNS])
        self._clear()

    def _clear(self) -> None:
        self._sums = dict.fromkeys(("reward", "return"), 0.0)
        self._counted = self._ended = 0


def curve_csv(rows: Sequence[Sequence[float | None]], columns: Sequence[str] = COLUMNS) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([["" if value is None else f"{value:.10g}" for value in row] for row in rows])
    return text.getvalue()


def read_curve(path: str | Path) -> dict[str, Array]:
    """Return the columns of a learning curve by name; empty cells are NaN.

    Raises:
        InputError: The file does not exist or is not a learning curve.
    """
    text = read_text(Path(path), "the learning curve", most=MAX_BYTES)
    try:
        header, *rows = csv.reader(io.StringIO(text, newline=""))
        values = np.array([[float(cell or "nan") for cell in row] for row in rows]).reshape(-1, len(header))
    except (ValueError, csv.Error) as error:
        raise InputError(f"{path} is not a learning curve: {error}") from None
    return dict(zip(header, values.T, strict=True))
