"""Grasping in simulations with free objects: place objects, drive the fingers, and read what is held."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach.errors import InputError
from kinreach.robots import Gripper
from kinreach.robots.inside import JawGripper
from kinreach.sim._controller import JointController
from kinreach.sim._engine import mujoco
from kinreach.sim._free_objects import BODY_FIELDS, GEOM_FIELDS, OBJECT, OBJECTS, Objects
from kinreach.sim._imperfections import encoder_errors
from kinreach.sim._plants import Ids, Plant, as_index, rows_and_columns
from kinreach.sim._setpoints import CONTROL_PERIOD
from kinreach.sim._simulation import ArmSimulation, BatchSimulation

Flags = NDArray[np.bool_]


class Grasp(NamedTuple):
    """State of k grippers and objects; every array has k rows.

    Attributes:
        held: Whether the object touches both fingers and nothing but the gripper.
        gripped: Whether it touches both fingers.
        position: Of the object's centre in the world [m], shape (k, 3).
        rotation: Of the object to the world, shape (k, 3, 3).
        clearance: Of its lowest point above the table on which it was put [m].
        collides: Whether a link is in an obstacle or in another link, deeper than `TOUCHED`.
        opening: Between the fingers [m].
    """

    held: Flags
    gripped: Flags
    position: Floats
    rotation: Floats
    clearance: Floats
    collides: Flags
    opening: Floats


#: Contacts of links that are less deep are none to `Grasp.collides` [m].
TOUCHED = 1e-3


class Grasping:
    """The grippers and objects of simulations, one or a batch; each is independent of the others.

    Attributes:
        drawn: Writes drawn properties of the arms; None where none is drawn.
        objects: Number of objects of each.
    """

    def __init__(self, simulation: ArmSimulation | BatchSimulation) -> None:
        arm, model = simulation.arm, simulation.model
        if arm.gripper is None:
            raise InputError(f"arm {arm.name!r} has no gripper; with_gripper() puts one on its flange")
        self.drawn = simulation.drawn
        self.controller: JointController = simulation.controller
        self.gripper: Gripper | JawGripper = arm.gripper
        self.objects = len(self.controller.objects)
        self._plant: Plant = simulation._plant
        self.count = len(self._plant.qpos)
        joints = arm.gripper.joints
        self._fingers = [int(model.jnt_bodyid[model.joint(name).id]) for name in joints]
        if len(joints) == 1:  # the other jaw is part of the link that carries this one
            self._fingers += [int(model.body_parentid[body]) for body in self._fingers]
        self._finger_qpos = as_index([model.joint(name).qposadr[0] for name in joints])
        self._servos = as_index([model.actuator(name).id for name in joints])
        self._all_servos = np.arange(model.nu)
        self._object = model.body(OBJECT).id
        names = [model.body(body).name for body in range(model.nbody)]
        self._is_obstacle = np.array([name in self.controller.obstacles for name in names])
        self._is_object = np.array([name in self.controller.objects for name in names])
        self._rows = [
            slice(*(int(model.joint(name).qposadr[0]) + k for k in (0, 7))) for name in OBJECTS[: self.objects]
        ]
        self._bodies = [model.body(name).id for name in OBJECTS[: self.objects]]
        self._geoms = [model.geom(name).id for name in OBJECTS[: self.objects]]
        unlike_any = [Objects(*np.full((4, self.count), -1.0)) for _ in range(self.objects)]
        self._kinds = [kinds._replace(shape=kinds.shape.astype(np.intp)) for kinds in unlike_any]
        self._table = np.zeros(self.count)
        self._substeps = max(1, round(CONTROL_PERIOD / model.opt.timestep))
        self._period = self._substeps * float(model.opt.timestep)

    def reset(self, ids: Ids, q: Floats) -> None:
        """Put arms at rest into postures [rad], shape (k, n), the gripper open as at the start."""
        controller, plant = self.controller, self._plant
        plant.home(ids)
        controller.joints.put(plant.qpos, ids, q)
        plant.ctrl[rows_and_columns(ids, controller.ctrl)] = q

    def put_fingers(self, ids: Ids, openings: Floats) -> None:
        """Put fingers at rest where they are open by `openings` [m], shape (k,), at once."""
        ends = self.gripper.positions(openings)
        self._plant.qpos[rows_and_columns(ids, self._finger_qpos)] = ends
        self._plant.ctrl[rows_and_columns(ids, self._servos)] = ends

    def put(self, ids: Ids, which: int, kinds: Objects, places: Floats, yaws: Floats) -> None:
        """Put an object of each of k simulations down, upright, turned about the vertical by a yaw [rad].

        It touches the table at its place, in the world [m], shape (k, 3); `which` is its index.
        """
        self._make(ids, which, kinds)
        pose = self._plant.qpos[ids, self._rows[which]]
        pose[:, :3] = places
        pose[:, 2] += kinds.size
        pose[:, 3:] = np.stack([np.cos(yaws / 2), 0 * yaws, 0 * yaws, np.sin(yaws / 2)], 1)
        self._plant.qpos[ids, self._rows[which]] = pose
        if which == 0:
            self._table[ids] = places[:, 2]

    def put_at(self, ids: Ids, places: Floats, rotations: Floats) -> None:
        """Put the first object of each of k simulations into any pose.

        Its centre is at a place in the world [m], shape (k, 3), its rotation to the world of shape (k, 3, 3).
        """
        pose = self._plant.qpos[ids, self._rows[0]]
        pose[:, :3] = places
        for quaternion, rotation in zip(pose[:, 3:], rotations, strict=True):
            mujoco.mju_mat2Quat(quaternion, rotation.ravel())
        self._plant.qpos[ids, self._rows[0]] = pose

    def _make(self, ids: Ids, which: int, kinds: Objects) -> None:
        changed = np.zeros(len(ids), dtype=np.bool_)
        for now, new in zip(self._kinds[which], kinds, strict=True):
            changed |= now[ids] != new
            now[ids] = new
        if not changed.any():
            return
        rows = ids[changed]
        fields = kinds.of(changed).fields()
        for names, index in ((GEOM_FIELDS, self._geoms[which]), (BODY_FIELDS, self._bodies[which])):
            for name in names:
                self._plant.own(name)[rows, index] = fields[name]
        self._plant.update(rows)

    def drive(self, ids: Ids, openings: Floats, seconds: float) -> None:
        """Move the fingers evenly to openings [m], shape (k,), while the arms keep their setpoints."""
        self._lead(ids, self._servos, self.gripper.positions(openings), seconds)

    def rest(self, ids: Ids, seconds: float) -> None:
        """Simulate with unchanged setpoints."""
        self._lead(ids, self._servos, self._plant.ctrl[rows_and_columns(ids, self._servos)], seconds)

    def steer(self, ids: Ids, postures: Floats, openings: Floats, seconds: float) -> None:
        """Move the setpoints of arms and fingers evenly to postures [rad] and openings [m]."""
        servos = np.concatenate([self._all_servos[self.controller.ctrl], self._all_servos[self._servos]])
        end = np.concatenate([postures, self.gripper.positions(openings)], axis=1)
        self._lead(ids, servos, end, seconds, misread=self._misread(ids, postures, seconds))

    def _misread(self, ids: Ids, postures: Floats, seconds: float) -> Floats | float:
        """Return the errors of the servos' readings in every period [rad], shape (periods, k, servos)."""
        if self.controller.encoder_noise is None:
            return 0.0
        periods, starts = self._periods(seconds), self._plant.qpos[rows_and_columns(ids, self.controller.qpos)]
        rows = zip(self.controller.encoder_noise[ids], starts, postures, strict=True)
        errors = np.stack([encoder_errors(sigma, start, end, periods) for sigma, start, end in rows], axis=1)
        return np.concatenate([errors, np.zeros((periods, len(ids), len(self.gripper.joints)))], axis=2)

    def _periods(self, seconds: float) -> int:
        return max(1, round(seconds / self._period))

    def _lead(self, ids: Ids, servos: Any, end: Floats, seconds: float, misread: Floats | float = 0.0) -> None:
        """Simulate while the setpoints of some servos move evenly to their end."""
        start = self._plant.ctrl[rows_and_columns(ids, servos)]
        share = np.linspace(0.0, 1.0, 1 + self._periods(seconds))[1:, None, None]
        self._plant.follow(ids, servos, start + share * (end - start) - misread, self._substeps)

    def move(self, ids: Ids, targets: Floats) -> Any:
        """Move arms, all joints at once; see `JointController.move`."""
        return self.controller.move(self._plant, ids, targets, two_phase=False)

    def settling(self, q: Floats) -> float:
        """Return the time constant with which the arm's servos come to rest near a posture [rad], shape (n,) [s]."""
        return self.controller.settling(self._plant.qpos[0], q)

    def diverged(self, ids: Ids) -> Flags:
        return self._plant.diverged(ids)

    def states(self, ids: Ids) -> Floats:
        """Copy full states, for `put_back`."""
        return self._plant.states(ids)

    def put_back(self, ids: Ids, states: Floats) -> None:
        self._plant.put_back(ids, states)

    @property
    def q(self) -> Floats:
        """Postures [rad], shape (count, n)."""
        return self._plant.qpos[:, self.controller.qpos].copy()

    def pose(self, which: int = 0) -> tuple[Floats, Floats]:
        """Return places of the objects' centres [m], shape (count, 3), and rotations, shape (count, 3, 3)."""
        pose = self._plant.qpos[:, self._rows[which]]
        rotation = np.empty((self.count, 9))
        for row, quaternion in zip(rotation, pose[:, 3:].copy(), strict=True):
            mujoco.mju_normalize4(quaternion)
            mujoco.mju_quat2Mat(row, quaternion)
        return pose[:, :3].copy(), rotation.reshape(-1, 3, 3)

    def grasp(self, ids: Ids) -> Grasp:
        """Return the state of some grippers and objects."""
        rows, bodies, depths = self._plant.contacts(ids, self.controller.posed)
        own = (bodies == self._object).any(axis=1)
        touching = np.zeros((len(ids), len(self._is_obstacle)), dtype=np.bool_)
        touching[rows[own], bodies[own].sum(axis=1) - self._object] = True
        gripped = np.asarray(touching[:, self._fingers].all(axis=1))
        held = gripped & ~(touching & self._is_obstacle).any(axis=1)
        of_links = ~(self._is_object[bodies].any(axis=1) | self._is_obstacle[bodies].all(axis=1))
        collides = np.zeros(len(ids), dtype=np.bool_)
        collides[rows[of_links & (depths > TOUCHED)]] = True
        place, rotation = (values[ids] for values in self.pose())
        below = self._kinds[0].of(ids).lowest(rotation)
        opening = self.gripper.openings(self._plant.qpos[rows_and_columns(ids, self._finger_qpos)])
        return Grasp(held, gripped, place, rotation, place[:, 2] - below - self._table[ids], collides, opening)
