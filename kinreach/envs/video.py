"""Films of episodes with the motion of every step."""

from __future__ import annotations

from typing import Any

from gymnasium.wrappers import RecordVideo

from kinreach.errors import InputError


class RecordMotion(RecordVideo):
    """Gymnasium's `RecordVideo`, with all frames of the motion of each step instead of the last one.

    A step of the single-step task is a whole motion, of which `RecordVideo` would keep two pictures.

    Args:
        env: Made with `render_mode="rgb_array_list"`.
        *args: As those of `RecordVideo`.
        **kwargs: As those of `RecordVideo`.

    Raises:
        InputError: The environment has another render mode.
    """

    def __init__(self, env: Any, *args: Any, **kwargs: Any) -> None:
        if env.render_mode != "rgb_array_list":
            raise InputError(f'RecordMotion needs render_mode="rgb_array_list", got {env.render_mode!r}')
        super().__init__(env, *args, **kwargs)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step, and keep the frames of the motion."""
        known = len(self.render_history)
        result = super().step(action)
        if self.recording:
            self.recorded_frames[-1:-1] = self.render_history[known:-1]
        return result
