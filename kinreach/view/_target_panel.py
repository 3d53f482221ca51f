"""The part of the page with a target to drag, every posture for it, and solvers."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from kinreach._checks import Floats
from kinreach._rotations import rotation, rpy
from kinreach.errors import KinreachError
from kinreach.kinematics import Goal, SevenAxisKinematics
from kinreach.kinematics.inside import SOLVERS
from kinreach.view import _html as html
from kinreach.view._draw import AMBER, PALE_RED, RED, VIOLET, Ghost, Ghosts, SolidArm
from kinreach.view._inputs import TypedInput, add_unseen, by_user, frame_of, put
from kinreach.view._names import length, place, plain
from kinreach.view._panel import Panel
from kinreach.view._real_arm import RealArm
from kinreach.view._self_motion import SelfMotionFolder
from kinreach.view._snippet import program
from kinreach.view._target import ALONG, AXIS, POSE, SAME, Answer, Finish, State

NOTHING = "nothing"
#: Choices of postures that are drawn as ghosts.
THOSE_THAT_CAN, ALL, NONE = "that can be used", "all", "none"
#: Opacity of the ghost under the mouse in the list, and of the others meanwhile.
CLEAR, FAINT = 0.8, 0.07
#: The self-motion is computed when the target has been still for so long [s].
STILL = 0.15
TOOL_DOWN = np.diag([1.0, -1.0, -1.0])


class TargetPanel(Panel):
    """The target of one tab.

    Attributes:
        q: The last posture that could be used [rad].
        pointed: Index in `answer.postures` of the posture under the mouse in the list; -1 for none.
        draw_s: Time from the browser's last message to the answer [s].
        arms: Names of arms to choose from, the shown one first.
        take_arm: Shows another one.
    """

    arms: tuple[str, ...] = ()
    take_arm: Callable[[str], None]

    def build(self) -> None:
        self.model = self._setup.model()
        self.q = self.model.home
        self.draw_s = 0.0
        self.finishes: list[Finish] = []
        self.T: Floats = self.model.kinematics.fk(self.q)
        self._kind = self.model.kinds[0]
        self._kept = ""  # name of the posture that the user wants to see
        self.pointed = -1
        setup = self._setup
        self._real = None if setup.nominal is None else RealArm(setup.nominal, setup.arm)
        self._build_scene()
        with self._folder:
            self._build_gui()
        self.answer: Answer = self.model.answer(self.goal, self.q)
        self._draw()
        self._trace()

    @property
    def goal(self) -> Goal:
        return self.model.goal(self._kind, self.T)

    @property
    def solid(self) -> int:
        """Index in `answer.postures` of the solid posture; -1 for none."""
        for index, posture in enumerate(self.answer.postures):
            if posture.name == self._kept and posture.q is not None:
                return index
        return self.answer.shown

    def program(self) -> str:
        return program(self.model, self.goal, self.q, arm=self._setup.expression)

    def show(self, visible: bool) -> None:
        super().show(visible)
        self.pointed = -1
        if visible:
            self._draw()

    def move(self, T: Floats) -> None:
        """Put the target at a frame (4, 4) in the world."""
        start = time.perf_counter()

        def work() -> None:
            for entry in (self._place, self._turn, *self._joints):  # what was typed before is answered by this
                entry.take()
            self.T = T
            self._update(start)

        self._change(work)

    def _build_scene(self) -> None:
        scene, figure = self._client.scene, self._setup.figure
        self._arm = SolidArm(scene, f"{self._root}/arm", figure)
        self._ghosts = Ghosts(scene, f"{self._root}/ghosts", figure, most=html.MAX_POSTURES)
        self._reaching = SolidArm(scene, f"{self._root}/reaching", figure, colour=AMBER, opacity=0.55)
        self._solved = SolidArm(scene, f"{self._root}/solved", figure, colour=VIOLET, opacity=0.5)
        self._solved.visible = False
        size = float(np.linalg.norm(self.T[:3, 3]))
        self._gizmo = scene.add_transform_controls(f"{self._root}/goal", scale=0.25 * size, depth_test=False)
        self._gap = scene.add_line_segments(
            f"{self._root}/gap", np.zeros((1, 2, 3)), RED, thickness=3.0, thickness_units="screen"
        )
        self._label = scene.add_label(f"{self._root}/label", "", anchor="bottom-center")
        self._gizmo.on_update(self._dragged)

    def _build_gui(self) -> None:
        gui, model = self._client.gui, self.model
        self._verdict = gui.add_html("")
        self._calibrated = gui.add_html("")
        self._gauge = gui.add_html("")
        self._list = gui.add_html("")
        with gui.add_folder("Goal"):
            kind = gui.add_dropdown("asks for", model.kinds, initial_value=self._kind)
            place, turn = "Of the tool's tip in the world frame, that of the scene", "About the world's x, y, z in turn"
            self._position = self._vector("x y z [m]", 1000.0, step=0.001, hint=place)
            self._angles = self._vector("roll pitch yaw [°]", 360.0, step=0.1, hint=turn)
            down = gui.add_button("Turn the tool down", hint="The tool's z axis down; turning about it is free")
            back = gui.add_button("Back to the start", hint="Arm and target as in the beginning")
        self._motion: SelfMotionFolder | None = None
        if isinstance(model.kinematics, SevenAxisKinematics):
            self._motion = SelfMotionFolder(self._client, f"{self._root}/self_motion", model.kinematics, self._go_along)
        if self.arms:
            arm = gui.add_dropdown("arm", self.arms, initial_value=self.arms[0], hint="Begins anew with another arm")
            by_user(arm, lambda name: self.take_arm(name))
        with gui.add_folder("Arm", expand_by_default=False):
            self._ghosted = gui.add_dropdown("ghosts", [THOSE_THAT_CAN, ALL, NONE], initial_value=THOSE_THAT_CAN)
            self._bound = gui.add_slider("all within ± [°]", 30, 360, 5, 360, hint="Narrows the limits of all joints")
            # how many of a slider's units a radian or a metre is, and the digits of its steps
            self._per_unit = np.where(model.turns, 180.0 / np.pi, 1.0)
            self._digits = [1 if turns else 3 for turns in model.turns]
            ends = (self._per_unit * [model.lower, model.upper]).T.tolist()
            self._sliders = []
            for name, digits, (low, high) in zip(model.kinematics.arm.joints, self._digits, ends, strict=True):
                low, high, unit = round(low, digits), round(high, digits), "°" if digits == 1 else "m"
                at = float(np.clip(0.0, low, high))
                self._sliders.append(gui.add_slider(f"{plain(name)} [{unit}]", low, high, 10.0**-digits, at))
        with gui.add_folder("Solvers", expand_by_default=False):
            names = model.solvers
            self._chosen = {name: gui.add_checkbox(name, name in SOLVERS) for name in names}
            self._from = gui.add_html("")
            keep = gui.add_button("Start them from this posture", hint="From where the arm stands now")
            run = gui.add_button("Solve")
            self._table = gui.add_html("")
            self._ended = gui.add_dropdown("draw the end of", [NOTHING, *names], initial_value=NOTHING)
        self._remark = gui.add_html("")
        numbers = tuple(map(str, range(html.MAX_POSTURES)))
        add_unseen(gui, html.POSTURE, numbers, lambda number: self._keep(int(number)))
        add_unseen(gui, html.POINT_AT, (NOTHING, *numbers), self._point_at)
        by_user(kind, self._set_kind)
        self._place, self._turn = TypedInput(self._position, self._typed), TypedInput(self._angles, self._typed)
        self._joints = [TypedInput(slider, self._slid) for slider in self._sliders]
        by_user(self._ghosted, lambda value: self._draw_ghosts())
        by_user(self._bound, self._limit)
        by_user(self._ended, lambda value: self._draw_end())
        down.on_click(lambda _: self._turn_down())
        back.on_click(lambda _: self._go_back())
        keep.on_click(lambda _: self._start_from(self._drawn))
        run.on_click(lambda _: self._solve())
        self._start_from(self.q)
        self._kind_input = kind

    def _vector(self, label: str, most: float, **options: Any) -> Any:
        return self._client.gui.add_vector3(label, (0.0,) * 3, min=(-most,) * 3, max=(most,) * 3, **options)

    def _dragged(self, event: Any) -> None:
        if event.client is not None:
            self.move(frame_of(self._gizmo))

    def _typed(self) -> None:
        start = time.perf_counter()

        def work() -> None:
            place, turn = self._place.take(), self._turn.take()
            self.T = self.T.copy()
            if place is not None:
                self.T[:3, 3] = place
            if turn is not None:
                self.T[:3, :3] = rotation(np.radians(turn).tolist())
            self._update(start)

        self._change(work)

    def _set_kind(self, kind: str) -> None:
        self._kind = kind
        self.move(self.T)

    def _keep(self, index: int) -> None:
        """Draw a posture and then its branch solid; the second time, follow the nearest again."""
        with self._lock:
            if index < len(self.answer.postures):
                name = self.answer.postures[index].name
                self._kept = "" if name == self._kept else name
                self._draw()

    def _point_at(self, number: str) -> None:
        with self._lock:
            self.pointed = -1 if number == NOTHING else int(number)
            self._draw_ghosts()

    def _limit(self, degrees: float) -> None:
        with self._lock:
            self.model.limit_joints(float(np.radians(degrees)))
        self.move(self.T)

    def _turn_down(self) -> None:
        T = self.T.copy()
        T[:3, :3] = TOOL_DOWN
        if AXIS in self.model.kinds:
            self._kind = self._kind_input.value = AXIS
        self.move(T)

    def _go_back(self) -> None:
        with self._lock:
            self.q = self.model.home
        self._start_from(self.q)
        self.move(self.model.kinematics.fk(self.q))

    def _slid(self) -> None:
        start = time.perf_counter()

        def work() -> None:
            turned = [entry.take() for entry in self._joints]
            self.q = np.array(
                [
                    q if new is None else new / unit
                    for q, new, unit in zip(self._drawn, turned, self._per_unit, strict=True)
                ]
            )
            self.T = self.model.kinematics.fk(self.q)
            self._update(start)

        self._change(work)

    def _change(self, work: Callable[[], None]) -> None:
        """Change the target; compute its self-motion, which is slower, when it stands still."""
        self._latest(work)
        if self._motion is not None:
            T = self.T
            time.sleep(STILL)
            if T is self.T:
                self._trace()

    def _trace(self) -> None:
        """Compute the self-motion of the target, and draw it if the target has not moved."""
        kinematics, T = self.model.kinematics, self.T
        if self._motion is None or not isinstance(kinematics, SevenAxisKinematics):
            return
        motions = kinematics.self_motions(T) if self._kind == POSE else None
        with self._lock:
            if self._latest.ended or T is not self.T or (motions is None) == (self._kind == POSE):
                return
            if motions is None:
                self._motion.clear("The self-motion is that of a position and orientation.")
                return
            self._motion.show(motions)
            self._motion.follow(self._drawn)

    def _go_along(self) -> None:
        def work() -> None:
            if self._motion is not None and (found := self._motion.take()) is not None:
                self.answer = self.model.along(self.answer, *found)
                self._kept = ALONG
                self._draw()

        self._latest(work)

    def _start_from(self, q: Floats) -> None:
        self._start = q
        values = " ".join(
            place(value, slides=not turns) for value, turns in zip(q.tolist(), self.model.turns, strict=True)
        )
        home = np.abs(q - self.model.home).max() < SAME
        self._from.content = html.small(f"They start from {'the start posture' if home else 'the posture'} {values}.")

    def _solve(self) -> None:
        with self._lock:
            names = [name for name, box in self._chosen.items() if box.value]
            try:
                self.finishes = self.model.solve(self.goal, self._start, names)
            except KinreachError as error:
                self._table.content = html.message(str(error), bad=True)
                return
            self._table.content = html.solvers(self.finishes)
            self._draw_end()

    def _draw_end(self) -> None:
        with self._lock:
            ends = {finish.solver: finish.result.q for finish in self.finishes}
            q = ends.get(self._ended.value)
            self._solved.visible = q is not None
            if q is not None:
                self._solved.take(q)

    def _update(self, start: float) -> None:
        try:
            answer = self.model.answer(self.goal, self.q)
        except KinreachError as error:
            self._verdict.content = html.message(str(error), bad=True)
            return
        self.answer = answer
        if self._motion is not None:
            self._motion.clear("The self-motion is computed when the target stands still.")
        if self.finishes:
            self.finishes, self._table.content = [], ""
            self._solved.visible = False
        self._draw()
        self._client.flush()
        self.draw_s = time.perf_counter() - start
        self._remark.content = html.small(f"Answered in {1000 * self.draw_s:.0f} ms.")

    def _draw(self) -> None:
        answer, solid = self.answer, self.solid
        posture = answer.postures[solid] if solid >= 0 else None
        with self._client.atomic():
            red = {name for pair in posture.pairs for name in pair} if posture else set()
            if posture is not None and posture.state is State.USABLE and posture.q is not None:
                self.q = posture.q
            q = self.q if posture is None or posture.q is None else posture.q
            self._drawn = q
            self._arm.take(q, red=red)
            self._surroundings.mark(red)
            self._draw_ghosts()
            self._draw_gap()
            put(self._gizmo, self.T)
        self._verdict.content = html.message(answer.verdict, bad=not answer.usable)
        joints = self.model.kinematics.arm.joints
        sliding = [name for name, turns in zip(joints, self.model.turns, strict=True) if not turns]
        kept = posture is not None and posture.name == self._kept
        self._calibrated.content = self._changed()
        self._list.content = html.legend(answer, shown=solid, joints=joints, sliding=sliding, chosen=kept)
        reached = answer.approach is None
        gauge = html.gauge(self.model.slowest_motion(q), self.model.nearest_singularity(q)) if reached else ""
        self._gauge.content = gauge
        self._place.show(tuple(self.T[:3, 3].round(3).tolist()))
        self._turn.show(tuple(np.degrees(rpy(self.T[:3, :3])).round(1).tolist()))
        if self._motion is not None:
            self._motion.follow(q)
        shown = zip(self._joints, self._sliders, self._digits, (self._per_unit * q).tolist(), strict=True)
        for entry, slider, digits, value in shown:
            entry.show(float(np.clip(round(value, digits), slider.min, slider.max)))

    def _changed(self) -> str:
        """A remark on the effect of the calibration at the target, as HTML."""
        if self._real is None:
            return ""
        sent = self._real.believed(self.T, self.q)
        by = f"Calibrated by {Path(str(self._setup.calibration)).name}:"
        if not sent.success:
            return html.small(f"{by} these are this arm's own postures; the data sheet's has none here.")
        off = length(self._real.miss(sent.q).distance)
        return html.small(
            f"{by} these are this arm's own postures. In the data sheet's its tip would be {off} beside the target."
        )

    def _draw_ghosts(self) -> None:
        """Draw the postures that are not solid; the one under the mouse in the list stands out."""
        usual = {THOSE_THAT_CAN: (State.USABLE,), ALL: tuple(State), NONE: ()}[self._ghosted.value]
        ghosts, solid = [], self.solid
        for index, posture in enumerate(self.answer.postures):
            pointed = index == self.pointed
            if posture.q is not None and index != solid and (pointed or posture.state in usual):
                colour = html.branch_colour(posture.branch) if posture.state is State.USABLE else PALE_RED
                ghost = Ghost(posture.q, colour, {name for pair in posture.pairs for name in pair})
                if self.pointed >= 0:
                    ghost = replace(ghost, opacity=CLEAR if pointed else FAINT)
                ghosts.append(ghost)
        self._ghosts.take(ghosts, beside=self._drawn)

    def _draw_gap(self) -> None:
        """Draw the nearest posture to a target out of reach, and the gap."""
        approach = self.answer.approach
        shown = approach is not None
        self._reaching.visible = self._gap.visible = self._label.visible = shown
        if approach is None:
            return
        self._reaching.take(approach.q)
        tip, wanted = self.model.kinematics.fk(approach.q)[:3, 3], self.T[:3, 3]
        self._gap.points = np.array([[tip, wanted]])
        self._label.text = f"{'at best' if approach.proven else 'a search ends'} {length(approach.distance)} away"
        self._label.position = (tip + wanted) / 2
