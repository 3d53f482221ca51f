"""An arm in its work cell as a MuJoCo model, made from the same URDF that feeds Pinocchio and placo.

Bodies carry the names of the URDF's links, so that every frame of the URDF is a body; obstacles are bodies of their
own, named as their `Box`. The ball marks a goal: it is a mocap body without contact. Positions are held by servos
with gravity compensation, as in the controller of a real UR5; without it shoulder_lift stands 0.013 rad low.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache
from typing import Any

import numpy as np

from kinreach.checks import Floats, check_number
from kinreach.errors import InputError, InstallationError
from kinreach.kinematics.collision import disabled_pairs
from kinreach.robots import ArmDescription, Box, CameraMount
from kinreach.sim.engine import mujoco

#: Geoms of this group are not drawn by default.
HIDDEN_GROUP = 3
#: What makes a geom a drawing: no mass, no contact.
DRAWN_ONLY: Mapping[str, Any] = {"group": 2, "contype": 0, "conaffinity": 0, "mass": 0.0}
_LEG = 0.05  # edge of a table leg [m]
_DEFAULT_LOOK = "metal"
#: Colour, shininess and reflectance of the materials; obstacles of these names wear them, all others are metal.
_MATERIALS = {
    "floor": ((0.80, 0.82, 0.85, 1.0), 0.1, 0.03),
    "table": ((0.78, 0.71, 0.60, 1.0), 0.1, 0.0),
    "metal": ((0.36, 0.38, 0.42, 1.0), 0.5, 0.0),
}


def add_looks(spec: Any, boxes: Sequence[Box], *, visual: bool) -> None:
    """Sky, lights, materials of the obstacles and picture quality.

    With `visual` also what is only drawn, table legs and a floor without end, and smooth edges. Without, a frame takes
    a tenth of the time (5 ms instead of 55 ms at 320x180, in software, no shadows): right for cameras that measure.
    """
    _add_light(spec)
    _add_materials(spec)
    for box in boxes:
        spec.geom(box.name).material = box.name if box.name in _MATERIALS else _DEFAULT_LOOK
        if visual and box.name == "floor":
            _draw_endless(spec, box)
        if visual and box.legs > 0:
            _draw_legs(spec, box)
    spec.visual.quality.shadowsize = 4096
    spec.visual.quality.offsamples = 4 if visual else 0
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1920, 1080
    # Depth resolution and shadows are scaled by these; fixed, they do not depend on how large the floor is.
    spec.stat.extent = 1.5
    spec.stat.center = (0.2, 0.0, 0.0)
    spec.visual.map.znear, spec.visual.map.zfar = 0.01, 20.0
    spec.visual.map.shadowclip = 1.6


def _add_light(spec: Any) -> None:
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=(0.95, 0.96, 0.97),
        rgb2=(0.60, 0.68, 0.77),
        width=512,
        height=512,
    )
    lamps = mujoco.mjtLightType
    spec.worldbody.add_light(
        name="key", type=lamps.mjLIGHT_DIRECTIONAL, pos=(1.0, -1.5, 3.0), dir=(-0.35, 0.5, -1.0),
        diffuse=(0.58, 0.56, 0.53), specular=(0.2, 0.2, 0.2), ambient=(0, 0, 0), castshadow=True,
    )  # fmt: skip
    spec.worldbody.add_light(
        name="fill", type=lamps.mjLIGHT_DIRECTIONAL, pos=(-1.5, -1.0, 2.5), dir=(0.8, 0.4, -0.8),
        diffuse=(0.16, 0.18, 0.21), specular=(0, 0, 0), ambient=(0, 0, 0), castshadow=False,
    )  # fmt: skip
    head = spec.visual.headlight
    head.ambient, head.diffuse, head.specular = (0.36, 0.37, 0.39), (0.12, 0.12, 0.12), (0.0, 0.0, 0.0)
    spec.visual.rgba.haze = (0.86, 0.89, 0.92, 1.0)


def _add_materials(spec: Any) -> None:
    spec.add_texture(
        name="tiles", type=mujoco.mjtTexture.mjTEXTURE_2D, builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        mark=mujoco.mjtMark.mjMARK_EDGE, rgb1=(0.97, 0.97, 0.97), rgb2=(0.97, 0.97, 0.97), markrgb=(0.72, 0.74, 0.77),
        width=256, height=256,
    )  # fmt: skip
    for name, (rgba, shininess, reflectance) in _MATERIALS.items():
        spec.add_material(name=name, rgba=rgba, shininess=shininess, specular=0.3, reflectance=reflectance)
    floor = spec.material("floor")
    floor.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "tiles"
    floor.texuniform, floor.texrepeat = True, (2, 2)


def _draw_endless(spec: Any, box: Box) -> None:
    """Draw a floor to the horizon in place of the box that ends in the middle of the picture."""
    spec.geom(box.name).group = HIDDEN_GROUP
    spec.body(box.name).add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE, size=(0, 0, 1), pos=(0, 0, box.size[2] / 2), material="floor", **DRAWN_ONLY
    )


def _draw_legs(spec: Any, box: Box) -> None:
    x, y, z = np.array(box.size) / 2
    for sx in (-1, 1):
        for sy in (-1, 1):
            spec.body(box.name).add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX,
                size=(_LEG / 2, _LEG / 2, box.legs / 2),
                pos=(sx * (x - _LEG), sy * (y - _LEG), -z - box.legs / 2),
                material=_DEFAULT_LOOK,
                **DRAWN_ONLY,
            )


#: Width, height and depth of the housing that is drawn behind the lens [m], about those of a RealSense D435.
HOUSING = (0.09, 0.025, 0.025)
_GREY, _BLACK = (0.72, 0.73, 0.75, 1.0), (0.03, 0.03, 0.04, 1.0)


def camera_rotation(mount: CameraMount) -> Floats:
    """Orientation of a camera in its link's frame, shape (3, 3).

    Columns are the picture's right, its up, and the direction from the target to the camera (OpenGL's convention).
    """
    back = np.subtract(mount.position, mount.target)
    back = back / np.linalg.norm(back)
    right = np.cross(mount.up, back)
    right /= np.linalg.norm(right)
    return np.column_stack([right, np.cross(back, right), back])


def add_camera(spec: Any, mount: CameraMount, *, housing: bool) -> None:
    """Add a camera, and if asked for the drawing of its housing and holder (if it has a holder)."""
    body = spec.body(mount.link)
    R = camera_rotation(mount)
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, R.ravel())
    body.add_camera(name=mount.name, pos=mount.position, quat=quat, fovy=mount.fovy)
    if not housing or mount.holder is None:
        return
    # The lens must not see the housing: it ends 1 mm behind the optical centre.
    centre = np.array(mount.position) + R[:, 2] * (HOUSING[2] / 2 + 0.001)
    shapes = mujoco.mjtGeom
    half = [edge / 2 for edge in HOUSING]
    body.add_geom(type=shapes.mjGEOM_BOX, size=half, pos=centre, quat=quat, rgba=_GREY, **DRAWN_ONLY)
    for side in (-0.025, 0.0, 0.025):
        lens = centre + R[:, 0] * side
        ends = [*lens, *(lens - R[:, 2] * (HOUSING[2] / 2 + 0.0005))]
        body.add_geom(type=shapes.mjGEOM_CYLINDER, size=[0.007, 0, 0], fromto=ends, rgba=_BLACK, **DRAWN_ONLY)
    stem = [*mount.holder, *centre]
    body.add_geom(type=shapes.mjGEOM_CAPSULE, size=[0.006, 0, 0], fromto=stem, rgba=_BLACK, **DRAWN_ONLY)


#: The files' colours are darker than the arm is; they are raised to this power.
_GAMMA = 0.75
_Colour = tuple[float, ...]


def add_visual_meshes(spec: Any, arm: ArmDescription) -> None:
    """Draw the links that have visual meshes by them.

    Raises:
        InstallationError: trimesh or pycollada is missing.
    """
    for link in ET.fromstring(arm.urdf).iter("link"):
        name = link.get("name", "")
        parts = [part for visual in link.iter("visual") for part in _parts(visual, arm)]
        if not parts:
            continue
        for geom in spec.body(name).geoms:
            geom.group = HIDDEN_GROUP
        for index, (colour, mesh) in enumerate(_by_colour(parts)):
            _add_mesh(spec, name, f"{name}_visual_{index}", colour, mesh)


def _parts(visual: ET.Element, arm: ArmDescription) -> Iterator[tuple[_Colour, Any]]:
    """Colours and meshes of one `<visual>`, in the link's frame."""
    element = visual.find("geometry/mesh")
    if element is None:
        return
    try:
        import collada  # noqa: F401  (trimesh reads .dae with it, and says nothing helpful if it is missing)
        import trimesh
    except ImportError as error:
        raise InstallationError(f"{error}; visual meshes need: pip install trimesh pycollada") from error
    file = element.get("filename", "").replace("package://", f"{arm.package_root()}/")
    scene: Any = trimesh.load(file, force="scene")
    T = _origin(visual.find("origin"))
    T[:3, :3] *= np.array([float(s) for s in element.get("scale", "1 1 1").split()])
    for node in scene.graph.nodes_geometry:
        T_scene_part, geometry = scene.graph[node]
        mesh = scene.geometry[geometry].copy()
        colour = np.asarray(getattr(mesh.visual, "material", mesh.visual).main_color, dtype=float)
        colour = (colour / 255) ** _GAMMA
        mesh.apply_transform(T @ T_scene_part)
        yield tuple(colour), mesh


def _origin(element: ET.Element | None) -> Floats:
    T = np.eye(4)
    if element is not None:
        T[:3, 3] = [float(v) for v in element.get("xyz", "0 0 0").split()]
        roll, pitch, yaw = (float(v) for v in element.get("rpy", "0 0 0").split())
        quat, R = np.empty(4), np.empty(9)
        mujoco.mju_euler2Quat(quat, np.array([roll, pitch, yaw]), "XYZ")  # capitals: about fixed axes, as in URDF
        mujoco.mju_quat2Mat(R, quat)
        T[:3, :3] = R.reshape(3, 3)
    return T


def _by_colour(parts: list[tuple[_Colour, Any]]) -> Iterator[tuple[_Colour, list[Any]]]:
    groups: dict[_Colour, list[Any]] = defaultdict(list)
    for colour, mesh in parts:
        groups[colour].append(mesh)
    yield from groups.items()


def _add_mesh(spec: Any, body: str, name: str, colour: _Colour, meshes: list[Any]) -> None:
    offsets = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    faces = np.concatenate([mesh.faces + offset for mesh, offset in zip(meshes, offsets, strict=True)])
    spec.add_mesh(
        name=name,
        uservert=np.concatenate([mesh.vertices for mesh in meshes]).ravel(),
        usernormal=np.concatenate([mesh.vertex_normals for mesh in meshes]).ravel(),
        userface=faces.ravel(),
        userfacenormal=faces.ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,  # the parts are open surfaces
    )
    spec.body(body).add_geom(
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=name,
        rgba=colour,
        **DRAWN_ONLY,
    )


#: Step of the simulation [s]. From 0.002 on, 400 of 400 random targets get the same verdict; at 0.01 an arm that runs
#: into the table sinks in by the table's thickness, at 0.008 by half of it.
TIMESTEP = 0.008
BALL = "ball"
BALL_GROUP = 1  # of its own, so that it can be drawn alone
BALL_COLOUR = (0.86, 0.04, 0.03, 1.0)
NEITHER_SEEN_NOR_FELT = {**DRAWN_ONLY, "group": HIDDEN_GROUP}
#: Stiffness of a finger's drive [N/m]: full force 12 mm from where it wants to be.
GRIPPER_GAIN = 10_000.0
#: Angles of the first joint at which it is tried what the first link touches.
ANGLES = 361
#: Rotor inertia of the gripper's drive seen at a finger [kg].
GRIPPER_ARMATURE = 0.1


def build_scene(arm: ArmDescription, *, timestep: float = TIMESTEP, visual: bool = True) -> Any:
    """The scene of an arm, ready to compile or to edit further.

    Args:
        arm: The arm and its work cell.
        timestep: Step of the simulation [s].
        visual: Make it look good: draw the links by the URDF's visual meshes, the table's legs, camera housings. None
            of it has mass or contact: the physics is the same, to the bit. Without, links are drawn by their collision
            shapes and frames come faster.

    Returns:
        A `mujoco.MjSpec`.

    Raises:
        InputError: A timestep that cannot be used, or an arm that MuJoCo does not take.
        InstallationError: Packages that read the visual meshes are missing.
    """
    check_timestep(timestep)
    with _refusals_of(arm):
        spec = _import_urdf(arm)
        spec.option.timestep = timestep
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        _drive_joints(spec, arm)
        _drive_gripper(spec, arm)
        _add_workcell(spec, arm)
        _exclude_out_of_reach(spec, arm)
        for frame in arm.tips.values():
            spec.body(frame).add_site(name=frame, group=HIDDEN_GROUP)
        for camera in arm.cameras:
            add_camera(spec, camera, housing=visual)
        if visual:
            add_visual_meshes(spec, arm)
        add_looks(spec, arm.workcell.obstacles, visual=visual)
        _add_home(spec, arm)
    return spec


def check_timestep(timestep: object) -> None:
    """Refuse a timestep that cannot be used: shorter and a second takes minutes, longer and contacts are lost."""
    check_number("timestep", timestep, least=1e-5, most=0.02)


@contextmanager
def _refusals_of(arm: ArmDescription) -> Iterator[None]:
    """What MuJoCo says of an arm that it does not take, as an error of ours."""
    try:
        yield
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"MuJoCo cannot make a scene of arm {arm.name!r}: {error}") from None


@lru_cache(maxsize=16)
def scene_model(arm: ArmDescription, *, timestep: float = TIMESTEP, visual: bool = True) -> Any:
    """The compiled scene (`mujoco.MjModel`), shared by all who ask for the same one: do not change it.

    Arguments and errors are those of `build_scene`. Whoever wants to vary a model compiles their own.
    """
    with _refusals_of(arm):
        return build_scene(arm, timestep=timestep, visual=visual).compile()


def _import_urdf(arm: ArmDescription) -> Any:
    root = arm.package_root()
    spec = mujoco.MjSpec.from_string(arm.urdf if root is None else arm.urdf.replace("package://", f"{root}/"))
    spec.compiler.fusestatic = False  # otherwise tool0, tcp and base_link are no bodies
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
    """Two servos, to be given the same setpoint, stand for the one drive of both fingers.

    The importer's equality for the URDF's `mimic` goes: as the only constraint of an arm that touches nothing it would
    keep the solver busy in every step, for a seventh of its time.
    """
    for equality in list(spec.equalities):
        spec.delete(equality)
    if arm.gripper is None:
        return
    for name in (arm.gripper.joint, arm.gripper.mimic_joint):
        spec.joint(name).armature = GRIPPER_ARMATURE
        _add_servo(spec, spec.joint(name), GRIPPER_GAIN)


def _add_servo(spec: Any, joint: Any, gain: float) -> None:
    """Critically damped position servo; its torque is limited by the joint's `actfrcrange`, the URDF's effort."""
    joint.actgravcomp = True
    servo = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    servo.set_to_position(kp=gain, dampratio=1.0)


def _add_workcell(spec: Any, arm: ArmDescription) -> None:
    cell = arm.workcell
    for box in cell.obstacles:
        # A body each, so that a link that stands on one obstacle can be excused from touching just that one.
        body = spec.worldbody.add_body(name=box.name, pos=box.position)
        body.add_geom(name=box.name, type=mujoco.mjtGeom.mjGEOM_BOX, size=[edge / 2 for edge in box.size])
        # With a second shape in the body, MuJoCo compares oriented bounding boxes before it searches for the contact
        # itself, and so drops almost all pairs; between bodies of one shape it compares bounding spheres only.
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[min(box.size) / 4, 0, 0], **NEITHER_SEEN_NOR_FELT)
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
        group=BALL_GROUP,
        contype=0,
        conaffinity=0,
    )


def _exclude_out_of_reach(spec: Any, arm: ArmDescription) -> None:
    """Spare MuJoCo the obstacles that the first link cannot touch at any angle: a tenth of the time of every step.

    That link is so near to what carries the arm that nothing but the search for a contact itself tells them apart.
    """
    model = spec.compile()
    data = mujoco.MjData(model)
    joint = model.joint(arm.joints[0])
    link = model.body(model.jnt_bodyid[joint.id])
    low, high = joint.range
    step = (high - low) / (ANGLES - 1)
    for geom in range(link.geomadr[0], link.geomadr[0] + link.geomnum[0]):
        # Between two angles no point of the shape moves further.
        model.geom_margin[geom] = step * (model.geom_rbound[geom] + np.linalg.norm(model.geom_pos[geom]))
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
    """The start posture as a keyframe, for `reset` and for viewers."""
    position = {**dict(zip(arm.joints, arm.home, strict=True)), **arm.locked_joints}
    spec.add_key(
        name="home",
        qpos=[position[joint.name] for joint in spec.joints],
        ctrl=[position[actuator.target] for actuator in spec.actuators],
    )
