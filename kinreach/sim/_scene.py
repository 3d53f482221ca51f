"""An arm in its work cell as a MuJoCo model, made from the same URDF that feeds Pinocchio and placo.

Bodies carry the names of the URDF's links, so that every frame of the URDF is a body; obstacles are bodies of their
own, named as their `Box`. The ball marks a goal: it is a mocap body without contact. Positions are held by servos
with gravity compensation, as in the controller of a real UR5; without it shoulder_lift stands 0.013 rad low.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import copy, deepcopy
from functools import lru_cache
from typing import Any

import numpy as np

from kinreach._checks import check_number
from kinreach.errors import InputError
from kinreach.kinematics.inside import check_shapes, disabled_pairs
from kinreach.robots import ArmDescription
from kinreach.robots.inside import JawGripper, collision_mesh, followers
from kinreach.sim._engine import mujoco
from kinreach.sim._free_objects import add_free_objects
from kinreach.sim._imperfections import IDEAL, PAYLOAD, Imperfections
from kinreach.sim._movable_boxes import add_movable_boxes
from kinreach.sim._visuals import DRAWN_ONLY, HIDDEN_GROUP, add_camera, add_visual_meshes, add_visuals

#: Step of the simulation [s]. From 0.002 on, 400 of 400 random targets get the same verdict; at 0.01 an arm that runs
#: into the table sinks in by the table's thickness, at 0.008 by half of it.
TIMESTEP = 0.008
BALL = "ball"
BALL_GROUP = 1  # of its own, so that it can be drawn alone
BALL_COLOUR = (0.86, 0.04, 0.03, 1.0)
#: Stiffness of a finger's drive [N/m]: full force 12 mm from where it wants to be.
GRIPPER_GAIN = 10_000.0
#: Angles, or places, of the first joint at which it is tried what the first link touches.
ANGLES = 361
#: MuJoCo's `solimp` of joints that follow others: how little they yield.
COUPLING = [0.999, 0.9999, 0.001, 0.5, 2.0]
#: Rotor inertia of the gripper's drive seen at a finger [kg].
GRIPPER_ARMATURE = 0.1
#: A jaw that turns presses with its whole torque when it is held off by this [rad].
JAW_YIELD = 0.1


def build_scene(
    arm: ArmDescription,
    *,
    timestep: float = TIMESTEP,
    visual: bool = True,
    imperfections: Imperfections = IDEAL,
    objects: int = 0,
    boxes: int = 0,
) -> Any:
    """Return the scene of an arm, a `mujoco.MjSpec`, ready to compile or to edit further.

    With `visual` it draws the links by the URDF's visual meshes or the figures of UR models, the table's legs and
    camera housings, without mass or contact; otherwise links by their collision shapes, which is faster. With one of
    `objects`, free ones (`kinreach.sim._free_objects`), the ball that marks a goal is hidden. `boxes` can be put
    elsewhere (`kinreach.sim._movable_boxes`).

    Raises:
        InputError: An unusable or missing mesh, or an arm that MuJoCo refuses.
    """
    check_shapes(arm)
    with _refusals_of(arm):
        spec = _import_urdf(arm)
        spec.option.timestep = timestep
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        _drive_joints(spec, arm)
        _drive_gripper(spec, arm)
        _couple_joints(spec, arm)
        _spoil(spec, arm, imperfections)
        _add_workcell(spec, arm, marker=objects == 0)
        _exclude_out_of_reach(spec, arm)
        for frame in arm.tips.values():
            spec.body(frame).add_site(name=frame, group=HIDDEN_GROUP)
        for camera in arm.cameras:
            add_camera(spec, camera, housing=visual)
        if visual:
            add_visual_meshes(spec, arm)
        add_visuals(spec, arm.workcell.obstacles, visual=visual)
        add_free_objects(spec, objects, spec.body(BALL).pos)
        add_movable_boxes(spec, boxes)
        _add_home(spec, arm)
    return spec


def check_timestep(timestep: object) -> None:
    """Check a timestep: with a shorter one simulation is too slow, with a longer one contacts are lost."""
    check_number("timestep", timestep, least=1e-5, most=0.02)


@contextmanager
def _refusals_of(arm: ArmDescription) -> Iterator[None]:
    try:
        yield
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"MuJoCo cannot make a scene of arm {arm.name!r}: {' '.join(str(error).split())}") from None


def scene_model(arm: ArmDescription, **options: Any) -> Any:
    """Return a compiled scene (`mujoco.MjModel`) that nobody else has, so that it may be changed.

    A scene is compiled once and copied. Arguments and errors are those of `build_scene`.
    """
    return copy(_compiled(arm, **options))


@lru_cache(maxsize=16)
def _compiled(arm: ArmDescription, **options: Any) -> Any:
    with _refusals_of(arm):
        return build_scene(arm, **options).compile()


def _import_urdf(arm: ArmDescription) -> Any:
    robot = deepcopy(arm.robot)
    for link in robot.iter("link"):
        for visual in link.findall("visual"):
            if visual.find("geometry/mesh") is not None:  # of the others the importer takes the colour
                link.remove(visual)
    spec = mujoco.MjSpec.from_string(ET.tostring(robot, encoding="unicode"))
    for mesh in spec.meshes:
        vertices, faces = collision_mesh(mesh.file, arm.package_root(), mesh.scale)
        mesh.file, mesh.uservert, mesh.userface = "", vertices.ravel(), faces.ravel()
    spec.compiler.fusestatic = False  # otherwise tool0, tcp and base_link are not bodies
    spec.compiler.balanceinertia = True  # some files have inertias that no body has
    spec.compiler.discardvisual = False  # otherwise shapes without contact, such as the ball, are dropped
    for body in spec.bodies[1:]:
        body.gravcomp = 1.0
    return spec


def _drive_joints(spec: Any, arm: ArmDescription) -> None:
    for index, name in enumerate(arm.joints):
        joint = spec.joint(name)
        joint.armature = arm.armature
        joint.damping[0] = arm.joint_damping[index]
        _add_servo(spec, joint, arm.position_gains[index])


def _drive_gripper(spec: Any, arm: ArmDescription) -> None:
    """Two servos, to be given the same setpoint, stand for the one drive of both fingers; a jaw has one.

    The importer's equality for the URDF's `mimic` goes: as the only constraint of an arm that touches nothing it would
    keep the solver busy in every step, for a seventh of its time.
    """
    for equality in list(spec.equalities):
        spec.delete(equality)
    if arm.gripper is None:
        return
    gain, armature = GRIPPER_GAIN, GRIPPER_ARMATURE
    if isinstance(arm.gripper, JawGripper):
        gain, armature = arm.gripper.torque / JAW_YIELD, arm.armature
    for name in arm.gripper.joints:
        spec.joint(name).armature = armature
        _add_servo(spec, spec.joint(name), gain)


def _couple_joints(spec: Any, arm: ArmDescription) -> None:
    """Constraints that bring joints to where those that they follow have them, as stiff as the timestep allows."""
    for name, how in followers(arm).items():
        coupling = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1=name, name2=how.joint, solimp=COUPLING)
        coupling.data[:5] = how.offset, how.factor, 0.0, 0.0, 0.0
        coupling.solref[0] = 2.0 * spec.option.timestep


def _add_servo(spec: Any, joint: Any, gain: float) -> None:
    """Critically damped position servo; its torque is limited by the joint's `actfrcrange`, the URDF's effort."""
    joint.actgravcomp = True
    servo = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    servo.set_to_position(kp=gain, dampratio=1.0)


def _spoil(spec: Any, arm: ArmDescription, imperfections: Imperfections) -> None:
    """Friction and damping of the joints, and a mass at the tip that gravity compensation ignores."""
    for name in arm.joints:
        joint = spec.joint(name)
        effort = float(joint.actfrcrange[1])
        joint.frictionloss = imperfections.friction * effort
        joint.damping[0] += imperfections.damping * effort
    if imperfections.payload > 0:
        load = spec.body(arm.tips[arm.default_tip]).add_body(name=PAYLOAD, gravcomp=0.0)
        load.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[0.02, 0, 0],
            **{**DRAWN_ONLY, "mass": imperfections.payload, "group": HIDDEN_GROUP},
        )


def _add_workcell(spec: Any, arm: ArmDescription, *, marker: bool) -> None:
    cell = arm.workcell
    for box in cell.obstacles:
        # A body each, so that a link that stands on one obstacle can be excused from touching just that one.
        body = spec.worldbody.add_body(name=box.name, pos=box.position)
        body.add_geom(name=box.name, type=mujoco.mjtGeom.mjGEOM_BOX, size=[edge / 2 for edge in box.size])
        # With a second shape in the body, MuJoCo compares oriented bounding boxes before it searches for the contact
        # itself, and so drops almost all pairs; between bodies of one shape it compares bounding spheres only.
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[min(box.size) / 4, 0, 0], **{**DRAWN_ONLY, "group": HIDDEN_GROUP}
        )
    for one, other in (*disabled_pairs(arm), *cell.touching):
        spec.add_exclude(bodyname1=one, bodyname2=other)
    # Any goal will do until the first `place_ball`.
    place = np.zeros(3) if cell.goals is None else cell.goals.sample(np.random.default_rng(0), 1)[0]
    ball = spec.worldbody.add_body(name=BALL, mocap=True, pos=place)
    ball.add_geom(
        name=BALL,
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[cell.ball_radius, 0, 0],
        rgba=BALL_COLOUR,
        group=BALL_GROUP if marker else HIDDEN_GROUP,
        contype=0,
        conaffinity=0,
    )


def _exclude_out_of_reach(spec: Any, arm: ArmDescription) -> None:
    """Spare MuJoCo the obstacles that the first link cannot touch anywhere: a tenth of the time of every step.

    That link is so near to what carries the arm that nothing but the search for a contact itself tells them apart.
    """
    model = spec.compile()
    data = mujoco.MjData(model)
    joint = model.joint(arm.joints[0])
    link = model.body(model.jnt_bodyid[joint.id])
    low, high = joint.range if model.jnt_limited[joint.id] else (-np.pi, np.pi)
    slides = joint.type[0] == mujoco.mjtJoint.mjJNT_SLIDE
    step = (high - low) / (ANGLES - 1)
    for geom in range(link.geomadr[0], link.geomadr[0] + link.geomnum[0]):
        # Between two places of the joint no point of the shape moves further.
        arm_of = 1.0 if slides else model.geom_rbound[geom] + np.linalg.norm(model.geom_pos[geom])
        model.geom_margin[geom] = step * arm_of
    touched = {name for pair in arm.workcell.touching for name in pair if link.name in pair}
    for angle in np.linspace(low, high, ANGLES):
        data.qpos[joint.qposadr] = angle
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        touched.update(model.body(body).name for body in model.geom_bodyid[data.contact.geom.ravel()])
    for box in arm.workcell.obstacles:
        if box.name not in touched:
            spec.add_exclude(bodyname1=box.name, bodyname2=link.name)


def _add_home(spec: Any, arm: ArmDescription) -> None:
    position = {**dict(zip(arm.joints, arm.home, strict=True)), **arm.locked_joints}
    position |= {name: how.factor * position[how.joint] + how.offset for name, how in followers(arm).items()}
    spec.add_key(
        name="home",
        qpos=[number for joint in spec.joints for number in _at_home(joint, position)],
        ctrl=[position[actuator.target] for actuator in spec.actuators],
    )


def _at_home(joint: Any, position: Mapping[str, float]) -> Sequence[float]:
    """The numbers of a joint in the start posture; a free object's are its place and an upright quaternion."""
    if joint.type == mujoco.mjtJoint.mjJNT_FREE:
        return (*joint.parent.pos, 1.0, 0.0, 0.0, 0.0)
    return (position[joint.name],)
