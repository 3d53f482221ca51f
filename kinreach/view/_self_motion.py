"""The self-motion of a seven-axis arm: paths of its elbow, and inputs that move the arm along one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from math import ceil
from typing import Any

import numpy as np

from kinreach._checks import Floats
from kinreach._engines import load
from kinreach.kinematics import SelfMotion, SelfMotions, SevenAxisKinematics
from kinreach.view import _html as html
from kinreach.view._draw import Branch
from kinreach.view._inputs import TypedInput, by_user

pin: Any = load("pinocchio")

#: The inputs keep their values for postures nearer than this [rad].
NEAR = 1e-2
NONE = "none"


class SelfMotionFolder(Branch):
    """The curves of one pose: a folder of inputs, and lines in the scene.

    `react` is called when the user has chosen a curve or a place on it; `take` has the posture.
    """

    def __init__(self, client: Any, root: str, kinematics: SevenAxisKinematics, react: Callable[[], None]) -> None:
        self._scene, self._kinematics = client.scene, kinematics
        self._root = client.scene.add_frame(root, show_axes=False)
        self._curves: list[tuple[str, SelfMotion]] = []
        self._ways: list[Floats] = []
        self._thick = -1  # index of the curve that is drawn thick
        self._q = np.array(kinematics.arm.home)
        self._unit = kinematics.unit
        gui = client.gui
        with gui.add_folder("Self-motion"):
            self._text = gui.add_html("")
            self._curve = gui.add_dropdown("curve", [NONE], visible=False)
            self._place = gui.add_slider("along it [rad]", 0.0, 1.0, 0.01, 0.0, visible=False)
        by_user(self._curve, lambda value: react())
        self._entry = TypedInput(self._place, react)

    def clear(self, text: str) -> None:
        self._curves = []
        self.visible = self._curve.visible = self._place.visible = False
        self._text.content = html.small(text)

    def show(self, motions: SelfMotions) -> None:
        """Draw curves, or write the reason why there are none."""
        if not motions.success:
            self.clear(f"There is no self-motion: {motions.reason}.")
            return
        if not motions.curves:
            self.clear("The postures of this pose are a surface, not curves: two pairs of axes coincide.")
            return
        curves, count = motions.curves, len(motions)
        ends = ["closed" if curve.closed else "ends at limits" for curve in curves]
        self._curves = [
            (f"curve {index} of {count}, {curve.total:.1f} rad, {end}", curve)
            for index, (curve, end) in enumerate(zip(curves, ends, strict=True), start=1)
        ]
        self._ways = [self._way(curve) for curve in curves]
        self._draw("all", range(count), thickness=2.5)
        self._thick = -1
        self._curve.options = [label for label, _ in self._curves]
        self._text.content = html.small(
            "Lines are the ways of the elbow while the tool stands still; the chosen curve is thick."
        )
        self.visible = self._curve.visible = self._place.visible = True

    def follow(self, q: Floats) -> None:
        """Show in the inputs where a posture (7,) [rad, m] is, or the nearest on a curve."""
        self._q = q
        if not self._curves:
            return
        index, curve = self._chosen()
        if np.abs((curve.at(min(self._place.value, curve.total)) - q) / self._unit).max() < NEAR:
            self._show(index, self._place.value)
            return
        _, index, place = min(self._nearest(index) for index in range(len(self._curves)))
        if self._curve.value != self._curves[index][0]:
            self._curve.value = self._curves[index][0]
        self._show(index, place)

    def take(self) -> tuple[int, Floats] | None:
        """Return the index of the chosen curve, and the posture where its slider stands; None without curves.

        On a curve that was chosen since the last call it is the posture nearest to the one followed.
        """
        place = self._entry.take()
        if not self._curves:
            return None
        index, curve = self._chosen()
        if place is None:
            _, _, place = self._nearest(index)
        self._show(index, place)
        return index, curve.at(min(place, curve.total))

    def _chosen(self) -> tuple[int, SelfMotion]:
        index = [label for label, _ in self._curves].index(self._curve.value)
        return index, self._curves[index][1]

    def _show(self, index: int, place: float) -> None:
        if index != self._thick:
            self._draw("chosen", [index], thickness=7.0)
            self._thick = index
        most = max(0.01, ceil(100 * self._curves[index][1].total) / 100)
        if self._place.max != most:
            self._place.max = most
        self._entry.show(round(place, 2))

    def _nearest(self, index: int) -> tuple[float, int, float]:
        """How far a curve is from the posture followed [rad], its index, and the arc length there [rad]."""
        curve = self._curves[index][1]
        away = (self._q - curve.q) / self._unit
        sample = int(np.linalg.norm(away, axis=1).argmin())
        along = float(away[sample] @ (curve.tangent[sample] / self._unit))
        place = float(np.clip(curve.length[sample] + along, 0.0, curve.total))
        return float(np.linalg.norm((curve.at(place) - self._q) / self._unit)), index, place

    def _draw(self, name: str, indices: Sequence[int], *, thickness: float) -> None:
        points = np.concatenate([self._ways[index] for index in indices])
        colours = [np.full(self._ways[index].shape, html.branch_colour(index), np.uint8) for index in indices]
        self._scene.add_line_segments(
            f"{self._root.name}/{name}", points, np.concatenate(colours), thickness=thickness, thickness_units="screen"
        )

    def _way(self, curve: SelfMotion) -> Floats:
        """Segments of the way of the middle joint along a curve in the world [m], shape (m, 2, 3)."""
        model, data = self._kinematics.model, self._kinematics.data
        places = []
        for q in (*curve.q, *(curve.q[:1] if curve.closed else ())):
            pin.forwardKinematics(model, data, q)
            places.append(np.array(data.oMi[(model.nq + 1) // 2].translation))
        return np.array(list(pairwise(places))).reshape(-1, 2, 3)
