"""The 3-DOF arm under torque as a MuJoCo model, and the button that is drawn below the target."""

from __future__ import annotations

from enum import IntEnum
from functools import lru_cache
from typing import Any

import numpy as np

from kinreach.envs.button.actuation import Actuation
from kinreach.envs.button.task import CONTROL_LIMIT
from kinreach.envs.cameras import add_camera
from kinreach.envs.engine import mujoco
from kinreach.envs.looks import DRAWN_ONLY
from kinreach.envs.picture import CAMERA
from kinreach.envs.scene import BALL, build_scene
from kinreach.kinematics.goals import Floats
from kinreach.robots import ArmDescription, CameraMount

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
    """What the button shows."""

    IDLE = 0
    #: A press away from the target.
    WRONG = 1
    PRESSED = 2


_CAPS = {
    ButtonState.IDLE: (0.95, 0.94, 0.90, 1.0),
    ButtonState.WRONG: (0.97, 0.66, 0.08, 1.0),
    ButtonState.PRESSED: (0.10, 0.72, 0.25, 1.0),
}


def build_torque_scene(arm: ArmDescription, actuation: Actuation, *, visual: bool = True) -> Any:
    """The scene of an arm whose joints are driven by torque, with gravity, ready to compile.

    Args:
        arm: The arm and its work cell.
        actuation: Motors, friction and time.
        visual: Make it look good, and draw the button. None of it has mass or contact: the physics is the same.

    Returns:
        A `mujoco.MjSpec`.
    """
    spec = build_scene(arm, timestep=actuation.timestep, visual=visual)
    # A simulation that diverges is to show it, and not to start afresh behind our back.
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    for servo in list(spec.actuators):
        spec.delete(servo)
    for body in spec.bodies[1:]:
        body.gravcomp = 0.0
    for index, name in enumerate(arm.joints):
        joint = spec.joint(name)
        joint.actgravcomp = False
        joint.armature = actuation.armature
        joint.damping[0] = actuation.damping[index]
        if not actuation.effort_limits:
            joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
        motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.set_to_motor()
        motor.gear[0] = actuation.gears[index]
        motor.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
        motor.ctrlrange = (-CONTROL_LIMIT, CONTROL_LIMIT)
    _flatten_floor(spec, arm)
    spec.key("home").ctrl = np.zeros(len(arm.joints))
    spec.delete(spec.camera(CAMERA))
    add_camera(spec, OVERVIEW, housing=False)
    if visual:
        _draw_button(spec)
    return spec


@lru_cache(maxsize=8)
def torque_model(arm: ArmDescription, actuation: Actuation, *, visual: bool = True) -> Any:
    """The compiled scene (`mujoco.MjModel`), shared by all who ask for the same one: do not change it."""
    return build_torque_scene(arm, actuation, visual=visual).compile()


class ButtonDrawing:
    """Puts the ball to the target, and the button below it in one of its states.

    Args:
        model: A scene of `build_torque_scene`; without the good looks there is only the ball.
    """

    def __init__(self, model: Any) -> None:
        bodies = {model.body(i).name: int(model.body_mocapid[i]) for i in range(model.nbody)}
        self._ball = bodies[BALL]
        self._stand = bodies.get(STAND)
        self._caps = {state: bodies[_cap_name(state)] for state in ButtonState if _cap_name(state) in bodies}

    def show(self, mocap_pos: Floats, target: Floats, state: ButtonState) -> None:
        """Write places into MuJoCo's array of them.

        Args:
            mocap_pos: Shape (nmocap, 3).
            target: In the world [m], shape (3,).
            state: What the button shows.
        """
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
    for state, colour in _CAPS.items():
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
