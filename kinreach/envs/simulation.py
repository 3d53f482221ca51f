"""One arm in its work cell, simulated."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kinreach.envs.contacts import Touch, touches
from kinreach.envs.controller import TOLERANCE, JointController
from kinreach.envs.engine import mujoco
from kinreach.envs.moves import MoveResult
from kinreach.envs.plants import SinglePlant
from kinreach.envs.scene import BALL, TIMESTEP, check_timestep, scene_model
from kinreach.errors import raise_unknown
from kinreach.kinematics.goals import MOST_DISTANCE, Floats, as_vector
from kinreach.robots import ArmDescription, as_arm


class ArmSimulation:
    """An arm, its obstacles and the ball, under MuJoCo's dynamics. One per thread.

    All poses are in the world frame (z up, metres). What is read off is always that of the current state.

    Args:
        arm: Name of a registered arm, or a description.
        timestep: Step of the simulation [s].
        visual: Make it look good, see `build_scene`; costs about 1 s on first use and changes no motion.
        tolerance: How far from its target a joint may come to rest [rad].

    Attributes:
        arm: The description.
        model: MuJoCo's model, shared between simulations of the same scene: do not change it.
        data: MuJoCo's state.
        controller: Executes moves.

    Raises:
        UnknownNameError: There is no arm of that name.
        InputError: A timestep or a tolerance that cannot be used.
    """

    def __init__(
        self,
        arm: str | ArmDescription = "ur5",
        *,
        timestep: float = TIMESTEP,
        visual: bool = False,
        tolerance: float = TOLERANCE,
    ) -> None:
        self.arm = as_arm(arm)
        check_timestep(timestep)
        self.model: Any = scene_model(self.arm, timestep=timestep, visual=visual)
        self.data: Any = mujoco.MjData(self.model)
        self.controller = JointController(self.arm, self.model, tolerance=tolerance)
        self._plant = SinglePlant(self.model, self.data)
        self._only = np.zeros(1, dtype=np.intp)
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
        self.data.qpos[self.controller.qpos] = q
        self.data.ctrl[self.controller.ctrl] = q

    def place_ball(self, position: ArrayLike) -> None:
        """Move the ball, by its centre [m] in the world, shape (3,). It has no contact; its place is free, up to 1e6 m.

        Raises:
            InputError: Wrong shape, not finite, or further away.
        """
        self.data.mocap_pos[self._ball] = as_vector("position", position, 3, most=MOST_DISTANCE)

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
        """Called after every control period of a move (0.01 s), to draw it, say; it must not change the state."""
        return self._plant.watch

    @watch.setter
    def watch(self, watch: Callable[[], object] | None) -> None:
        self._plant.watch = watch

    @property
    def q(self) -> Floats:
        """Posture [rad], shape (n,)."""
        q: Floats = self.data.qpos[self.controller.qpos].copy()
        return q

    @property
    def ball_position(self) -> Floats:
        """Centre of the ball [m], shape (3,)."""
        position: Floats = self.data.mocap_pos[self._ball].copy()
        return position

    @property
    def tip_position(self) -> Floats:
        """Position of the arm's default tip [m], shape (3,)."""
        return self.T_world_frame(self.arm.tips[self.arm.default_tip])[:3, 3]

    def T_world_frame(self, name: str) -> Floats:
        """Pose of a frame of the URDF, or of an obstacle, shape (4, 4).

        Raises:
            UnknownNameError: There is no such frame; the message lists those there are.
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
        """What touches what in the current posture, deepest first; nothing is moved."""
        mujoco.mj_fwdPosition(self.model, self.data)
        return touches(self.model, self.data, self.controller.obstacles)
