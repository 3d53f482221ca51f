"""An arm in its work cell, simulated: one of them, or many stepped together."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Collection, Mapping, Sequence
from copy import copy
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from kinreach._checks import (
    MAX_DISTANCE,
    MAX_THREADS,
    Floats,
    as_array,
    as_floats,
    as_vector,
    check_count,
    check_entries,
    check_known,
    shown,
)
from kinreach.errors import InputError, raise_unknown
from kinreach.robots import THESIS_ARM, ArmDescription, Box, get_arm
from kinreach.sim._controller import TOLERANCE, JointController, MoveResult, Touch, touches
from kinreach.sim._engine import mujoco
from kinreach.sim._free_objects import OBJECTS
from kinreach.sim._imperfections import PAYLOAD, DrawnArms, Imperfections, as_imperfections, in_scene, scene_of
from kinreach.sim._movable_boxes import MAX_BOXES, put_boxes, spare_boxes
from kinreach.sim._plants import BatchPlant, Ids, SinglePlant, rows_and_columns
from kinreach.sim._scene import BALL, TIMESTEP, check_timestep, scene_model

if TYPE_CHECKING:
    from kinreach.sim._warp_plant import WarpPlant

#: What steps a batch.
MUJOCO, WARP = "mujoco", "warp"


class ArmSimulation:
    """An arm, its obstacles and the ball, under MuJoCo's dynamics. One per thread.

    All poses are in the world frame (z up, metres) and of the current state.

    Args:
        arm: Name of a registered arm, or a description.
        timestep: Step of the simulation [s].
        visual: Draw the links as `build_scene` says; takes about 1 s on first use and does not change the motion.
        tolerance: How far from its target a joint may come to rest [rad].
        imperfections: Of the arm, as `Imperfections` or by name, such as `{"payload": 0.5}`; an ideal arm by default.
        objects: Number of free objects, up to two; `kinreach.sim._grasping` puts them somewhere and grasps them.
        boxes: Number of boxes for `put_boxes`.
        drawn: Names of properties of the arm that `drawn` gives each simulation, see `kinreach.sim._imperfections`.

    Attributes:
        arm: The description.
        drawn: Writes drawn properties into the model; None without.
        model: MuJoCo's model, of this simulation only: what is written to it acts in the next step.
        data: MuJoCo's state.
        controller: Executes moves.

    Raises:
        UnknownNameError: Unknown arm.
        InputError: A timestep, a tolerance or an imperfection that cannot be used.
    """

    def __init__(
        self,
        arm: str | ArmDescription = THESIS_ARM,
        *,
        timestep: float = TIMESTEP,
        visual: bool = False,
        tolerance: float = TOLERANCE,
        imperfections: Imperfections | Mapping[str, float] | None = None,
        objects: int = 0,
        boxes: int = 0,
        drawn: Collection[str] = (),
    ) -> None:
        self.arm = get_arm(arm)
        check_timestep(timestep)
        check_count("objects", objects, least=0, most=len(OBJECTS))
        flaws = scene_of(as_imperfections(imperfections), drawn)
        check_count("boxes", boxes, least=0, most=MAX_BOXES)
        self.model: Any = scene_model(
            self.arm, timestep=timestep, visual=visual, imperfections=in_scene(flaws), objects=objects, boxes=boxes
        )
        self.data: Any = mujoco.MjData(self.model)
        self.controller = JointController(
            self.arm,
            self.model,
            tolerance=tolerance,
            encoder_noise=flaws.encoder_noise,
            boxes=boxes,
            planned_with=_ideal(self.model, drawn),
        )
        self._plant = SinglePlant(self.model, self.data)
        self.drawn = _drawn_arms(self._plant, self.controller, drawn)
        self._only = np.zeros(1, dtype=np.intp)
        self._boxes = boxes
        self._ball = int(self.model.body(BALL).mocapid[0])
        self.reset()

    def reset(self, q: ArrayLike | None = None) -> None:
        """Put the whole state back: arm at rest in `q`, servos holding it, time 0, ball at its default place.

        Args:
            q: Posture [rad], shape (n,); the arm's home by default.

        Raises:
            InputError: Wrong shape, not finite, or outside the joint limits.
        """
        q = as_vector("q", self.arm.home if q is None else q, len(self.arm.joints))
        self.controller.refuse_outside_limits(q)
        mujoco.mj_resetDataKeyframe(self.model, self.data, self.model.key("home").id)
        self.controller.joints.put(self._plant.qpos, self._only, q)
        self.data.ctrl[self.controller.ctrl] = q

    def place_ball(self, position: ArrayLike) -> None:
        """Move the ball, by its centre [m] in the world, shape (3,). It has no contact; its place is free, up to 1e6 m.

        Raises:
            InputError: Wrong shape, not finite, or further away.
        """
        self.data.mocap_pos[self._ball] = as_vector("position", position, 3, most=MAX_DISTANCE)

    def put_boxes(self, boxes: Sequence[Box]) -> None:
        """Put the movable boxes where these are, with their edges, and those that are left over out of the way.

        Raises:
            InputError: More than there are.
        """
        if len(boxes) > self._boxes:
            raise InputError(f"the scene has {self._boxes} movable boxes, got {len(boxes)}")
        put_boxes(self.model, [*boxes, *spare_boxes(self._boxes)[len(boxes) :]])

    def open_gripper(self, opening: float) -> None:
        """Put the fingers of the arm's gripper where it is open by `opening` [m], at once."""
        gripper: Any = self.arm.gripper
        for name, position in zip(gripper.joints, gripper.positions(np.array(opening)), strict=True):
            self.data.joint(name).qpos[0] = position

    def move(self, q_target: ArrayLike, *, two_phase: bool = True) -> MoveResult:
        """Move to a posture by dynamics; see `JointController.move`.

        Args:
            q_target: Target posture [rad], shape (n,).
            two_phase: Whether the joints in `arm.moves_last` wait until all others have arrived.

        Returns:
            How it ended, and where.

        Raises:
            InputError: The target has the wrong shape or is not finite.
        """
        target = as_vector("q_target", q_target, len(self.arm.joints))
        return self.controller.move(self._plant, self._only, target[None], two_phase=two_phase)[0]

    @property
    def watch(self) -> Callable[[], object] | None:
        """Called after every control period of a move (0.008 s), for example to draw it; must not change the state."""
        return self._plant.watch

    @watch.setter
    def watch(self, watch: Callable[[], object] | None) -> None:
        self._plant.watch = watch

    @property
    def q(self) -> Floats:
        """Posture [rad], shape (n,)."""
        return self.data.qpos[self.controller.qpos].copy()

    @property
    def ball_position(self) -> Floats:
        """Centre of the ball [m], shape (3,)."""
        return self.data.mocap_pos[self._ball].copy()

    @property
    def tip_position(self) -> Floats:
        """Position of the arm's default tip [m], shape (3,)."""
        return self.T_world_frame(self.arm.tips[self.arm.default_tip])[:3, 3]

    def T_world_frame(self, name: str) -> Floats:
        """Return the pose of a frame of the URDF, or of an obstacle, shape (4, 4).

        Raises:
            UnknownNameError: Unknown frame.
        """
        given: object = name
        named = isinstance(given, str) and given.isprintable()
        body = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, name) if named else -1
        if body < 0:
            raise_unknown("frame", str(name), (self.model.body(i).name for i in range(self.model.nbody)))
        mujoco.mj_kinematics(self.model, self.data)  # after a step the poses are those before its last substep
        T = np.eye(4)
        T[:3, :3] = self.data.xmat[body].reshape(3, 3)
        T[:3, 3] = self.data.xpos[body]
        return T

    def contacts(self) -> tuple[Touch, ...]:
        """Return the contacts in the current posture, deepest first."""
        mujoco.mj_fwdPosition(self.model, self.data)
        return touches(self.model, self.data, self.controller.obstacles)


def _ideal(model: Any, drawn: Collection[str]) -> Any:
    """Return the model of the arm before anything is drawn, without payload; None where nothing is."""
    if not drawn:
        return None
    ideal = copy(model)
    if "payload" in drawn:
        load = ideal.body(PAYLOAD)
        load.mass[:] = load.inertia[:] = 0.0
    return ideal


def _drawn_arms(plant: Any, controller: JointController, drawn: Collection[str]) -> DrawnArms | None:
    if not drawn:
        return None
    made = DrawnArms(plant, controller.model, controller.arm.joints, len(plant.qpos))
    if "encoder_noise" in drawn:
        controller.encoder_noise = made.encoder_noise
    return made


class BatchSimulation:
    """A number of independent `ArmSimulation`, each bit for bit what it would be alone, on any number of threads.

    Make one per thread. It cannot be pickled. With `backend="warp"` they are stepped by MuJoCo Warp, and only nearly
    equal to single ones: see `kinreach.sim._warp_plant`.

    Simulations are named by their ids, 0 to `count` - 1; wherever ids are given they are distinct and ascending. All
    poses are in the world frame (z up, metres).

    Args:
        arm: Name of a registered arm, or a description.
        count: Number of simulations.
        threads: Threads that step them, the caller's included.
        timestep: Step of the simulation [s].
        tolerance: How far from its target a joint may come to rest [rad].
        imperfections: Of the arm, as `Imperfections` or by name, such as `{"payload": 0.5}`; an ideal arm by default.
        backend: `"mujoco"`, or `"warp"`.
        device: Of Warp, such as `"cuda:0"` or `"cpu"`; a GPU where there is one if None.
        objects: As of `ArmSimulation`; with Warp of one shape in all simulations.
        drawn: As of `ArmSimulation`; not with Warp.

    Attributes:
        arm: The description.
        drawn: As of `ArmSimulation`.
        count: As given.
        model: MuJoCo's model of the scene. The batch steps a copy of it.
        batch: MuJoCo's batch (`mujoco.batch.Batch`); None with Warp.
        controller: Executes moves.

    Raises:
        InputError: `count`, `threads`, a timestep, a tolerance, an imperfection or a device that cannot be used.
        InstallationError: MuJoCo Warp is not installed.
        UnknownNameError: Unknown arm or backend.
    """

    def __init__(
        self,
        arm: str | ArmDescription,
        count: int,
        *,
        threads: int = 1,
        timestep: float = TIMESTEP,
        tolerance: float = TOLERANCE,
        imperfections: Imperfections | Mapping[str, float] | None = None,
        backend: str = MUJOCO,
        device: str | None = None,
        objects: int = 0,
        drawn: Collection[str] = (),
    ) -> None:
        check_known("backend", backend, (MUJOCO, WARP))
        check_count("objects", objects, least=0, most=len(OBJECTS))
        if drawn and backend == WARP:
            raise InputError(f"simulations with backend={WARP!r} have one model: nothing can be drawn for each")
        if device is not None and backend != WARP:
            raise InputError(f"device is for backend={WARP!r}; {backend!r} runs on the processor, got {shown(device)}")
        count, threads = (
            check_count("count", count, most=2**17),  # refused before memory is asked for
            check_count("threads", threads, most=MAX_THREADS),
        )
        check_timestep(timestep)
        self.arm = get_arm(arm)
        self.count = count
        flaws = scene_of(as_imperfections(imperfections), drawn)
        self.model: Any = scene_model(
            self.arm, timestep=timestep, visual=False, imperfections=in_scene(flaws), objects=objects
        )
        self.batch: Any = None
        self._plant: BatchPlant | WarpPlant
        if backend == WARP:
            from kinreach.sim._warp_plant import WarpPlant  # needs the extra

            self._plant = WarpPlant(self.model, count, device=device)
        else:
            try:
                self.batch = importlib.import_module("mujoco.batch").Batch(self.model, count, threads)
            except (MemoryError, ValueError) as error:  # what MuJoCo makes of it when there is no memory left
                raise InputError(f"{count} simulations do not fit into the memory: {error}") from None
            self._plant = BatchPlant(self.model, self.batch)
        self.controller = JointController(
            self.arm,
            self.model,
            tolerance=tolerance,
            encoder_noise=flaws.encoder_noise,
            planned_with=_ideal(self.model, drawn),
        )
        self.drawn = _drawn_arms(self._plant, self.controller, drawn)
        self._balls = self._plant.mocap[:, int(self.model.body(BALL).mocapid[0])]
        self._tip = self.model.body(self.arm.tips[self.arm.default_tip]).id
        self._scratch = mujoco.MjData(self.model)
        self.reset(np.arange(count))

    def reset(self, ids: ArrayLike, q: ArrayLike | None = None) -> None:
        """Put whole states back: arms at rest, servos holding them, time 0, balls at their default place.

        Args:
            ids: Simulations, shape (k,).
            q: Postures [rad], shape (k, n) or (n,); the arm's home by default.

        Raises:
            InputError: Malformed arguments, or a posture outside the joint limits.
        """
        ids = self._as_ids(ids)
        q = self._as_rows("q", self.arm.home if q is None else q, len(ids), len(self.arm.joints), repeat=True)
        for posture in q[self.controller.outside_limits(q).any(axis=1)]:
            self.controller.refuse_outside_limits(posture)
        self._plant.home(ids)
        self.controller.joints.put(self._plant.qpos, ids, q)
        self._plant.ctrl[rows_and_columns(ids, self.controller.ctrl)] = q

    def place_ball(self, ids: ArrayLike, positions: ArrayLike) -> None:
        """Move balls, by their centres [m] in the world; they have no contact and may be anywhere within 1e6 m.

        Args:
            ids: Simulations, shape (k,).
            positions: Shape (k, 3), or (3,) for the same place in all.

        Raises:
            InputError: Malformed arguments.
        """
        ids = self._as_ids(ids)
        rows = self._as_rows("positions", positions, len(ids), 3, repeat=True)
        check_entries("positions", rows, MAX_DISTANCE)
        self._balls[ids] = rows

    def move(self, ids: ArrayLike, targets: ArrayLike, *, two_phase: bool = True) -> list[MoveResult]:
        """Move arms to postures by dynamics; see `JointController.move`.

        Args:
            ids: Simulations, shape (k,); the others stand still, in time too.
            targets: Target postures [rad], shape (k, n).
            two_phase: Whether the joints in `arm.moves_last` wait until all others have arrived.

        Returns:
            How each ended, and where, in the order of `ids`.

        Raises:
            InputError: Malformed arguments.
        """
        ids = self._as_ids(ids)
        targets = self._as_rows("targets", targets, len(ids), len(self.arm.joints))
        return self.controller.move(self._plant, ids, targets, two_phase=two_phase)

    @property
    def q(self) -> Floats:
        """Postures [rad], shape (count, n)."""
        return self._plant.qpos[:, self.controller.qpos].copy()

    @property
    def ball_positions(self) -> Floats:
        """Centres of the balls [m], shape (count, 3)."""
        return self._balls.copy()

    @property
    def tip_positions(self) -> Floats:
        """Positions of the arms' default tips [m], shape (count, 3)."""
        return self.tip_positions_of(np.arange(self.count))

    def tip_positions_of(self, ids: Ids) -> Floats:
        """Return positions of the default tips of some arms [m], shape (k, 3)."""
        tips = np.empty((len(ids), 3))
        for tip, qpos in zip(tips, self._plant.qpos[ids], strict=True):
            self._scratch.qpos[:] = qpos
            mujoco.mj_kinematics(self.model, self._scratch)
            tip[:] = self._scratch.xpos[self._tip]
        return tips

    def _as_ids(self, ids: ArrayLike) -> Ids:
        given = as_array("ids", ids)
        integers = given.dtype.kind in "iu" or given.size == 0
        if given.ndim != 1 or not integers or (given.size and not 0 <= given.min() <= given.max() < self.count):
            raise InputError(f"ids must be a list of integers from 0 to {self.count - 1}, got {shown(ids)}")
        given = given.astype(np.intp)  # before anything is subtracted: unsigned numbers have no negative differences
        if (np.diff(given) <= 0).any():
            raise InputError(f"ids must be distinct and ascending, got {shown(ids)}")
        return given

    @staticmethod
    def _as_rows(name: str, value: ArrayLike, rows: int, size: int, *, repeat: bool = False) -> Floats:
        values = as_floats(name, value)
        if repeat and values.shape == (size,):
            values = np.broadcast_to(values, (rows, size))
        if values.shape != (rows, size):
            raise InputError(f"{name} must have shape ({rows}, {size}), got {values.shape}")
        if not np.isfinite(values).all():
            raise InputError(f"{name} must be finite, got {values[~np.isfinite(values).all(axis=1)][0]}")
        return values
