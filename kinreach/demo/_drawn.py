"""Draw environments that do not draw themselves: in their own scene, or in one that follows their `info`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import gymnasium as gym

from kinreach.compare.inside import arm_in
from kinreach.errors import InputError
from kinreach.sim.inside import PosedScene, ScenePicture


class EpisodeScene:
    """The scene of an episode: the environment's own, or one that follows its `info`.

    Args:
        env: The environment, after its reset.
        info: Of the reset.

    Attributes:
        scene: The scene.
        arm: The arm that is drawn: the believed one, if the true one differs.
        follows: Whether it has to follow `info`.

    Raises:
        InputError: The environment has no arm, or neither a scene nor a posture `q` in its info.
    """

    def __init__(self, env: gym.Env[Any, Any], info: Mapping[str, Any]) -> None:
        arm = arm_in(env)
        if arm is None:
            raise InputError(f"{_name(env)} cannot be drawn: it has no `arm`")
        self.arm, self.follows = arm, not env.has_wrapper_attr("scene")
        if self.follows and "q" not in info:
            raise InputError(f"{_name(env)} cannot be drawn: it has no `scene`, and no posture `q` in its info")
        self.scene: Any = PosedScene(arm) if self.follows else env.get_wrapper_attr("scene")

    def follow(self, info: Mapping[str, Any], *, time: float) -> None:
        """Move the scene to `info`'s state, if it has to; without a clock in it, at `time` [s]."""
        if self.follows:
            self.scene.put(info["q"], ball=info.get("goal"), time=float(info.get("time", time)))


def _name(env: gym.Env[Any, Any]) -> str:
    return env.spec.id if env.spec is not None else "the environment"


class Drawn(gym.Wrapper[Any, Any, Any, Any]):
    """Draw an environment that does not draw itself."""

    def __init__(
        self, env: gym.Env[Any, Any], *, mode: str, fps: int, prepare: Callable[[ScenePicture], object] | None = None
    ) -> None:
        super().__init__(env)
        self._prepare = prepare
        self._mode, self._fps = mode, fps
        self._picture: ScenePicture | None = None
        self._steps = 0

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:
        """Begin an episode, perhaps with another arm."""
        observation, info = self.env.reset(**options)
        self._close_picture()
        self._scene = EpisodeScene(self.env, info)
        self._picture = ScenePicture(self._scene.scene, mode=self._mode, fps=self._fps)
        if self._prepare is not None:
            self._prepare(self._picture)
        self._steps = 0
        self._follow(info)
        return observation, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        result = self.env.step(action)
        self._steps += 1
        self._follow(result[4])
        return result

    def render(self) -> Any:
        return None if self._picture is None else self._picture.frame()

    def close(self) -> None:
        self._close_picture()
        super().close()

    def _follow(self, info: Mapping[str, Any]) -> None:
        self._scene.follow(info, time=self._steps / self._fps)
        if self._scene.follows and self._scene.scene.watch is not None:
            self._scene.scene.watch()

    def _close_picture(self) -> None:
        if self._picture is not None:
            self._picture.close()
        self._picture = None
