"""A tried motion as the page shows it: frames to play, the arm along its way, and its command line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from kinreach._checks import Floats
from kinreach._engines import load
from kinreach.cli import quoted
from kinreach.deploy.inside import MotionFlags, TriedMotion
from kinreach.kinematics.inside import described
from kinreach.robots import ArmDescription
from kinreach.robots.inside import JOINTS

pin: Any = load("pinocchio")

#: Frames per second.
FPS = 25
#: Samples of the speeds that are drawn over the time.
DRAWN = 241
#: Number of a UR's joint at its elbow, of the model's.
ELBOW = 1 + JOINTS.index("elbow_joint")


@dataclass(frozen=True, eq=False)
class ShownMotion:
    """A motion as it was asked for, and as it was tried.

    Attributes:
        sends: Whether the terminal asks to send it.
    """

    flags: MotionFlags
    motion: TriedMotion
    sends: bool = False

    @property
    def arm(self) -> ArmDescription:
        """The arm with what is around it."""
        return self.motion.kinematics.arm

    @cached_property
    def times(self) -> Floats:
        """Of the frames, the last one that of the end [s], shape (k,)."""
        duration = self.motion.done.commanded.duration
        return np.append(np.arange(0.0, duration - 0.5 / FPS, 1.0 / FPS), duration)

    @cached_property
    def q(self) -> Floats:
        """Postures of the frames [rad], shape (k, 6)."""
        return self.motion.done.commanded.at(self.times)[0]

    @cached_property
    def shares(self) -> Floats:
        """Speeds of the frames by the joints' limits, 0 to 1, shape (k, 6)."""
        return self._shares_at(self.times)

    @cached_property
    def speeds(self) -> tuple[Floats, Floats]:
        """Times [s], shape (k,), at which the joints' speeds by their limits, shape (k, 6), are drawn."""
        times = np.linspace(0.0, self.motion.done.commanded.duration, DRAWN)
        return times, self._shares_at(times)

    def _shares_at(self, times: Floats) -> Floats:
        return np.abs(self.motion.done.commanded.at(times)[1]) / self.motion.kinematics.velocity_limit

    def along(self, count: int) -> Floats:
        """Postures at even distances along the way, without its ends [rad], shape (count, 6)."""
        ways = np.append(0.0, np.linalg.norm(np.diff(self.q, axis=0), axis=1).cumsum())
        places = np.linspace(0.0, ways[-1], count + 2)[1:-1]
        return np.stack([np.interp(places, ways, joint) for joint in self.q.T], axis=1)

    def ways(self) -> tuple[Floats, Floats]:
        """Positions of the tool's tip and of the elbow in the world [m], each (k, 3)."""
        kin = self.motion.kinematics
        tips = np.array([(kin.T_world_base @ kin.fk(q))[:3, 3] for q in self.q])
        elbows = []
        for q in self.q:
            pin.forwardKinematics(kin.model, kin.data, q)
            elbows.append(np.array(kin.data.oMi[ELBOW].translation))
        return tips, np.array(elbows)

    @property
    def verdict(self) -> str:
        """The cautions in a sentence; else how far the joints turn, and the branch."""
        motion = self.motion
        if motion.cautions:
            return f"Caution: {'; '.join(motion.cautions)}."
        turns, branch = np.degrees(max(leg.travels.max() for leg in motion.legs)), motion.legs[-1].branch
        named = f": {described(motion.kinematics, branch)}" if branch >= 0 else ""
        return f"No joint turns by more than {turns:.0f}°, and the arm stays in its branch{named}."

    @property
    def remarks(self) -> list[str]:
        """The ways to the goals, and the dry run."""
        many = len(self.motion.legs) > 1
        ways = [f"to goal {number}: {way}" if many else way for number, way in enumerate(self.motion.ways, start=1)]
        return [*ways, *(" ".join(line.split()) for line in self.motion.dry_run)]

    def command(self, words: Sequence[str]) -> str:
        """The command that gives this motion; `words` are the flags of the arm."""
        lines, given = ["kinreach move"], [*words, *self.flags.words]
        for word, value in zip(given, [*given[1:], "--"], strict=True):
            if word.startswith("--"):
                lines.append(word if value.startswith("--") else f"{word} {quoted(value)}")
        return " \\\n    ".join(lines) + "\n"
