"""The part of the page that shows a calibrated UR over its data sheet."""

from __future__ import annotations

from typing import Any

import numpy as np

from kinreach._checks import Floats
from kinreach.errors import KinreachError
from kinreach.robots import PUBLISHED_CALIBRATIONS, ArmDescription
from kinreach.robots.inside import ur_model
from kinreach.view import _html as html
from kinreach.view._draw import BLUE, RED, SolidArm
from kinreach.view._figure import Figure
from kinreach.view._inputs import by_user, frame_of, put
from kinreach.view._names import angle, length
from kinreach.view._panel import Panel
from kinreach.view._real_arm import ErrorMap, RealArm, TipMiss, colours
from kinreach.view._snippet import calibrated, real_arm_program

#: Factors of the drawn tip error: at the start and the largest.
TIMES, MAX_TIMES = 30, 100
#: Pixels of a cell of the map.
PIXELS = 8


class RealArmPanel(Panel):
    """Nominal and calibrated arm in the data sheet's posture for a target, and the tip error."""

    def build(self) -> None:
        self._sheet = self._setup.nominal or self._setup.arm
        self.model: RealArm | None = None
        self.map: ErrorMap | None = None
        self.miss: TipMiss | None = None
        self._arms: list[SolidArm] = []
        self._robot = ur_model(self._sheet.name) or self._sheet.name
        self._published = [name for name in PUBLISHED_CALIBRATIONS if name.startswith(f"{self._robot}_")]
        with self._folder:
            self._build_gui()
        scene = self._client.scene
        self._gizmo = scene.add_transform_controls(f"{self._root}/goal", scale=0.2, depth_test=False, visible=False)
        self._arrow = scene.add_arrows(
            f"{self._root}/error", np.zeros((1, 2, 3)), RED, shaft_radius=0.006, head_radius=0.014, head_length=0.03,
            visible=False,
        )  # fmt: skip
        self._label = scene.add_label(f"{self._root}/label", "", anchor="bottom-center", visible=False)
        self._gizmo.on_update(self._dragged)
        if self._setup.nominal is not None:
            self._take(self._setup.arm, self._setup.expression)
        elif self._published:
            self._publish(self._published[0])
        else:
            self._verdict.content = html.message(
                f"Name the calibration file of your {self._robot} to see it beside its data sheet. "
                "The package has none of this model."
            )

    def open(self, file: str, *, remark: str = "") -> None:
        """Read a calibration; if that fails, show the error and keep the last one."""
        try:
            arm = self._sheet.calibrated(file.strip())
            with self._lock:
                self._take(arm, calibrated(self._setup.sheet, file.strip()), remark=remark)
        except KinreachError as error:
            self._verdict.content = html.message(str(error), bad=True)

    def move(self, T: Floats) -> None:
        """Put the target at a frame (4, 4) in the world."""

        def work() -> None:
            self.T = T
            self._update()

        self._latest(work)

    def program(self) -> str:
        if self.model is None:
            return "# There is no calibration yet.\n"
        return real_arm_program(self.model, self.T, self.q, sheet=self._setup.sheet, arm=self._expression)

    def _build_gui(self) -> None:
        gui = self._client.gui
        self._verdict = gui.add_html("")
        self._numbers = gui.add_html("")
        self._times = gui.add_slider(
            "error drawn ×", 1, MAX_TIMES, 1, TIMES, hint="Millimetres cannot be seen beside a metre"
        )
        self._over_table = gui.add_checkbox("map over the table", True)
        self._scale = gui.add_html("")
        self._file = gui.add_text("calibration", "", hint="kinematics.yaml, calibration.conf, or a calibrated URDF")
        opened = gui.add_button("Open calibration")
        if self._published:
            self._example = gui.add_dropdown("or a published", self._published, hint="Of real arms, in the package")
            by_user(self._example, self._publish)
        self._times.visible = self._over_table.visible = False
        by_user(self._times, lambda value: self.move(self.T))
        by_user(self._over_table, self._show_map)
        opened.on_click(lambda _: self.open(self._file.value))

    def _publish(self, name: str) -> None:
        remark = f"This is the published calibration {name}, of another {self._robot}; open your own below. "
        self.open(str(PUBLISHED_CALIBRATIONS[name]), remark=remark)

    def _take(self, arm: ArmDescription, expression: str, *, remark: str = "") -> None:
        self._expression, self._remark = expression, remark
        model = RealArm(self._sheet, arm)
        found = model.map()
        figures = [Figure(kinematics, simple=self._setup.simple) for kinematics in (model.nominal, model.real)]
        for old in self._arms:
            old.remove()
        scene = self._client.scene
        self._arms = [
            SolidArm(scene, f"{self._root}/nominal", figures[0], colour=BLUE, opacity=0.4),
            SolidArm(scene, f"{self._root}/real", figures[1]),
        ]
        self.model, self.map = model, found
        self._draw_map(found)
        self.q = np.array(model.nominal.arm.home)
        self.T = model.nominal.fk(self.q)
        self._gizmo.visible = self._times.visible = self._over_table.visible = True
        self._update()

    def _draw_map(self, found: ErrorMap) -> None:
        most = float(found.known.max())
        picture = np.kron(colours(found.distances, most), np.ones((PIXELS, PIXELS, 1), dtype=np.uint8))
        # the picture's columns run along x, its rows against y
        self._picture = self._client.scene.add_image(
            f"{self._root}/map", picture[::-1], *found.size, wxyz=(0.0, 1.0, 0.0, 0.0),
            position=found.centre + np.array([0.0, 0.0, 0.002]), cast_shadow=False, visible=self._over_table.value,
        )  # fmt: skip
        self._scale.content = html.scale(
            colours(np.linspace(0, most, 24), most),
            f"{length(0)}",
            length(most),
            "tip error, tool down, at this height",
        )

    def _show_map(self, visible: bool) -> None:
        if self.map is not None:
            self._picture.visible = visible

    def _dragged(self, event: Any) -> None:
        if event.client is not None:
            self.move(frame_of(self._gizmo))

    def _update(self) -> None:
        """Solve for the data sheet's arm, and draw both arms in that posture."""
        model = self.model
        if model is None:
            return
        put(self._gizmo, self.T)
        sent = model.believed(self.T, self.q)
        self.miss = miss = model.miss(sent.q) if sent.success else None
        self._arrow.visible = self._label.visible = miss is not None
        if miss is None:
            self._verdict.content = html.message(f"The data sheet's arm has no posture there: {sent.reason}.", bad=True)
            self._numbers.content = ""
            return
        self.q = sent.q
        self._draw(miss)
        exact = model.real.nearest(self.T, self.q)
        off = f"{length(miss.distance)} beside the target, turned by {angle(miss.turned, 2)}"
        self._verdict.content = html.message(f"{self._remark}In the data sheet's posture the tip of this arm is {off}.")
        self._numbers.content = html.miss(miss, exact)

    def _draw(self, miss: TipMiss) -> None:
        times = self._times.value
        tip = miss.meant[:3, 3]
        with self._client.atomic():
            for arm in self._arms:
                arm.take(miss.q)
            self._arrow.points = np.array([[tip, tip + times * miss.vector]])
            self._label.text = length(miss.distance) + (f", drawn × {times}" if times > 1 else "")
            self._label.position = tip + times * miss.vector
