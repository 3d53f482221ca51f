"""Arms under torque: one simulation, or a native batch of them, behind the same arrays."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Collection
from copy import copy
from enum import IntEnum
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach.envs._button.button_task import CONTROL_LIMIT, Actuation
from kinreach.robots import ArmDescription, CameraMount
from kinreach.sim.inside import (
    BALL,
    CAMERA,
    DRAWN_ONLY,
    IDEAL,
    BatchPlant,
    DrawnArms,
    Imperfections,
    SinglePlant,
    add_camera,
    build_scene,
    mujoco,
    scene_of,
)

Ids = NDArray[np.intp]
Flags = NDArray[np.bool_]

#: Targets are in the four diagonal directions; the arm's own overview has two of them behind the arm.
OVERVIEW = CameraMount(CAMERA, "world", (2.35, -0.35, 1.35), (0.0, 0.0, 0.46), fovy=37.0)
FLOOR = "floor"
STAND = "button"
_GREY, _POST = (0.25, 0.27, 0.30, 1.0), (0.55, 0.57, 0.60, 1.0)
#: Radius and height of the button's housing and of its cap [m].
HOUSING, CAP = (0.050, 0.024), (0.036, 0.020)
#: How far a pressed cap sinks in [m].
TRAVEL = 0.010
#: Where what is not shown is put [m]: deep below the floor.
AWAY = (0.0, 0.0, -20.0)


class ButtonState(IntEnum):
    IDLE = 0
    #: A press away from the target.
    WRONG = 1
    PRESSED = 2


def build_torque_scene(
    arm: ArmDescription, actuation: Actuation, *, visual: bool = True, imperfections: Imperfections = IDEAL
) -> Any:
    """Return the scene (`mujoco.MjSpec`) of an arm whose joints are driven by torque, with gravity.

    If `visual`, it looks good, and has the button. None of that has mass or contact: the physics is the same. Of the
    imperfections it has the payload.
    """
    spec = build_scene(arm, timestep=actuation.timestep, visual=visual, imperfections=imperfections)
    # Without this MuJoCo restarts a simulation that diverges.
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    for servo in list(spec.actuators):
        spec.delete(servo)
    for body in spec.bodies[1:]:
        body.gravcomp = 0.0
    for index, name in enumerate(arm.joints):
        joint = spec.joint(name)
        joint.actgravcomp = False
        joint.armature = actuation.armature[index]
        joint.damping[0] = actuation.damping[index]
        if not actuation.effort_limits:
            joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
        motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.set_to_motor()
        motor.gear[0] = actuation.gears[index]
        motor.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
        motor.ctrlrange = (-CONTROL_LIMIT, CONTROL_LIMIT)
    if actuation.endless:
        spec.joint(arm.joints[0]).limited = mujoco.mjtLimited.mjLIMITED_FALSE
    _flatten_floor(spec, arm)
    spec.delete(spec.camera(CAMERA))
    add_camera(spec, OVERVIEW, housing=False)
    if visual:
        _draw_button(spec)
    return spec


def torque_model(
    arm: ArmDescription, actuation: Actuation, *, visual: bool = True, imperfections: Imperfections = IDEAL
) -> Any:
    """Return the compiled scene (`mujoco.MjModel`), one that nobody else has."""
    return copy(_compiled(arm, actuation, visual=visual, imperfections=imperfections))


@lru_cache(maxsize=8)
def _compiled(arm: ArmDescription, actuation: Actuation, *, visual: bool, imperfections: Imperfections) -> Any:
    return build_torque_scene(arm, actuation, visual=visual, imperfections=imperfections).compile()


class ButtonDrawing:
    """Puts the ball to the target, and the button below it in one of its states, where the scene has one."""

    def __init__(self, model: Any) -> None:
        bodies = {model.body(i).name: int(model.body_mocapid[i]) for i in range(model.nbody)}
        self._ball = bodies[BALL]
        self._stand = bodies.get(STAND)
        self._caps = {state: bodies[_cap_name(state)] for state in ButtonState if _cap_name(state) in bodies}

    def show(self, mocap_pos: Floats, target: Floats, state: ButtonState) -> None:
        """Write places into MuJoCo's array of them, shape (nmocap, 3), for a target in the world [m]."""
        mocap_pos[self._ball] = target
        if self._stand is not None:
            mocap_pos[self._stand] = target
        for shown, cap in self._caps.items():
            mocap_pos[cap] = target if shown is state else AWAY


def _flatten_floor(spec: Any, arm: ArmDescription) -> None:
    """Let the arm fall on a plane instead of a box of the same height: steps under random actions are 1/5 faster."""
    (box,) = (box for box in arm.workcell.obstacles if box.name == FLOOR)
    floor = spec.geom(FLOOR)
    floor.type = mujoco.mjtGeom.mjGEOM_PLANE
    floor.size, floor.pos = (box.size[0] / 2, box.size[1] / 2, box.size[2]), (0, 0, box.size[2] / 2)


def _draw_button(spec: Any) -> None:
    """A stand with a housing, and one cap for each state; all in the frame of the target."""
    shapes = mujoco.mjtGeom
    ball = spec.geom(BALL).size[0]
    top = -ball - CAP[1]  # of the housing: the ball rests on the cap
    stand = spec.worldbody.add_body(name=STAND, mocap=True, pos=AWAY)
    stand.add_geom(
        type=shapes.mjGEOM_CYLINDER,
        size=(HOUSING[0], HOUSING[1] / 2, 0),
        pos=(0, 0, top - HOUSING[1] / 2),
        rgba=_GREY,
        **DRAWN_ONLY,
    )
    # Long enough for the highest target; the rest is below the floor.
    stand.add_geom(type=shapes.mjGEOM_CYLINDER, size=(0.007, 0.6, 0), pos=(0, 0, top - 0.6), rgba=_POST, **DRAWN_ONLY)
    caps = {
        ButtonState.IDLE: (0.95, 0.94, 0.90, 1.0),
        ButtonState.WRONG: (0.97, 0.66, 0.08, 1.0),
        ButtonState.PRESSED: (0.10, 0.72, 0.25, 1.0),
    }
    for state, colour in caps.items():
        sunk = 0.0 if state is ButtonState.IDLE else TRAVEL
        cap = spec.worldbody.add_body(name=_cap_name(state), mocap=True, pos=AWAY)
        cap.add_geom(
            type=shapes.mjGEOM_CYLINDER,
            size=(CAP[0], CAP[1] / 2, 0),
            pos=(0, 0, top + CAP[1] / 2 - sunk),
            rgba=colour,
            **DRAWN_ONLY,
        )


def _cap_name(state: ButtonState) -> str:
    return f"{STAND}_{state.name.lower()}"


class TorqueWorld(Protocol):
    """A number of equal arms; row i of every array belongs to arm i, in the world frame.

    Attributes:
        q, qd: Joint angles [rad] and velocities [rad/s], shape (count, 3); live.
        tip: Positions of the end effector [m], shape (count, 3); live.
        drawn: Writes drawn properties of the arms; None where none is drawn.
    """

    count: int
    q: Floats
    qd: Floats
    tip: Floats
    drawn: DrawnArms | None

    def reset(self, ids: Ids, targets: Floats, q: Floats, qd: Floats) -> None:
        """Put whole states back: arms without torque, in given states, all of shape (k, 3)."""
        ...

    def step(self, control: Floats, acting: Flags | None = None) -> None:
        """Simulate one step of the environment under controls, shape (count, 3), of all arms or of those that act."""
        ...

    def show(self, state: ButtonState) -> None: ...


class SingleTorqueWorld:
    """One arm under torque; a `kinreach.sim._picture.Scene`. If `visual`, it looks good, with the button.

    Attributes:
        watch: Called after every step, when the button's state is set.
    """

    count = 1

    def __init__(self, arm: ArmDescription, actuation: Actuation, *, visual: bool, drawn: Collection[str] = ()) -> None:
        self.model: Any = torque_model(arm, actuation, visual=visual, imperfections=scene_of(IDEAL, drawn))
        self.data: Any = mujoco.MjData(self.model)
        self.drawn = DrawnArms(SinglePlant(self.model, self.data), self.model, arm.joints, 1) if drawn else None
        self.watch: Callable[[], object] | None = None
        self._frame_skip = actuation.frame_skip
        self._drawing = ButtonDrawing(self.model)
        self._target: Floats = np.zeros(3)
        tip = self.model.body(arm.tips[arm.default_tip]).id
        self.q: Floats = self.data.qpos[None]
        self.qd: Floats = self.data.qvel[None]
        self.tip: Floats = self.data.xpos[None, tip]

    def reset(self, ids: Ids, targets: Floats, q: Floats, qd: Floats) -> None:
        mujoco.mj_resetDataKeyframe(self.model, self.data, self.model.key("home").id)
        self.q[:], self.qd[:] = q, qd
        self._target = targets[0].copy()
        self._drawing.show(self.data.mocap_pos, self._target, ButtonState.IDLE)
        mujoco.mj_fwdPosition(self.model, self.data)

    def step(self, control: Floats, acting: Flags | None = None) -> None:
        self.data.ctrl[:] = control[0]
        mujoco.mj_step(self.model, self.data, self._frame_skip)
        mujoco.mj_kinematics(self.model, self.data)  # after a step the poses are those before its last substep

    def show(self, state: ButtonState) -> None:
        self._drawing.show(self.data.mocap_pos, self._target, state)
        if self.watch is not None:
            self.watch()


class BatchTorqueWorld:
    """Many arms under torque, bit for bit what as many `SingleTorqueWorld` would do."""

    def __init__(
        self, arm: ArmDescription, actuation: Actuation, count: int, *, threads: int = 1, drawn: Collection[str] = ()
    ) -> None:
        self.count = count
        model = torque_model(arm, actuation, visual=False, imperfections=scene_of(IDEAL, drawn))
        self._batch: Any = importlib.import_module("mujoco.batch").Batch(model, count, threads)
        self.drawn = DrawnArms(BatchPlant(model, self._batch), model, arm.joints, count) if drawn else None
        self._frame_skip = actuation.frame_skip
        self._home = model.key("home").id
        self._drawing = ButtonDrawing(model)
        self.q: Floats = self._batch.bind("qpos")
        self.qd: Floats = self._batch.bind("qvel")
        self.tip: Floats = self._batch.bind("xpos")[:, model.body(arm.tips[arm.default_tip]).id]
        self._ctrl: Floats = self._batch.bind("ctrl")
        self._mocap: Floats = self._batch.bind("mocap_pos")

    def reset(self, ids: Ids, targets: Floats, q: Floats, qd: Floats) -> None:
        stages = mujoco.mjtStage
        self._batch.reset(ids=ids, keyframe=self._home, stage=stages.mjSTAGE_NONE)
        self.q[ids], self.qd[ids] = q, qd
        for index, target in zip(ids, targets, strict=True):
            self._drawing.show(self._mocap[index], target, ButtonState.IDLE)
        self._batch.forward(ids=ids, stage=stages.mjSTAGE_POS)

    def step(self, control: Floats, acting: Flags | None = None) -> None:
        self._ctrl[:] = control
        ids = None if acting is None else np.flatnonzero(acting)
        self._batch.step(ids=ids, nstep=self._frame_skip, stage=mujoco.mjtStage.mjSTAGE_POS)

    def show(self, state: ButtonState) -> None:
        """Do nothing: a batch is not drawn."""
