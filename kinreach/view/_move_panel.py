"""The part of the page that plans a motion of a UR and plays it; nothing is sent from it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from kinreach._checks import Floats
from kinreach._flags import pose_numbers_of, posture_of
from kinreach.deploy.inside import MotionFlags
from kinreach.errors import KinreachError
from kinreach.kinematics import ArmKinematics, ClosedFormKinematics, pose, pose_vector
from kinreach.kinematics.inside import SAME, described
from kinreach.robots import ArmDescription, Obstacle
from kinreach.robots.inside import mesh_in_metres
from kinreach.view import _html as html
from kinreach.view._draw import BLUE, VIOLET, Colour, Ghost, Ghosts, SolidArm, Surroundings
from kinreach.view._inputs import add_unseen, by_user, frame_of, put
from kinreach.view._motion import FPS, ShownMotion
from kinreach.view._playing import PAUSE, PLAY, START, PlayedPanel
from kinreach.view._snippet import motion_program

NEAREST = "whichever is nearest along the way"
COMMAND, PYTHON, URSCRIPT = "command", "Python", "URScript"
#: Arms along the way, and their opacity.
SHADES, OPACITY = 12, 0.08
#: Decimals of a dragged pose [m, rad], and of a start posture [degrees].
POSE_DIGITS, ANGLE_DIGITS = 4, 2
#: Between goals in their field, and between boxes.
NEXT = ";"
CHANGED = "What is around the arm has changed since this motion was planned: plan again."
FIRST = "Type a pose as the pendant shows it in base, or drag the target. Then plan."


class MovePanel(PlayedPanel):
    """Plans, plays and copies a motion.

    Attributes:
        target: Returns the frame of the target of the part "Target" in the world (4, 4).
        shown: The last motion that was planned; None before the first.
        q: The posture on the screen [rad].
    """

    target: Callable[[], Floats]

    def build(self) -> None:
        kinematics = ArmKinematics.of(self._setup.arm, base="base")
        self._kinematics = kinematics
        self.shown: ShownMotion | None = None
        self.q: Floats = np.array(kinematics.arm.home)
        self._world: Surroundings | None = None
        scene, figure = self._client.scene, self._setup.figure
        self._arm = SolidArm(scene, f"{self._root}/arm", figure)
        self._shades = Ghosts(scene, f"{self._root}/shades", figure, most=SHADES)
        size = float(np.linalg.norm(kinematics.fk(self.q)[:3, 3]))
        self._gizmo = scene.add_transform_controls(f"{self._root}/goal", scale=0.25 * size, depth_test=False)
        with self._folder:
            self._build_gui()
        self._gizmo.on_update(self._dragged)
        self._surroundings.visible = False
        self._surround(self._setup.arm, ())
        begun = self._setup.motion
        if begun is None:
            self._put_goal(self.target())
            self._draw()
        else:
            self._show_flags(begun)
            self._take(begun)

    @property
    def last(self) -> int:
        """Index of the last frame; -1 without a motion."""
        return -1 if self.shown is None else len(self.shown.times) - 1

    def show(self, visible: bool) -> None:
        with self._lock:
            super().show(visible)
            self._surroundings.visible = not visible

    def choose(self, *, goal: str, boxes: str = "", speed: float | None = None) -> None:
        """Write a goal, boxes, and a speed [%] into their inputs."""
        self._goal.value, self._boxes.value = goal, boxes
        self._speed.value = self._speed.value if speed is None else speed
        self._typed()
        self._surroundings_typed()

    def plan(self) -> None:
        """Plan the motion of the inputs in a thread of its own, then play it unless the part is hidden by then."""
        self.pause()
        try:
            flags = self._asked()
        except KinreachError as error:
            self._verdict.content = html.message(str(error), bad=True)
            return
        self._button.disabled = True
        self._verdict.content = html.message("The motion is being planned, and tried in MuJoCo ...")
        self._start(self._plan, flags)

    def program(self) -> str:
        if self.shown is None:
            return "# Nothing is planned yet.\n"
        return motion_program(self.shown.motion, arm=self._setup.expression)

    def text(self, kind: str) -> str:
        """Return the motion as a command, as Python code or as URScript."""
        if self.shown is None or kind == PYTHON:
            return self.program()
        return self.shown.motion.program.text if kind == URSCRIPT else self.shown.command(self._setup.words)

    def _build_gui(self) -> None:
        gui = self._client.gui
        self._verdict = gui.add_html(html.message(FIRST))
        self._goal = gui.add_text(
            "goal", "", hint="x, y, z [m], rx, ry, rz [rad] of the tool in base, also as p[...]; further goals after ;"
        )
        self._button = gui.add_button("Plan", icon="player-play")
        self._build_player((PLAY, PAUSE, START), {})
        self._slider = gui.add_slider("time [s]", 0.0, 1.0, 1.0 / FPS, 0.0)
        self._chart = gui.add_html("")
        self._bars = gui.add_html("")
        self._remarks = gui.add_html("")
        self._copies = gui.add_button_group("copy as", (COMMAND, PYTHON, URSCRIPT), visible=False)
        with gui.add_folder("How"):
            self._branch = gui.add_dropdown("branch", self._branches())
            self._most = gui.add_number("turn at most [°]", 0.0, min=0.0, max=720.0, step=10.0, hint="0: no bound")
            self._linear = gui.add_checkbox("tool on straight lines", False)
            self._speed = gui.add_slider("speed [%]", 1.0, 100.0, 1.0, 25.0, hint="Of the joints' limits, or of 1 m/s")
            self._blend = gui.add_number("blend [mm]", 0.0, min=0.0, max=2000.0, step=5.0)
            self._shaded = gui.add_checkbox("shade of the way", True)
        with gui.add_folder("Start and goal", expand_by_default=False):
            self._from = gui.add_text("start", "home", hint="Six joint angles [°]; or 6@POSE, a branch at a pose; home")
            here = gui.add_button("Start from the posture shown")
            there = gui.add_button("Take the goal from Target")
        with gui.add_folder("Around the arm", expand_by_default=False):
            self._cell = gui.add_checkbox("table and floor", True, hint="kinreach's, as by default")
            self._table = gui.add_text("table [m]", "", hint="Height of a table's top above the arm's base: 0 or less")
            self._boxes = gui.add_text("boxes", "", hint="X,Y,Z,SX,SY,SZ in base [m]; further boxes after ;")
            self._meshes = gui.add_text(
                "meshes",
                "",
                hint="FILE@X,Y,Z,RX,RY,RZ: STL, OBJ, DAE or GLB, and its pose in base; further ones after ;",
            )
            self._mesh_scale = gui.add_number(
                "mesh scale", 1.0, min=1e-6, max=1000.0, step=0.001, hint="Metres per unit of the files; 0.001 for mm"
            )
        self._button.on_click(lambda _: self.plan())
        here.on_click(lambda _: self._start_here())
        there.on_click(lambda _: self._put_goal(self.target()))
        by_user(self._slider, lambda time: self._scrubbed(round(time * FPS)))
        by_user(self._goal, lambda text: self._typed())
        by_user(self._shaded, lambda on: self._draw_way())
        self._copies.on_click(lambda event: self._copy(event.target.value))
        for entry in (self._cell, self._table, self._boxes, self._meshes, self._mesh_scale):
            by_user(entry, lambda value: self._surroundings_typed())
        moments = tuple(map(str, range(html.MOMENTS + 1)))
        add_unseen(gui, html.MOMENT, moments, lambda at: self._scrubbed(round(self.last * int(at) / html.MOMENTS)))

    def _branches(self) -> tuple[str, ...]:
        kinematics = self._kinematics
        count = kinematics.branches if isinstance(kinematics, ClosedFormKinematics) else 0
        named = [described(kinematics, branch) for branch in range(count)]  # type: ignore[arg-type]
        return (NEAREST, SAME, *named)

    def _asked(self) -> MotionFlags:
        """The inputs as flags of the command line, angles in radians.

        Raises:
            InputError: One of them cannot be read.
        """
        branch, most = self._branch.value, self._most.value
        return MotionFlags(
            tuple(_listed(pose_numbers_of("goal", text, strict=True)) for text in _parts(self._goal.value) or ("",)),
            self._start_words(),
            branch=None if branch == NEAREST else branch.partition(" (")[0],
            max_travel=repr(float(np.radians(most))) if most else None,
            linear=self._linear.value,
            speed=self._speed.value / 100.0,
            blend=self._blend.value / 1000.0,
            **self._around(),
        )

    def _around(self) -> dict[str, Any]:
        """What is typed around the arm, as arguments of `MotionFlags`."""
        return {
            "table": self._table.value.strip() or None, "boxes": _parts(self._boxes.value),
            "meshes": _parts(self._meshes.value), "mesh_scale": self._mesh_scale.value, "cell": self._cell.value,
        }  # fmt: skip

    def _start_words(self) -> str | None:
        text = self._from.value.strip()
        begun = self.shown.flags.start if self.shown is not None else None
        if self.shown is not None and begun is not None and text == self._start_text(self.shown):
            return begun  # to its last bit
        if text in ("", "home"):
            return None
        if "@" in text:
            return text
        limits = (self._kinematics.lower, self._kinematics.upper)
        return _listed(posture_of("start", text, 6, degrees=True, limits=limits).tolist())

    def _start_text(self, shown: ShownMotion) -> str:
        start = shown.flags.start
        return start if start is None or "@" in start else _degrees(shown.motion.start)  # type: ignore[return-value]

    def _show_flags(self, shown: ShownMotion) -> None:
        """Write the flags of a motion into the inputs."""
        flags = shown.flags
        self._goal.value = f"{NEXT} ".join(flags.to)
        self._from.value = self._start_text(shown) or "home"
        branch = flags.branch
        if branch is not None:
            named = [name for name in self._branches() if name == branch or name.partition(" (")[0] == branch]
            if not named:
                self._branch.options = (*self._branches(), branch)
            self._branch.value = named[0] if named else branch
        most = flags.most_turn
        self._most.value = 0.0 if most is None else round(float(np.degrees(most)), ANGLE_DIGITS)
        self._linear.value, self._speed.value, self._blend.value = flags.linear, 100.0 * flags.speed, 1e3 * flags.blend
        self._table.value, self._boxes.value, self._cell.value = flags.table or "", NEXT.join(flags.boxes), flags.cell
        self._meshes.value, self._mesh_scale.value = NEXT.join(flags.meshes), flags.mesh_scale

    def _plan(self, flags: MotionFlags) -> None:
        arm = flags.surrounded(self._setup.arm)
        planner = flags.planner(arm)
        motion = planner.tried(flags.posture(planner.kinematics))
        motion.check_finished()
        with self._lock:
            if self._gone.is_set():
                return
            self._take(ShownMotion(flags, motion))
            if self._shown:
                self.run()

    def _take(self, shown: ShownMotion) -> None:
        self.pause()
        self.shown, self.at = shown, 0
        self._slider.max = float(np.ceil(shown.times[-1] * FPS) / FPS)
        self._say_verdict(shown)
        sends = ["The terminal asks before it sends this motion; nothing is sent from here."] if shown.sends else []
        self._remarks.content = html.remarks([*shown.remarks, *sends])
        self._chart.content = html.chart(*shown.speeds)
        self._copies.visible = True
        self._button.disabled = False
        self._surround(shown.arm, shown.motion.meshes)
        put(self._gizmo, self._kinematics.T_world_base @ shown.motion.goals[-1])
        self._draw_way()
        self._draw()

    def _say_verdict(self, shown: ShownMotion, *, changed: bool = False) -> None:
        text, caution = (CHANGED, True) if changed else (shown.verdict, bool(shown.motion.cautions))
        self._verdict.content = html.message(text, caution=caution)

    def _surround(self, arm: ArmDescription, meshes: Sequence[Obstacle]) -> None:
        """Draw what is around an arm.

        Raises:
            InputError: A mesh cannot be read.
        """
        for each in meshes:
            mesh_in_metres(str(each.shape), each.scale)
        if self._world is not None:
            self._world.remove()
        scene, root = self._client.scene, f"{self._root}/world"
        self._world = Surroundings(scene, arm.workcell.obstacles, meshes=meshes, root=root)

    def _draw_way(self) -> None:
        """Draw the arm along its way, and the ways of its tip and elbow."""
        with self._lock:
            on = self.shown is not None and self._shaded.value
            self._shades.visible = on
            if self.shown is None:
                return
            ghosts = [Ghost(q, BLUE, opacity=OPACITY) for q in self.shown.along(SHADES)]
            self._shades.take(ghosts, beside=None)
            for name, points, colour in zip(("tip", "elbow"), self.shown.ways(), (VIOLET, BLUE), strict=True):
                self._line(f"{self._root}/shades/way_of_the_{name}", points, colour)

    def _line(self, name: str, points: Floats, colour: Colour) -> None:
        segments = np.stack([points[:-1], points[1:]], axis=1)
        self._client.scene.add_line_segments(name, segments, colour, thickness=3.0, thickness_units="screen")

    def _draw(self) -> None:
        if self.shown is None:
            self._arm.take(self.q)
            return
        shown, motion = self.shown, self.shown.motion
        self.q = shown.q[self.at]
        with self._client.atomic():
            self._arm.take(self.q)
        self._slider.value = float(shown.times[self.at])
        limits = motion.kinematics.velocity_limit
        moment = float(shown.times[self.at] / shown.times[-1])
        self._bars.content = html.speeds(shown.arm.joints, shown.shares[self.at], motion.shares, limits, moment=moment)

    def _pause_after(self, index: int) -> float:
        return 1.0 / FPS

    def _dragged(self, event: Any) -> None:
        if event.client is not None:
            self._latest(lambda: self._put_goal(frame_of(self._gizmo), drag=True))

    def _put_goal(self, T: Floats, *, drag: bool = False) -> None:
        """Write a frame in the world (4, 4) as the goal."""
        six = pose_vector(np.linalg.inv(self._kinematics.T_world_base) @ T).round(POSE_DIGITS) + 0.0
        self._goal.value = ", ".join(f"{value:g}" for value in six.tolist())
        if not drag:
            put(self._gizmo, T)

    def _typed(self) -> None:
        """Put the arrows to the last goal that is typed, once it is a pose."""
        try:
            T = pose(pose_numbers_of("goal", _parts(self._goal.value)[-1], strict=True))
        except (KinreachError, IndexError):
            return
        with self._lock:
            put(self._gizmo, self._kinematics.T_world_base @ T)

    def _surroundings_typed(self) -> None:
        """Draw what is around the arm as it is typed, once it can be read."""
        flags = MotionFlags((), **self._around())
        with self._lock, suppress(KinreachError):
            arm = flags.surrounded(self._setup.arm)
            meshes = flags.obstacles(arm)
            self._surround(arm, meshes)
            if (shown := self.shown) is not None:
                same = arm.workcell == shown.arm.workcell and meshes == list(shown.motion.meshes)
                self._say_verdict(shown, changed=not same)

    def _start_here(self) -> None:
        self._from.value = _degrees(self.q)

    def _copy(self, kind: str) -> None:
        gui = self._client.gui
        with gui.add_modal(f"This motion as {kind}") as modal:
            gui.add_html(html.code(self.text(kind)))
            close = gui.add_button("Close")
        close.on_click(lambda _: modal.close())


def _parts(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(NEXT) if part.strip())


def _listed(numbers: list[float]) -> str:
    return ",".join(map(repr, numbers))


def _degrees(q: Floats) -> str:
    return ", ".join(f"{value:g}" for value in (np.degrees(q).round(ANGLE_DIGITS) + 0.0).tolist())
