"""What the single-step and the multi-step environment share."""

from __future__ import annotations

from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.utils import EzPickle
from numpy.typing import ArrayLike

from kinreach.envs.picture import ScenePicture
from kinreach.envs.reach.dynamic_world import SingleDynamicWorld
from kinreach.envs.reach.episodes import Outcome, ReachEpisodes
from kinreach.envs.reach.kinematic_world import KinematicWorld
from kinreach.envs.reach.options import ReachOptions
from kinreach.envs.reach.pixels import PixelObserver
from kinreach.envs.reach.task import (
    ReachVariant,
    action_space,
    check_actions,
    observation_space,
    reset_options,
)
from kinreach.envs.reach.world import ReachWorld
from kinreach.envs.resets import check_seed
from kinreach.envs.simulation import ArmSimulation
from kinreach.inputs import check_known
from kinreach.kinematics.reward_geometry import posture_error

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
