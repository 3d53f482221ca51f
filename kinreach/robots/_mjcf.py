"""Arms from MuJoCo's MJCF files: read by MuJoCo, and written as the URDF that everything else takes.

MuJoCo resolves defaults, angles, frames and replicas; its compiled model is what is written, body by body. It opens no
file: includes are put in place before, and meshes are found, read and checked as those of a URDF.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

import numpy as np

from kinreach._checks import Floats, shown
from kinreach._engines import load_mujoco
from kinreach._files import decoded, read_bytes
from kinreach._rotations import rotation_to, rpy, turn
from kinreach.errors import InputError
from kinreach.robots._meshes import HULLS, TRIANGLES
from kinreach.robots._urdf import (
    MAX_CHARACTERS,
    MAX_DEPTH,
    WORLD,
    add_joint,
    add_link,
    numbers,
    parse_xml,
)
from kinreach.robots._urdf_repair import listed_names

#: The first element of a file, and that of a file that is only to be included.
MJCF, PART = "mujoco", "mujocoinclude"
#: The keyframe that is the start posture.
HOME = "home"
#: Limits of a joint that slides and has none [m].
FARTHEST = 100.0
#: Geoms of higher groups are not drawn by default.
LAST_DRAWN = 2
#: Mass and inertia that stand for none, so that MuJoCo compiles bodies whose mass is that of a mesh [kg], [kg m^2].
NOTHING = 1e-12
#: Most characters with all included files.
MOST = 4 * MAX_CHARACTERS
_GREY = (0.5, 0.5, 0.5, 1.0)


@dataclass(frozen=True, eq=False)
class Mjcf:
    """An arm of an MJCF file.

    Attributes:
        robot: As URDF; meshes are named relative to the file.
        home: Start posture by the names of the joints [rad, m]; empty without a keyframe of that name.
        coupled: Names of joints that a tendon or a closed loop couples to others.
        looped: Those of closed loops.
        may_touch: Pairs of links that the file excludes from contact; None if it names none, or if no two of its geoms
            touch at all: such a file says nothing of the arm.
        meshes: What its contacts use of a mesh.
        notes: What was left out or assumed, a line each.
    """

    robot: ET.Element
    home: dict[str, float] = field(default_factory=dict)
    coupled: frozenset[str] = frozenset()
    looped: frozenset[str] = frozenset()
    may_touch: tuple[tuple[str, str], ...] | None = None
    meshes: str = TRIANGLES
    notes: tuple[str, ...] = ()


class _MeshFile(NamedTuple):
    """A mesh of a geom: its address relative to the file, and the vertices' S R^T (v - p)."""

    address: str
    scale: Floats
    turned: Floats
    reference: Floats


def read_mjcf(root: ET.Element, path: Path) -> Mjcf:
    """Read the arm in the parsed MJCF of a file.

    Raises:
        InputError: MuJoCo does not read it, or it is put together of other models.
    """
    mujoco = load_mujoco()
    whole = _with_includes(root, path)
    if whole.find("asset/model") is not None:
        raise InputError(
            f"{shown(str(path))} attaches other models, which is not read; save it as one file with "
            "mujoco.MjSpec.from_file(FILE).to_xml(), or give the file of the arm"
        )
    try:
        spec = mujoco.MjSpec.from_string(ET.tostring(whole, encoding="unicode"))
        meshes = _without_files(mujoco, spec)
        model = spec.compile()
    except (ValueError, RuntimeError, TypeError, mujoco.FatalError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"MuJoCo cannot read {shown(str(path))}: {reason}") from None
    inferred = {body.id for body in spec.bodies if body.id > 0 and not body.explicitinertial}
    by_mesh = {model.geom_bodyid[geom.id].item() for geom, _ in meshes} & inferred
    name = spec.modelname if spec.modelname not in ("", "MuJoCo Model") else path.stem
    return _Writer(mujoco, model, name, {geom.id: mesh for geom, mesh in meshes}, by_mesh).write()


def _with_includes(root: ET.Element, path: Path) -> ET.Element:
    """Put what is included in its place: names are relative to the main file, or to the one that includes."""
    size = 0

    def spliced(element: ET.Element, inside: tuple[Path, ...]) -> Iterator[ET.Element]:
        nonlocal size
        if element.tag != "include":
            copy = ET.Element(element.tag, element.attrib)
            copy.extend([part for child in element for part in spliced(child, inside)])
            yield copy
            return
        name = element.get("file", "")
        places = [folder / name for folder in (path.parent, inside[-1].parent)]
        file = next((place for place in places if name.isprintable() and place.is_file()), places[0])
        if file in inside or len(inside) > MAX_DEPTH // 2:
            raise InputError(f"{shown(str(path))} includes {shown(name)} within itself")
        content = read_bytes(file, "the included file", most=MAX_CHARACTERS)
        if (size := size + len(content)) > MOST:
            raise InputError(f"{shown(str(path))} includes more than {MOST} characters")
        part = parse_xml(decoded(content, otherwise="latin-1").lstrip("\ufeff \t\r\n"), tags=(MJCF, PART))
        for child in part:
            yield from spliced(child, (*inside, file))

    (whole,) = spliced(root, (path,))
    return whole


def _without_files(mujoco: Any, spec: Any) -> list[tuple[Any, _MeshFile | None]]:
    """Take all that is a file out of a specification; returns the geoms of meshes, None for one of another surface."""
    kinds, files = mujoco.mjtGeom, {mesh.name: mesh for mesh in spec.meshes}
    taken: list[tuple[Any, _MeshFile | None]] = []
    for geom in spec.geoms:
        surface = geom.type in (kinds.mjGEOM_HFIELD, kinds.mjGEOM_SDF)
        if not (surface or geom.type == kinds.mjGEOM_MESH or geom.meshname):
            continue
        mesh = files.get(geom.meshname)
        if mesh is None and not surface:
            raise ValueError(f"a geom has the mesh {geom.meshname!r}, which the file does not have")
        taken.append((geom, None if surface or mesh is None else _mesh_file(mujoco, spec, mesh)))
        geom.type, geom.meshname, geom.hfieldname, geom.mass = kinds.mjGEOM_SPHERE, "", "", 0.0
        geom.size = [1.0, 0.0, 0.0]
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    for part in [each for kind in ("meshes", "textures", "hfields", "skins") for each in getattr(spec, kind)]:
        spec.delete(part)
    spec.compiler.boundmass = max(spec.compiler.boundmass, NOTHING)
    spec.compiler.boundinertia = max(spec.compiler.boundinertia, NOTHING)
    spec.compiler.fusestatic = spec.compiler.discardvisual = False
    return taken


def _mesh_file(mujoco: Any, spec: Any, mesh: Any) -> _MeshFile:
    name = PurePosixPath(mesh.file.replace("\\", "/"))
    folder = PurePosixPath(spec.meshdir.replace("\\", "/"))
    address = str(folder / (name.name if spec.strippath else name)) if mesh.file else mesh.name
    return _MeshFile(address, np.array(mesh.scale), _matrix(mujoco, mesh.refquat), np.array(mesh.refpos))


def _matrix(mujoco: Any, quat: Sequence[float]) -> Floats:
    R, unit = np.empty(9), np.array(quat, dtype=np.float64)
    mujoco.mju_normalize4(unit)
    mujoco.mju_quat2Mat(R, unit)
    return R.reshape(3, 3)


class _Writer:
    """Writes a compiled model as URDF."""

    def __init__(
        self, mujoco: Any, model: Any, name: str, meshes: dict[int, _MeshFile | None], by_mesh: Collection[int]
    ) -> None:
        self._mujoco, self._model, self._meshes, self._by_mesh = mujoco, model, meshes, by_mesh
        self.robot = ET.Element("robot", name=name)
        kinds = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
        self._moving = [j for j in range(model.njnt) if int(model.jnt_type[j]) in kinds]
        self._roots = {self._root(int(model.jnt_bodyid[j])) for j in self._moving}
        self._links = {WORLD}
        self._joints = {self._name("jnt", j) for j in range(model.njnt)}
        self._bodies = {0: WORLD}
        for body in self._arm_bodies():
            self._bodies[body] = self._new(self._links, self._name("body", body) or f"body_{body}")
        self._names = {j: self._name("jnt", j) or self._new(self._joints, self._default(j)) for j in range(model.njnt)}

    def write(self) -> Mjcf:
        model = self._model
        add_link(self.robot, WORLD)
        base = self._base()
        for body in self._arm_bodies():
            self._add_body(body, base if model.body_parentid[body] == 0 else self._bodies[model.body_parentid[body]])
        for site in range(model.nsite):
            self._add_site(site)
        self._add_mimics()
        home = self._mujoco.mj_name2id(model, self._mujoco.mjtObj.mjOBJ_KEY, HOME)
        looped = frozenset(self._looped())
        return Mjcf(
            self.robot,
            {self._names[j]: float(model.key_qpos[home][model.jnt_qposadr[j]]) for j in self._moving if home >= 0},
            frozenset(self._on_tendons()) | looped,
            looped,
            (tuple(self._excluded()) or None) if self._has_contacts() else None,
            HULLS,
            tuple(self._notes()),
        )

    def _name(self, kind: str, index: int) -> str:
        adr = {"jnt": "name_jntadr", "body": "name_bodyadr", "site": "name_siteadr"}[kind]
        raw = self._model.names[int(getattr(self._model, adr)[index]) :]
        return str(raw[: raw.index(b"\0")].decode(errors="replace"))

    def _default(self, joint: int) -> str:
        return f"{self._bodies.get(int(self._model.jnt_bodyid[joint]), 'body')}_joint"

    def _new(self, names: set[str], wanted: str) -> str:
        """Take a name that is not taken."""
        name = next(each for i in range(len(names) + 1) if (each := f"{wanted}_{i + 1}" if i else wanted) not in names)
        names.add(name)
        return name

    def _arm_bodies(self) -> list[int]:
        """Bodies that joints move, or that carry those, parents first."""
        return [body for body in range(1, self._model.nbody) if self._root(body) in self._roots]

    def _root(self, body: int) -> int:
        """The body on the world that carries a body, or the body itself."""
        return [*self._way_down(body)][-1]

    def _base(self) -> str:
        """The link that carries the arm: one with the shapes of the world where an arm begins with a joint on it."""
        model = self._model
        direct = any(model.jnt_bodyid[j] in self._roots for j in self._moving)
        if not (direct and any(self._is_shape(geom) for geom in self._geoms(0))):
            return WORLD
        base = self._new(self._links, "base")
        self._add_shapes(add_link(self.robot, base), 0)
        add_joint(self.robot, self._new(self._joints, "base_joint"), WORLD, base)
        return base

    def _add_body(self, body: int, parent: str) -> None:
        """Add a body's link, and between it and its parent its joints, one after the other."""
        model, link = self._model, self._bodies[body]
        T = self._place(model.body_pos[body], model.body_quat[body])
        first = int(model.body_jntadr[body])
        joints = range(first, first + int(model.body_jntnum[body])) if first >= 0 else range(0)
        element: ET.Element | None = None
        for joint in joints:
            anchor = np.array(model.jnt_pos[joint]) * (joint in self._moving)
            last = joint == joints[-1] and not anchor.any()
            child = link if last else self._new(self._links, f"{link}_{self._names[joint]}")
            element = add_link(self.robot, child)
            self._add_joint(joint, parent, child, T @ _shift(anchor))
            parent, T = child, _shift(-anchor)
        if element is None or parent != link:
            element = add_link(self.robot, link)
            self._add_fixed(f"{link}_mount", parent, link, T)
        self._add_inertia(element, body)
        self._add_shapes(element, body)

    def _add_joint(self, joint: int, parent: str, child: str, T: Floats) -> None:
        model, kinds = self._model, self._mujoco.mjtJoint
        name, kind = self._names[joint], model.jnt_type[joint]
        if joint not in self._moving:
            free = "floating" if kind == kinds.mjJNT_FREE else "spherical"
            add_joint(self.robot, name, parent, child, kind=free, xyz=T[:3, 3].tolist(), rpy=rpy(T[:3, :3]))
            return
        slides, axis = kind == kinds.mjJNT_SLIDE, np.array(model.jnt_axis[joint])
        ref = float(model.qpos0[model.jnt_qposadr[joint]])
        T = T @ _shift(-ref * axis) if slides else _turned(T, axis, -ref)
        limits, effort = self._limits(joint), self._effort(joint)
        if slides and limits is None:
            limits = (-FARTHEST, FARTHEST)
        element = add_joint(
            self.robot, name, parent, child, xyz=T[:3, 3].tolist(), rpy=rpy(T[:3, :3]), axis=axis.tolist(),
            kind="prismatic" if slides else "continuous" if limits is None else "revolute",
            limit=None if limits is None else (*limits, effort, 0.0),
        )  # fmt: skip
        dof = model.jnt_dofadr[joint]
        damping, friction = (float(values[dof]) for values in (model.dof_damping, model.dof_frictionloss))
        if damping or friction:
            ET.SubElement(element, "dynamics", damping=repr(damping), friction=repr(friction))

    def _actuators(self, joint: int) -> list[int]:
        model, kinds = self._model, self._mujoco.mjtTrn
        on_joints = (kinds.mjTRN_JOINT, kinds.mjTRN_JOINTINPARENT)
        every = range(model.nu)
        return [a for a in every if int(model.actuator_trntype[a]) in on_joints and model.actuator_trnid[a, 0] == joint]

    def _limits(self, joint: int) -> tuple[float, float] | None:
        """A joint's range, else what its position servo is commanded within; None if it turns without end."""
        model = self._model
        if model.jnt_limited[joint]:
            return tuple(model.jnt_range[joint].tolist())
        for a in self._actuators(joint):
            gain, bias, gear = model.actuator_gainprm[a], model.actuator_biasprm[a], float(model.actuator_gear[a, 0])
            servo = gain[0] > 0.0 and bias[0] == 0.0 and bias[1] == -gain[0] and gear > 0.0
            if servo and model.actuator_ctrllimited[a]:
                return tuple((model.actuator_ctrlrange[a] / gear).tolist())
        return None

    def _effort(self, joint: int) -> float:
        """Largest torque or force [N m, N]; 0 where it is not known."""
        model = self._model
        if model.jnt_actfrclimited[joint]:
            return float(np.abs(model.jnt_actfrcrange[joint]).max())
        driving = [a for a in self._actuators(joint) if model.actuator_forcelimited[a]]
        return float(sum(np.abs(model.actuator_forcerange[a] * model.actuator_gear[a, 0]).max() for a in driving))

    def _add_fixed(self, name: str, parent: str, child: str, T: Floats) -> None:
        add_joint(self.robot, self._new(self._joints, name), parent, child, xyz=T[:3, 3].tolist(), rpy=rpy(T[:3, :3]))

    def _add_site(self, site: int) -> None:
        """Add a named site as a link without mass."""
        model, name = self._model, self._name("site", site)
        link = self._bodies.get(int(model.site_bodyid[site]))
        if not name or link in (None, WORLD):
            return
        name = self._new(self._links, name if name not in self._links else f"{name}_site")
        add_link(self.robot, name)
        self._add_fixed(f"{name}_mount", str(link), name, self._place(model.site_pos[site], model.site_quat[site]))

    def _add_inertia(self, link: ET.Element, body: int) -> None:
        model = self._model
        mass, moments = float(model.body_mass[body]), np.array(model.body_inertia[body])
        if mass <= 10 * NOTHING or body in self._by_mesh:
            return
        T = self._place(model.body_ipos[body], model.body_iquat[body])
        inertial = ET.SubElement(link, "inertial")
        _add_origin(inertial, T)
        ET.SubElement(inertial, "mass", value=repr(mass))
        entries = dict(zip(("ixx", "iyy", "izz"), map(repr, moments.tolist()), strict=True))
        ET.SubElement(inertial, "inertia", entries | dict.fromkeys(("ixy", "ixz", "iyz"), "0"))

    def _geoms(self, body: int) -> range:
        first = int(self._model.body_geomadr[body])
        return range(first, first + int(self._model.body_geomnum[body])) if first >= 0 else range(0)

    def _is_shape(self, geom: int) -> bool:
        """Whether a geom is a body's, and not an endless plane or the ground."""
        plane = self._model.geom_type[geom] == self._mujoco.mjtGeom.mjGEOM_PLANE
        return not plane and not (geom in self._meshes and self._meshes[geom] is None)

    def _add_shapes(self, link: ET.Element, body: int) -> None:
        model = self._model
        in_pairs = {*model.pair_geom1.tolist(), *model.pair_geom2.tolist()}
        for geom in self._geoms(body):
            if model.geom_type[geom] == self._mujoco.mjtGeom.mjGEOM_PLANE:
                continue
            collides = bool(model.geom_contype[geom] or model.geom_conaffinity[geom] or geom in in_pairs)
            rgba = self._rgba(geom)
            drawn = int(model.geom_group[geom]) <= LAST_DRAWN and rgba[3] > 0.0
            for kind in ["visual"] * drawn + ["collision"] * collides:
                solid, T = self._solid(geom)
                shape = ET.SubElement(link, kind)
                _add_origin(shape, T)
                ET.SubElement(shape, "geometry").append(solid)
                if kind == "visual":
                    ET.SubElement(ET.SubElement(shape, "material", name=""), "color", rgba=numbers(rgba))

    def _solid(self, geom: int) -> tuple[ET.Element, Floats]:
        """A geom as an element of URDF, and its pose on the link (4, 4)."""
        model, kinds = self._model, self._mujoco.mjtGeom
        T = self._place(model.geom_pos[geom], model.geom_quat[geom])
        kind, size = model.geom_type[geom], model.geom_size[geom].tolist()
        if geom in self._meshes:
            return _mesh_element(self._meshes[geom], T)
        if kind == kinds.mjGEOM_BOX:
            return ET.Element("box", size=numbers([2 * half for half in size])), T
        if kind == kinds.mjGEOM_SPHERE:
            return ET.Element("sphere", radius=repr(size[0])), T
        if kind == kinds.mjGEOM_ELLIPSOID:
            longest = int(np.argmax(size))
            T[:3, :3] = T[:3, :3] @ rotation_to(np.eye(3)[longest])
            radius = sorted(size)[1]
            return ET.Element("capsule", radius=repr(radius), length=repr(2 * (size[longest] - radius))), T
        tag = "cylinder" if kind == kinds.mjGEOM_CYLINDER else "capsule"
        return ET.Element(tag, radius=repr(size[0]), length=repr(2 * size[1])), T

    def _rgba(self, geom: int) -> tuple[float, ...]:
        model = self._model
        own, material = tuple(model.geom_rgba[geom].tolist()), int(model.geom_matid[geom])
        plain = material >= 0 and np.allclose(own, _GREY)
        rgba = model.mat_rgba[material].tolist() if plain else own
        return tuple(np.clip(rgba, 0.0, 1.0).tolist())

    def _add_mimics(self) -> None:
        """Write joints that an equality couples in proportion: q1 - r1 = a0 + a1 (q2 - r2)."""
        model, kinds = self._model, self._mujoco.mjtEq
        joints = {joint.get("name"): joint for joint in self.robot.findall("joint")}
        for eq in range(model.neq):
            one, two = int(model.eq_obj1id[eq]), int(model.eq_obj2id[eq])
            straight = not model.eq_data[eq, 2:5].any()
            if model.eq_type[eq] != kinds.mjEQ_JOINT or two < 0 or not straight or not model.eq_active0[eq]:
                continue
            a0, a1 = model.eq_data[eq, :2].tolist()
            r1, r2 = (float(model.qpos0[model.jnt_qposadr[j]]) for j in (one, two))
            element = joints[self._names[one]]
            if element.find("mimic") is None and two in self._moving and one in self._moving:
                mimic = {"joint": self._names[two], "multiplier": repr(a1), "offset": repr(a0 + r1 - a1 * r2)}
                ET.SubElement(element, "mimic", mimic)

    def _on_tendons(self) -> Iterator[str]:
        """Joints that share a tendon, or that an equality holds or couples in another way."""
        model, kinds, on_joint = self._model, self._mujoco.mjtEq, self._mujoco.mjtWrap.mjWRAP_JOINT
        for tendon in range(model.ntendon):
            first = int(model.tendon_adr[tendon])
            wraps = range(first, first + int(model.tendon_num[tendon]))
            joints = [int(model.wrap_objid[w]) for w in wraps if model.wrap_type[w] == on_joint]
            if len(joints) > 1:
                yield from (self._names[joint] for joint in joints)
        for eq in range(model.neq):
            bent = model.eq_data[eq, 2:5].any() or model.eq_obj2id[eq] < 0
            if model.eq_type[eq] == kinds.mjEQ_JOINT and model.eq_active0[eq] and bent:
                yield self._names[int(model.eq_obj1id[eq])]

    def _looped(self) -> Iterator[str]:
        """Joints of closed loops: between two bodies that are connected, and what carries both."""
        model, kinds = self._model, self._mujoco.mjtEq
        for eq in range(model.neq):
            if int(model.eq_type[eq]) not in (kinds.mjEQ_CONNECT, kinds.mjEQ_WELD) or not model.eq_active0[eq]:
                continue
            ends = [int(model.eq_obj1id[eq]), int(model.eq_obj2id[eq])]
            if model.eq_objtype[eq] == self._mujoco.mjtObj.mjOBJ_SITE:
                ends = [int(model.site_bodyid[site]) for site in ends]
            ways = [set(self._way_down(body)) for body in ends]
            if any(body not in self._bodies for body in ends) or 0 in ends:
                continue  # what is connected to a target or an object moves freely
            loop = ways[0] ^ ways[1]
            yield from (self._names[j] for j in self._moving if int(model.jnt_bodyid[j]) in loop)

    def _way_down(self, body: int) -> Iterator[int]:
        while body:
            yield body
            body = int(self._model.body_parentid[body])

    def _has_contacts(self) -> bool:
        """Whether any two geoms of the arm may touch."""
        model = self._model
        own = [int(model.geom_bodyid[geom]) in self._bodies for geom in range(model.ngeom)]
        one, other = model.geom_contype[own], model.geom_conaffinity[own]
        return bool((one[:, None] & other[None]).any())

    def _excluded(self) -> Iterator[tuple[str, str]]:
        for signature in self._model.exclude_signature.tolist():
            one, other = (self._bodies.get(body) for body in (signature >> 16, signature & 0xFFFF))
            if one is not None and other is not None:
                yield one, other

    def _notes(self) -> Iterator[str]:
        model = self._model
        roots = [body for body in range(1, model.nbody) if model.body_parentid[body] == 0 and body not in self._roots]
        names = [self._name("body", body) or f"body_{body}" for body in roots]
        if names:
            head, verb = ("bodies", "are") if len(names) > 1 else ("body", "is")
            yield f"{head} {listed_names(names)} {verb} no part of the arm and left out; give obstacles to a work cell"
        weighed = [self._bodies[body] for body in sorted(self._by_mesh) if body in self._bodies]
        if weighed:
            yield (
                f"the mass that follows from meshes is not computed: link{'s' * (len(weighed) > 1)} "
                f"{listed_names(weighed)}; give <inertial> for simulations"
            )
        endless = [
            self._names[j]
            for j in self._moving
            if model.jnt_type[j] == self._mujoco.mjtJoint.mjJNT_SLIDE and self._limits(j) is None
        ]
        if endless:
            yield f"slides without limits are taken as ±{FARTHEST:g} m: {listed_names(endless)}"

    def _place(self, position: Sequence[float], quat: Sequence[float]) -> Floats:
        T = _shift(np.array(position))
        T[:3, :3] = _matrix(self._mujoco, quat)
        return T


def _shift(vector: Floats) -> Floats:
    T = np.eye(4)
    T[:3, 3] = vector
    return T


def _turned(T: Floats, axis: Floats, angle: float) -> Floats:
    """The pose after a turn about a unit axis of its own."""
    T = T.copy()
    if angle:
        T[:3, :3] = T[:3, :3] @ turn(axis, angle)
    return T


def _add_origin(element: ET.Element, T: Floats) -> None:
    ET.SubElement(element, "origin", xyz=numbers(T[:3, 3].tolist()), rpy=numbers(rpy(T[:3, :3])))


def _mesh_element(mesh: _MeshFile | None, T: Floats) -> tuple[ET.Element, Floats]:
    """A mesh with its pose; of another name where a URDF cannot place it."""
    if mesh is None:
        return ET.Element("surface"), T
    uniform = np.ptp(mesh.scale) == 0.0
    if not uniform and not np.array_equal(mesh.turned, np.eye(3)):
        return ET.Element("mesh_with_refquat_and_scale"), T
    inner = np.eye(4)
    inner[:3, :3] = mesh.turned.T
    inner[:3, 3] = -mesh.scale * (mesh.turned.T @ mesh.reference)
    return ET.Element("mesh", filename=mesh.address, scale=numbers(mesh.scale.tolist())), T @ inner
