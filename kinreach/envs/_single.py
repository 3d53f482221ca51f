"""Single environments: the episodes of a task with a count of one, copies of them, and videos of their motion."""

from __future__ import annotations

import pickle
from abc import abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Self

import gymnasium as gym
import numpy as np
from gymnasium.utils import EzPickle
from gymnasium.wrappers import RecordVideo
from numpy.typing import ArrayLike

from kinreach._checks import Floats, shown
from kinreach.envs._batch import Episodes, Ids, Outcome, first_row, numbers_of, picture_of
from kinreach.envs._options import RENDER_MODES, EnvOptions, check_seed, check_started, in_dtype, options_from
from kinreach.envs._state import put_back, saved
from kinreach.errors import InputError, NoDynamicsError
from kinreach.kinematics import ArmKinematics
from kinreach.robots import ArmDescription
from kinreach.sim import ArmSimulation
from kinreach.sim.inside import FPS, WARP, Scene
from kinreach.vision.inside import GoalMeasurement

#: The environments of episodes with a count of one.
ONLY: Ids = np.zeros(1, dtype=np.intp)


#: Attributes of an environment that change.
_CHANGING = ("episodes", "_np_random", "_np_random_seed", "_started", "_over")


@dataclass(frozen=True, eq=False)
class EnvState:
    """The state of an environment; `values` are its own business."""

    values: Mapping[str, Any]


class WithModel:
    """MuJoCo's model and state, where users of Gymnasium's MuJoCo environments look for them."""

    @property
    def _dynamics(self) -> Scene | None:
        """What is simulated; None without dynamics."""
        return None

    @property
    def model(self) -> Any:
        """MuJoCo's model (`mujoco.MjModel`), of this environment only: what is written to it acts in the next step.

        Raises:
            NoDynamicsError: The environment has no dynamics.
        """
        return self._simulated("model").model

    @property
    def data(self) -> Any:
        """MuJoCo's state (`mujoco.MjData`).

        Raises:
            NoDynamicsError: The environment has no dynamics.
        """
        return self._simulated("data").data

    def _simulated(self, attribute: str) -> Scene:
        if (simulated := self._dynamics) is not None:
            return simulated
        backend = getattr(getattr(self, "options", None), "backend", None)
        what = "is kinematics only" if backend is None else f'has backend={backend!r}; backend="mujoco" has dynamics'
        raise NoDynamicsError(f"there is no `{attribute}` of MuJoCo without dynamics: {type(self).__name__} {what}")


class SingleEnv(WithModel, gym.Env[Any, Any], EzPickle):
    """One environment of a task; a subclass has its `Options`, its `episodes_class` or `_new_episodes`, and a `scene`.

    Deep copies keep the state. Pickles keep only the options, as in Gymnasium: reset the result before its first step.

    Attributes:
        options: As given.
        episodes: The task.
        goes_on: Whether an episode that has ended may be stepped on.
    """

    Options: ClassVar[type[Any]] = EnvOptions
    episodes_class: ClassVar[type[Any]]
    goes_on: ClassVar[bool] = False
    metadata = {"render_modes": list(RENDER_MODES), "render_fps": FPS}  # noqa: RUF012 (declared by Gymnasium)
    options: Any
    episodes: Any
    _started = _over = False

    def __init__(self, **options: Any) -> None:
        EzPickle.__init__(self, **options)
        self.options = self._checked(options)
        if getattr(self.options, "backend", None) == WARP:
            raise InputError(
                'backend="warp" is of native batches: gym.make_vec(..., vectorization_mode="vector_entry_point")'
            )
        self.episodes = self._new_episodes(self.options)
        self.action_space = self.episodes.action_space
        self.observation_space = in_dtype(self.episodes.observation_space, self.options.dtype)
        self.render_mode = self.options.render_mode
        self.metadata = {**self.metadata, "render_fps": self.episodes.fps}
        self._picture = None if self.render_mode is None else picture_of(self._first_scene(), self.options)

    @property
    @abstractmethod
    def scene(self) -> Scene:
        """What `render` draws."""

    def _first_scene(self) -> Scene:
        """Return what is drawn before the first reset."""
        return self.scene

    def _checked(self, options: dict[str, Any]) -> EnvOptions:
        """Check the options."""
        return options_from(self.Options, options)

    def _new_episodes(self, options: Any) -> Episodes:
        return self.episodes_class(options, 1)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode.

        Args:
            seed: Of all random numbers of this episode and the next ones.
            options: Values that the episode starts with instead of random ones, as the class describes.

        Raises:
            InputError: A seed that is not an integer at least 0, an unknown option, or one that is malformed.
        """
        seed, start = check_seed(seed), self.episodes.check_start(options, None)
        super().reset(seed=seed)
        if seed is not None or not self._started:
            self.episodes.seed(0, self.np_random)
        self.episodes.begin(ONLY, start)
        self._started, self._over = True, False
        self._follow()
        return self._observe(), self._info(self.episodes.start_info(ONLY))

    def step(self, action: ArrayLike) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Act once.

        Raises:
            InputError: An action that is not in the action space, or a step before the first reset, or, unless the
                episode `goes_on`, after its end.
        """
        check_started(self._started)
        if self._over and not self.goes_on:
            raise InputError("the episode is over; reset the environment")
        return self._answer(self.episodes.step(self.episodes.check_actions(action, None)))

    def save_state(self) -> EnvState:
        """Return the state in mid-episode: of the arm, its world, the task and the random numbers.

        The limit of steps is a wrapper's and not a part of it. Nor are meshes and textures of MuJoCo's model; its other
        fields are, so that what was randomised there comes back.

        Raises:
            InputError: There was no reset yet.
        """
        check_started(self._started)
        return EnvState({name: saved(vars(self).get(name)) for name in _CHANGING})

    def restore_state(self, state: EnvState) -> None:
        """Go on from a state, bit for bit: in this environment, or in another one with the same options.

        Args:
            state: Of `save_state`; it can be restored any number of times.

        Raises:
            InputError: It is none, or of an environment with other options.
        """
        if not isinstance(state, EnvState):
            raise InputError(f"state must be what save_state returned, got {shown(state)}")
        if not self._started:
            self.reset(seed=0)  # what is made by the first reset is filled in
        try:
            self._put_back(state)
        except InputError as error:
            self._put_back_into_more(state, error)
        self._follow()

    def _put_back_into_more(self, state: EnvState, error: InputError) -> None:
        for _ in self._made_later():
            try:
                return self._put_back(state)
            except InputError:
                continue
        raise error

    def _made_later(self) -> Iterator[None]:
        """Make what is made when it is first needed, one after the other."""
        for name in ("model", "scene"):
            with suppress(NoDynamicsError):
                getattr(self, name)
                yield

    def _put_back(self, state: EnvState) -> None:
        for name, then in state.values.items():
            setattr(self, name, put_back(vars(self).get(name), then))

    def __getstate__(self) -> dict[str, Any]:
        return {**super().__getstate__(), "spec": self.spec}

    def __setstate__(self, state: dict[str, Any]) -> None:
        super().__setstate__(state)
        self.spec = state["spec"]

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        new = pickle.loads(pickle.dumps(self))
        if self._started:
            new.restore_state(self.save_state())
        return new

    def render(self) -> Any:
        """Draw a frame in the `render_mode`; with "human" update the viewer.

        Returns:
            "rgb_array": uint8, (height, width, 3); "rgb_array_list": a list of such, those of the motion since the
            last call; "depth_array": float32 [m], (height, width); else None.
        """
        return None if self._picture is None else self._picture.frame()

    def close(self) -> None:
        """Close the viewer and free the renderers; further calls do nothing."""
        self.episodes.close()
        if self._picture is not None:
            self._picture.close()

    def _follow(self) -> None:
        """Update the drawn scene after a reset; of some environments after a step, too."""

    def _answer(self, outcome: Outcome) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        terminated, truncated = bool(outcome.terminated[0]), bool(outcome.truncated[0])
        self._over = terminated or truncated
        return self._observe(), float(outcome.reward[0]), terminated, truncated, self._info(outcome.info)

    def _observe(self) -> Any:
        observed = in_dtype(self.episodes.observe(), self.options.dtype)
        return {name: rows[0] for name, rows in observed.items()} if isinstance(observed, Mapping) else observed[0]

    def _info(self, info: dict[str, Any]) -> dict[str, Any]:
        row = first_row(info)
        return numbers_of(row) if self.options.info == "numbers" else row


class ForfeitEnv(SingleEnv):
    """An environment whose agents may find no action."""

    def forfeit(self, reason: str) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """End the episode of an agent that finds no action: impossible, and the arm stays where it is.

        Args:
            reason: Why, for `info["impossible_reason"]`.

        Returns:
            As `step`.
        """
        check_started(self._started)
        return self._answer(self.episodes.forfeit(str(reason)))


class ArmEnv(SingleEnv):
    """An environment with one arm; a subclass sets `_task` and `_simulation`."""

    _task: Any
    _simulation: ArmSimulation

    @property
    def _dynamics(self) -> Scene | None:
        return self._simulation if self.options.backend == "mujoco" else None

    @property
    def arm(self) -> ArmDescription:
        """The arm, in its work cell."""
        return self._simulation.arm

    @property
    def measurement(self) -> GoalMeasurement | None:
        """The cameras' last measurement of the goal, with pictures and circles; None where nothing is rendered."""
        found: GoalMeasurement | None = self.episodes.measurement
        return found

    @cached_property
    def kinematics(self) -> Any:
        """The arm's kinematics from the world to its default tip, with a closed form if the arm has one."""
        return ArmKinematics.of(self.arm, base="world")

    @property
    def scene(self) -> Scene:
        """What `render` draws; while reaching with `backend="kinematic"` it moves only if there is a `render_mode`."""
        return self._simulation

    @property
    def home(self) -> Floats:
        """The start posture [rad], shape (n,)."""
        return np.array(self._task.home)

    def _answer(self, outcome: Outcome) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self._follow()
        if self.render_mode == "human":
            self.render()
        return super()._answer(outcome)


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
