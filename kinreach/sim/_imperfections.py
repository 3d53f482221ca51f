"""Imperfections of real arms: friction, damping, an unknown load, noise of the encoders; the same for all, or drawn.

The controller ignores them: it plans for the ideal arm, and compensates its gravity.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from kinreach._checks import Floats, as_vector, check_known, check_number, shown
from kinreach.errors import InputError
from kinreach.sim._plants import Ids, rows_and_columns

#: Body of the load in a scene.
PAYLOAD = "payload"
#: Largest values: all of a joint's torque, an arm's own weight, a turn that no servo bears.
LIMITS = {"friction": 1.0, "damping": 10.0, "payload": 100.0, "encoder_noise": 0.1}


@dataclass(frozen=True)
class Imperfections:
    """How far an arm is from an ideal one.

    Attributes:
        friction: Dry friction of every joint, as a share of its largest torque.
        damping: Viscous friction of every joint at 1 rad/s, as a share of its largest torque [s/rad]; beside the
            damping that the arm's description has.
        payload: Mass at the tip that is not compensated [kg].
        encoder_noise: Standard deviation of a servo's reading of its joint, drawn anew every 8 ms [rad].

    Raises:
        InputError: A value out of range.
    """

    friction: float = 0.0
    damping: float = 0.0
    payload: float = 0.0
    encoder_noise: float = 0.0

    def __post_init__(self) -> None:
        for entry in fields(self):
            check_number(entry.name, getattr(self, entry.name), least=0.0, most=LIMITS[entry.name])


IDEAL = Imperfections()


def as_imperfections(given: Imperfections | Mapping[str, float] | None) -> Imperfections:
    """Check imperfections, given as such or by name; None is an ideal arm."""
    if given is None:
        return IDEAL
    if isinstance(given, Imperfections):
        return given
    if not isinstance(given, Mapping):
        raise InputError(f"imperfections must be a mapping of {', '.join(LIMITS)}, got {shown(given)}")
    for name in given:
        check_known("imperfection", name, LIMITS)
    return Imperfections(**given)


def in_scene(flaws: Imperfections) -> Imperfections:
    """Return the imperfections without encoder noise: arms that differ in that alone share a scene."""
    return replace(flaws, encoder_noise=0.0)


def encoder_errors(sigma: float, start: Floats, target: Floats, periods: int) -> Floats:
    """Draw the encoder errors in each period of a move [rad], shape (periods, n).

    The generator follows from where the move starts and ends: the same move is the same again, alone or in a batch,
    and no other move has the same noise.
    """
    words: Any = np.concatenate([start, target]).view(np.uint32)
    return sigma * np.random.default_rng(words.tolist()).standard_normal((periods, len(target)))


#: What can be drawn, in this order, and its bounds. Gears are factors of the torque of a drive.
BOUNDS: Mapping[str, tuple[float, float]] = {
    **{name: (0.0, LIMITS[name]) for name in ("payload", "friction", "damping")},
    "gears": (0.1, 10.0),
    "encoder_noise": (0.0, LIMITS["encoder_noise"]),
}
#: Those that every joint has one of.
OF_JOINTS = ("friction", "damping", "gears")
#: Mass of the payload's body in a scene in which it is drawn [kg]; MuJoCo scales what follows from it.
NOMINAL = 1.0


def check_ranges(given: Mapping[str, Any] | None, bounds: Mapping[str, tuple[float, float]]) -> None:
    """Check ranges by name, two numbers each."""
    if given is None:
        return
    if not isinstance(given, Mapping):
        raise InputError(f"randomise must be a mapping of {', '.join(bounds)} to ranges, got {shown(given)}")
    for name in given:
        check_known("property to randomise", name, bounds)
    for name, ends in given.items():
        least, most = bounds[name]
        low, high = as_vector(f"randomise[{name!r}], its least and largest value,", ends, 2)
        for value in (low, high):
            check_number(f"randomise[{name!r}]", float(value), least=least, most=most)
        if low > high:
            raise InputError(f"randomise[{name!r}] must have its least value first, got {shown(ends)}")


def scene_of(flaws: Imperfections, drawn: Collection[str]) -> Imperfections:
    """Return the imperfections of a scene in which these are drawn: with a body for the payload."""
    changed = {name: getattr(flaws, name) for name in LIMITS}
    return Imperfections(**{**changed, "payload": NOMINAL}) if "payload" in drawn else flaws


def draw(ranges: Mapping[str, Sequence[float]], sizes: Mapping[str, int], rng: np.random.Generator) -> Floats:
    """Draw a row of values, one name after the other, each uniform in its range."""
    return np.concatenate([rng.uniform(ends[0], ends[1], sizes[name]) for name, ends in ranges.items()])


def drawn_sizes(joints: int) -> dict[str, int]:
    """Return how many numbers each property of an arm has, by name."""
    return {name: joints if name in OF_JOINTS else 1 for name in BOUNDS}


class DrawnArms:
    """Writes drawn properties into the models of simulations, one or a batch.

    Attributes:
        sizes: Numbers of each property, by name.
        encoder_noise: Of each simulation [rad], shape (count,); of use where it is drawn.
    """

    def __init__(self, plant: Any, model: Any, joints: Sequence[str], count: int) -> None:
        self._plant = plant
        self._dof = np.array([model.joint(name).dofadr[0] for name in joints], dtype=np.intp)
        self._servos = np.array([model.actuator(name).id for name in joints], dtype=np.intp)
        self._effort = np.array([model.jnt_actfrcrange[model.joint(name).id, 1] for name in joints])
        # of the scene as it was made
        self._damping = model.dof_damping[self._dof].copy()
        self._gain = model.actuator_gainprm[self._servos].copy()
        self._bias = model.actuator_biasprm[self._servos].copy()
        names = [model.body(i).name for i in range(model.nbody)]
        self._load = names.index(PAYLOAD) if PAYLOAD in names else -1
        self._inertia = model.body_inertia[self._load].copy() / max(model.body_mass[self._load], 1e-12)
        self.sizes = drawn_sizes(len(joints))
        self.encoder_noise = np.zeros(count)

    def write(self, ids: Ids, values: Mapping[str, Floats]) -> None:
        """Give simulations their properties, each of shape (k, size)."""
        own = self._plant.own
        if "payload" in values:
            own("body_mass")[ids, self._load] = values["payload"][:, 0]
            own("body_inertia")[ids, self._load] = values["payload"] * self._inertia
        if "friction" in values:
            own("dof_frictionloss")[rows_and_columns(ids, self._dof)] = values["friction"] * self._effort
        if "damping" in values:
            own("dof_damping")[rows_and_columns(ids, self._dof)] = self._damping + values["damping"] * self._effort
        if "gears" in values:
            factor = values["gears"][:, :, None]
            own("actuator_gainprm")[rows_and_columns(ids, self._servos)] = factor * self._gain
            own("actuator_biasprm")[rows_and_columns(ids, self._servos)] = factor * self._bias
        if "encoder_noise" in values:
            self.encoder_noise[ids] = values["encoder_noise"][:, 0]
        if values.keys() - {"encoder_noise"}:
            self._plant.update(ids)
