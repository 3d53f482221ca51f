"""The thesis's task as Gymnasium environments: single-step and multi-step path planning."""

from __future__ import annotations

from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.utils import EzPickle
from numpy.typing import ArrayLike

from kinreach.checks import check_known
from kinreach.envs.batch import check_seed
from kinreach.envs.reach.episodes import Outcome, ReachEpisodes
from kinreach.envs.reach.options import PixelObserver, ReachOptions
from kinreach.envs.reach.task import (
    MULTI_STEP,
    SINGLE_STEP,
    ReachVariant,
    action_space,
    check_actions,
    observation_space,
    reset_options,
)
from kinreach.envs.reach.worlds import KinematicWorld, ReachWorld, SingleDynamicWorld
from kinreach.sim.picture import ScenePicture
from kinreach.sim.simulation import ArmSimulation
from kinreach.thesis.reward import posture_error

ONE = np.zeros(1, dtype=np.intp)


class UR5ReachEnv(gym.Env[Any, Any], EzPickle):
    """One UR5 that reaches for a ball; see the subclasses for the tasks."""

    metadata = {  # noqa: RUF012 (declared by Gymnasium)
        "render_modes": ["human", "rgb_array", "rgb_array_list", "depth_array"],
        "render_fps": 25,
    }
    variant: ClassVar[ReachVariant]

    def __init__(
        self,
        *,
        observation: str = "geometric",
        backend: str = "mujoco",
        render_mode: str | None = None,
        pipeline: str = "hybrid",
        width: int = 640,
        height: int = 360,
        rgb_noise: float = 0.0,
        depth_noise: float = 0.0,
        end_on_reached: bool = True,
    ) -> None:
        EzPickle.__init__(
            self,
            observation=observation,
            backend=backend,
            render_mode=render_mode,
            pipeline=pipeline,
            width=width,
            height=height,
            rgb_noise=rgb_noise,
            depth_noise=depth_noise,
            end_on_reached=end_on_reached,
        )
        if render_mode is not None:
            check_known("render_mode", render_mode, self.metadata["render_modes"])
        self.options = ReachOptions(
            observation, backend, pipeline, width, height, rgb_noise, depth_noise, end_on_reached
        )
        self.render_mode = render_mode
        arm = self.options.arm
        self._simulation = ArmSimulation(arm, visual=render_mode is not None)
        world: ReachWorld = (
            SingleDynamicWorld(self._simulation) if backend == "mujoco" else KinematicWorld(1, explain=True)
        )
        self._episodes = ReachEpisodes(arm, self.variant, world, self.options.observer(), end_on_reached=end_on_reached)
        self._world = world
        self._pixels = PixelObserver(self.options) if observation == "pixels" else None
        fps = int(self.metadata["render_fps"])
        self._picture = ScenePicture(self._simulation, mode=render_mode, fps=fps) if render_mode is not None else None
        self._seeded = False
        self.action_space = action_space()
        self.observation_space: spaces.Space[Any] = (
            observation_space() if self._pixels is None else self._pixels.space()
        )

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode: the arm in its start pose, a new ball.

        Args:
            seed: Of the goals and of the cameras' noise.
            options: `"goal"`, shape (3,), puts the ball there, in the world frame [m]; `"q"`, shape (6,), starts the
                arm in this posture [rad].

        Raises:
            InputError: A seed that is none, an unknown option, or one that is malformed.
        """
        super().reset(seed=check_seed(seed))
        if seed is not None or not self._seeded:
            self._episodes.seed(0, self.np_random)
            self._seeded = True
        self._episodes.begin(ONE, *reset_options(options, None))
        self._show()
        info = {
            "goal": self._episodes.goals[0].copy(),
            "ball_found": self._episodes.found[0].copy(),
            "posture_error": float(posture_error(self._world.q[0])),
        }
        return self._observe(), info

    def step(self, action: ArrayLike) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Act once.

        Args:
            action: Six numbers in [-1, 1]; what is outside is clipped.

        Raises:
            InputError: Wrong shape, or a value that is not finite.
        """
        outcome = self._episodes.step(check_actions(action, None)[None])
        self._show()
        if self.render_mode == "human":
            self.render()
        reward = float(outcome.scored.reward[0])
        return self._observe(), reward, bool(outcome.terminated[0]), bool(outcome.truncated[0]), self._info(outcome)

    def render(self) -> Any:
        """A frame of the scene as `render_mode` says; with "human" the viewer is brought up to date.

        Returns:
            "rgb_array": uint8, (height, width, 3); "rgb_array_list": a list of such, those of the motion since the
            last call; "depth_array": float32 [m], (height, width); else None.
        """
        return None if self._picture is None else self._picture.frame()

    def close(self) -> None:
        """Close the viewer and free the renderers; further calls do nothing."""
        self._episodes.close()
        for part in (self._pixels, self._picture):
            if part is not None:
                part.close()

    def _observe(self) -> Any:
        if self._pixels is not None:
            return self._pixels.look(self._world.q[0], self._episodes.goals[0], self.np_random)
        return self._episodes.observe()[0]

    def _show(self) -> None:
        """Let the scene that is drawn follow a world that has no scene of its own."""
        if self._picture is not None and self.options.backend == "kinematic":
            limits = self._simulation.controller
            self._simulation.reset(np.clip(self._world.q[0], limits.lower, limits.upper))
            self._simulation.place_ball(self._episodes.goals[0])

    def _info(self, outcome: Outcome) -> dict[str, Any]:
        scored = outcome.scored
        reasons = outcome.executed.reasons
        return {
            "goal": self._episodes.goals[0].copy(),
            "ball_found": self._episodes.found[0].copy(),
            "distance": float(outcome.distance[0]),
            "posture_error": float(scored.posture_error[0]),
            "reached": bool(scored.reached[0]),
            "is_success": bool(scored.reached[0]),
            "impossible": bool(outcome.executed.impossible[0]),
            "impossible_reason": reasons[0] if reasons else "",
            "reward_terms": {name: float(term[0]) for name, term in scored.terms._asdict().items()},
        }


class UR5SingleStepEnv(UR5ReachEnv):
    """Single-step reaching with a UR5: one action is one posture.

    ## Description
    A UR5 with a gripper stands before a table on which a red ball lies. One action sets all six joints; the arm moves
    there, the episode is over. The task is that of the thesis's single-step path planning (sections 3.4.2 to 3.4.5).

    ## Action Space
    `Box(-1, 1, (6,), float32)`: joint targets in units of pi rad. What is outside [-1, 1] is clipped.

    | Num | Action | Min | Max | Unit of the target |
    |-----|--------|-----|-----|--------------------|
    | 0 | target of shoulder_pan_joint | -1 | 1 | pi rad |
    | 1 | target of shoulder_lift_joint | -1 | 1 | pi rad |
    | 2 | target of elbow_joint | -1 | 1 | pi rad |
    | 3 | target of wrist_1_joint | -1 | 1 | pi rad |
    | 4 | target of wrist_2_joint | -1 | 1 | pi rad |
    | 5 | target of wrist_3_joint | -1 | 1 | pi rad |

    With `backend="mujoco"` all joints but shoulder_lift move first, then shoulder_lift, by dynamics: the gripper comes
    from above. With `backend="kinematic"` the posture is taken at once; limits and collisions of it are still judged.

    ## Observation Space
    `Box(13,), float64`. The goal is measured once per episode, in the start pose, in the optical frames of the cameras
    (x right, y down, z forward). `observation="geometric"` gives its true position; `"camera"` what is found in the
    rendered images (0, 0, 0 where no ball is found: no goal for that episode, and `info["ball_found"]` says so);
    `"pixels"` gives a `Dict` with the images instead (`front_rgb`, `front_depth`, `wrist_rgb`, `wrist_depth`, `joints`,
    `gripper`).

    | Num | Observation | Min | Max | Unit |
    |-----|-------------|-----|-----|------|
    | 0 | goal in the front camera, x | -2 | 2 | m |
    | 1 | goal in the front camera, y | -2 | 2 | m |
    | 2 | goal in the front camera, z | -2 | 2 | m |
    | 3 | goal in the wrist camera, x | -2 | 2 | m |
    | 4 | goal in the wrist camera, y | -2 | 2 | m |
    | 5 | goal in the wrist camera, z | -2 | 2 | m |
    | 6 | angle of shoulder_pan_joint | -3.161593 | 3.161593 | rad |
    | 7 | angle of shoulder_lift_joint | -3.161593 | 3.161593 | rad |
    | 8 | angle of elbow_joint | -3.161593 | 3.161593 | rad |
    | 9 | angle of wrist_1_joint | -3.161593 | 3.161593 | rad |
    | 10 | angle of wrist_2_joint | -3.161593 | 3.161593 | rad |
    | 11 | angle of wrist_3_joint | -3.161593 | 3.161593 | rad |
    | 12 | opening of the gripper | 0 | 2 | m |

    ## Rewards
    With d the distance from the tcp to the ball's centre and r_e the posture error (natural arm plus gripper angle,
    `kinreach.thesis.reward`): r_d - r_e with r_d = 1 - d/2 for d >= 2 m, else 0.5 - 0.5 log2(d);
    10 - r_e for d < 0.01 m; 20 for d < 0.01 m and r_e < 0.15 (reached); -100 where the action is impossible: a target
    outside the limits, or one that the arm does not attain because something is in the way (`info["impossible_reason"]`
    says what). `info["reward_terms"]` has the terms `natural_arm`, `gripper_angle`, `distance` and `special`; their sum
    is the reward.

    ## Starting State
    The arm stands in [-pi/2, -pi/2, pi/2, -pi/2, -pi/2, 0] rad. The ball lies on the table, uniformly in
    0.30 <= x <= 0.65 m and -0.30 <= y <= 0.30 m of the world frame; `reset(options={"goal": (x, y, z)})` puts it
    elsewhere.

    ## Episode End
    Every episode terminates after its only action.

    ## Arguments

    | Parameter | Default | Description |
    |-----------|---------|-------------|
    | `observation` | `"geometric"` | `"camera"`, `"geometric"` or `"pixels"` |
    | `backend` | `"mujoco"` | `"mujoco"` (dynamics) or `"kinematic"` |
    | `render_mode` | `None` | `"human"`, `"rgb_array"`, `"rgb_array_list"` (frames of the motion) or `"depth_array"` |
    | `pipeline` | `"hybrid"` | how the ball is found: `"hybrid"` or the thesis's own, `"thesis"` |
    | `width` | `640` | width of the cameras' images [px] |
    | `height` | `360` | height of the cameras' images [px] |
    | `rgb_noise` | `0.0` | standard deviation of the colours' noise [levels of 255] |
    | `depth_noise` | `0.0` | standard deviation of the depth's noise [m] |
    | `end_on_reached` | `True` | means nothing here: there is one step |

    ## Version History
    * v0: initial version
    """

    variant = SINGLE_STEP


class UR5MultiStepEnv(UR5ReachEnv):
    """Multi-step reaching with a UR5: every action turns the joints by up to 5 degrees.

    ## Description
    A UR5 with a gripper stands before a table on which a red ball lies. Each action turns all six joints a little, at
    once. The task is that of the thesis's multi-step path planning (sections 3.4.2 to 3.4.5).

    ## Action Space
    `Box(-1, 1, (6,), float32)`: changes of the joint angles in units of 5 degrees. What is outside [-1, 1] is clipped.

    | Num | Action | Min | Max | Unit of the change |
    |-----|--------|-----|-----|--------------------|
    | 0 | change of shoulder_pan_joint | -1 | 1 | 5 degrees |
    | 1 | change of shoulder_lift_joint | -1 | 1 | 5 degrees |
    | 2 | change of elbow_joint | -1 | 1 | 5 degrees |
    | 3 | change of wrist_1_joint | -1 | 1 | 5 degrees |
    | 4 | change of wrist_2_joint | -1 | 1 | 5 degrees |
    | 5 | change of wrist_3_joint | -1 | 1 | 5 degrees |

    The change counts from where the joint stands, not from where it was sent.

    ## Observation Space
    As in `kinreach/UR5SingleStep-v0`; the joint angles are those of the present posture, the goal is the one measured
    in the start pose.

    | Num | Observation | Min | Max | Unit |
    |-----|-------------|-----|-----|------|
    | 0 | goal in the front camera, x | -2 | 2 | m |
    | 1 | goal in the front camera, y | -2 | 2 | m |
    | 2 | goal in the front camera, z | -2 | 2 | m |
    | 3 | goal in the wrist camera, x | -2 | 2 | m |
    | 4 | goal in the wrist camera, y | -2 | 2 | m |
    | 5 | goal in the wrist camera, z | -2 | 2 | m |
    | 6 | angle of shoulder_pan_joint | -3.161593 | 3.161593 | rad |
    | 7 | angle of shoulder_lift_joint | -3.161593 | 3.161593 | rad |
    | 8 | angle of elbow_joint | -3.161593 | 3.161593 | rad |
    | 9 | angle of wrist_1_joint | -3.161593 | 3.161593 | rad |
    | 10 | angle of wrist_2_joint | -3.161593 | 3.161593 | rad |
    | 11 | angle of wrist_3_joint | -3.161593 | 3.161593 | rad |
    | 12 | opening of the gripper | 0 | 2 | m |

    ## Rewards
    As in `kinreach/UR5SingleStep-v0`, after every step. An impossible change (outside the limits, or held off by
    something) pays -100 and the episode goes on from where the arm stands.

    ## Starting State
    As in `kinreach/UR5SingleStep-v0`.

    ## Episode End
    Terminated when the goal is reached (d < 0.01 m and r_e < 0.15), unless `end_on_reached=False`; truncated after
    100 steps, or when the simulation diverges (`info["impossible_reason"]` begins with "diverged"). The thesis says
    both that an episode has 100 actions (section 3.4.5) and that it may end when the goal is reached (section 5.3);
    the default is the latter.

    ## Arguments

    | Parameter | Default | Description |
    |-----------|---------|-------------|
    | `observation` | `"geometric"` | `"camera"`, `"geometric"` or `"pixels"` |
    | `backend` | `"mujoco"` | `"mujoco"` (dynamics) or `"kinematic"` |
    | `render_mode` | `None` | `"human"`, `"rgb_array"`, `"rgb_array_list"` (frames of the motion) or `"depth_array"` |
    | `pipeline` | `"hybrid"` | how the ball is found: `"hybrid"` or the thesis's own, `"thesis"` |
    | `width` | `640` | width of the cameras' images [px] |
    | `height` | `360` | height of the cameras' images [px] |
    | `rgb_noise` | `0.0` | standard deviation of the colours' noise [levels of 255] |
    | `depth_noise` | `0.0` | standard deviation of the depth's noise [m] |
    | `end_on_reached` | `True` | whether reaching the goal ends the episode |

    ## Version History
    * v0: initial version
    """

    variant = MULTI_STEP
