"""Native batches of environments, and the random starts that they draw ahead."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import MAX_THREADS, Floats, as_flags, check_count, check_known, is_tensor, shown
from kinreach._tensors import as_device, copied, like, on_device, on_host
from kinreach.envs._options import (
    EnvOptions,
    check_limit,
    check_seed,
    check_started,
    in_dtype,
    options_from,
)
from kinreach.errors import InputError
from kinreach.robots import BoxRegion, Workcell
from kinreach.sim.inside import FPS, Scene, ScenePicture
from kinreach.vision.inside import GoalMeasurement

#: Rows drawn at a time. Part of what a seed means: changing it may change the goals that follow from a seed.
ROWS_AHEAD = 256
#: Environments for which they are drawn before they are put in place: as many as fit into the cache. Freeing an array
#: of that size also makes glibc keep the memory that every step allocates.
STREAMS_AT_ONCE = 256
#: More environments than this are not drawn.
MAX_DRAWN = 64

Ids = NDArray[np.intp]
Flags = NDArray[np.bool_]


def first_row(info: Mapping[str, Any]) -> dict[str, Any]:
    """Return the `info` of a single environment from that of a batch of one."""
    return {
        name: first_row(value)
        if isinstance(value, Mapping)
        else value[0].copy()
        if value.ndim > 1
        else value.tolist()[0]
        for name, value in info.items()
    }


def numbers_of(info: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries of an `info` that are numbers or arrays of numbers."""
    return {
        name: value
        for name, value in info.items()
        if is_tensor(value) or (not isinstance(value, str | Mapping) and np.asarray(value).dtype.kind in "biuf")
    }


def with_rows(info: Mapping[str, Any], ids: Ids, rows: Mapping[str, Any]) -> dict[str, Any]:
    """Return the `info` of a batch with entries of some environments replaced by rows."""
    return {**info, **{name: _with_rows(info[name], ids, value) for name, value in rows.items()}}


def _with_rows(values: Any, ids: Ids, rows: Any) -> Any:
    if isinstance(values, Mapping):
        return with_rows(values, ids, rows)
    if len(values) == len(rows):
        return rows
    changed = copied(values)
    changed[ids] = like(values, rows)
    return changed


def texts(count: int) -> NDArray[Any]:
    """Return empty texts, shape (count,); as objects, so that longer ones have the same type."""
    return np.full(count, "", dtype=object)


#: Draws a number of rows of numbers, shape (count, size), such as `Workcell.draw_goals`, with rows of three.
Sample = Callable[[np.random.Generator, int], Floats]


class RowStreams:
    """An endless sequence of rows for each environment: goals, or other values that an episode starts with.

    A sequence depends on its own generator only, not on the number of environments. A row has `size` numbers. Many are
    drawn `at_once`, unless each takes long.
    """

    def __init__(self, sample: Sample, count: int, *, size: int = 3, at_once: int = ROWS_AHEAD) -> None:
        self._sample, self._at_once = sample, at_once
        self._rngs = [np.random.default_rng() for _ in range(count)]
        self._ahead = np.empty((at_once, count, size))  # environments in step read what lies side by side
        self._next = np.full(count, at_once)

    def seed(self, index: int, rng: np.random.Generator) -> None:
        """Restart an environment's sequence with a generator, which it then owns."""
        self._rngs[index] = rng
        self._next[index] = self._at_once

    def draw(self, ids: np.ndarray) -> Floats:
        """Draw the next row of each of the given environments, shape (len(ids), size)."""
        return self._taken(ids).copy()

    def _taken(self, ids: np.ndarray) -> Floats:
        """Return the same as `draw`, valid until the next call."""
        turns = self._next[ids]
        empty = ids[turns == self._at_once]
        for start in range(0, len(empty), STREAMS_AT_ONCE):
            some = empty[start : start + STREAMS_AT_ONCE]
            run = some[-1] - some[0] == len(some) - 1
            self._ahead[:, slice(some[0], some[-1] + 1) if run else some] = self._drawn(some).swapaxes(0, 1)
        turns[turns == self._at_once] = 0
        self._next[ids] = turns + 1
        in_step = len(ids) == len(self._next) and (turns == turns[0]).all()
        rows: Floats = self._ahead[turns[0]] if in_step else self._ahead[turns, ids]
        return rows

    def _drawn(self, ids: np.ndarray) -> Floats:
        return np.array([self._sample(self._rngs[index], self._at_once) for index in ids])


class GoalStreams(RowStreams):
    """What `BoxRegion.sample` draws for each of a number of environments, to the bit, in a third of the time."""

    def __init__(self, region: BoxRegion, count: int) -> None:
        super().__init__(region.sample, count)
        self._low, high = np.array([region.x, region.y, region.z]).T
        self._size = high - self._low

    def draw(self, ids: np.ndarray) -> Floats:
        goals = self._size * self._taken(ids)
        goals += self._low
        return goals

    def _drawn(self, ids: np.ndarray) -> Floats:
        """Places in a box from 0 to 1; they are brought into the region when their turn comes."""
        places = np.empty((len(ids), ROWS_AHEAD, 3))
        for index, place in zip(ids, places, strict=True):
            self._rngs[index].random(out=place)
        return places


def goal_streams(cell: Workcell, count: int) -> RowStreams:
    return GoalStreams(cell.goals, count) if isinstance(cell.goals, BoxRegion) else RowStreams(cell.draw_goals, count)


def picture_of(scene: Scene, options: EnvOptions) -> ScenePicture:
    """Return what draws a scene as the options of an environment with a `render_mode` say."""
    return ScenePicture(
        scene,
        mode=str(options.render_mode),
        camera=options.render_camera,
        size=(options.render_width, options.render_height),
    )


class BatchPicture:
    """Draws the environments of a batch with one scene; `show` puts it into the state of one of them."""

    def __init__(self, scene: Scene, show: Callable[[int], None], options: EnvOptions) -> None:
        self._show = show
        self._picture = picture_of(scene, options)

    def frame(self, index: int) -> Any:
        """Return a frame of one environment, uint8, shape (height, width, 3)."""
        self._show(index)
        return self._picture.frame()

    def close(self) -> None:
        self._picture.close()


class Episodes(ABC):
    """The episodes of a number of environments: a task without Gymnasium's interface.

    Attributes:
        options: Of the environments.
        action_space, observation_space: Of one environment.
        goals: Of the present episodes, such as places in the world [m]; a row for each environment.
        measurement: The cameras' last measurement of a goal; None where nothing is rendered.
        fps: Steps a second of motion, for films of them.
    """

    options: Any
    goals: Floats
    action_space: Any
    observation_space: Any
    measurement: GoalMeasurement | None = None
    fps: int = FPS

    @abstractmethod
    def seed(self, index: int, rng: np.random.Generator) -> None:
        """Give an environment its own generator."""

    @abstractmethod
    def check_start(self, options: Mapping[str, Any] | None, count: int | None) -> Any:
        """Return the checked options of `reset`: a named tuple of arrays with a row for each environment, or None.

        With a `count` they are those of a batch, else of a single environment.
        """

    @abstractmethod
    def check_actions(self, actions: ArrayLike, count: int | None) -> Any:
        """Return the checked actions of a batch, or the action of a single environment as a row of one."""

    @abstractmethod
    def begin(self, ids: Ids, start: Any = ...) -> None:
        """Start new episodes of some environments; `start` is as of `check_start`, with a row for each of them."""

    @abstractmethod
    def step(self, actions: Any, acting: Flags | None = None) -> Outcome:
        """Act in all environments, or in those where `acting` is True."""

    @abstractmethod
    def observe(self) -> Any:
        """Return the observations of all environments."""

    @abstractmethod
    def start_info(self, ids: Ids) -> dict[str, Any]:
        """Return the `info` of a reset of some environments, arrays of as many rows.

        It has the entries of the `info` of a step, of the same types. What only a step knows is False, 0 or empty.
        """

    def goal_info(self, rows: Any) -> dict[str, Any]:
        """Return the entries of it about the goals."""
        return {"goal": np.array(self.goals[rows])}

    def close(self) -> None:  # noqa: B027 (most have none)
        """Free the renderers of the episodes; here there are none."""


def told_terms(terms: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries of an `info` with the terms of the reward, as a dictionary and one by one."""
    return {"reward_terms": terms, **{f"reward_{name}": term for name, term in terms.items()}}


@dataclass(frozen=True, eq=False)
class Outcome:
    """Result of one step of all environments; every array has the number of environments first.

    Attributes:
        reward, terminated, truncated: As Gymnasium has them, shape (count,).
        info: Of the step. Its arrays and the reward may be tensors already.
    """

    reward: Floats
    terminated: Flags
    truncated: Flags
    info: dict[str, Any]

    def of(self, acting: Flags) -> Outcome:
        """Return it with reward 0 and no end where an environment did not act; `info` means nothing there."""
        reward = np.where(acting, on_host(self.reward), 0.0)
        return Outcome(reward, self.terminated & acting, self.truncated & acting, self.info)


class NativeVectorEnv(VectorEnv[Floats, ArrayLike, Floats]):
    """A batch of equal environments, each what a single one with its seed would be.

    With `AutoresetMode.SAME_STEP`, the default, an episode that ends starts anew in the same step: the observation
    returned is the first of the new episode, `info["final_obs"]` is the last of the old one where `info["_final_obs"]`
    is True, and `info["final_info"]` holds the single environment's `info`, as arrays. The other entries of `info` are
    those of the last step, except those about the goal, which are the new episode's. With `NEXT_STEP` the step after
    an end starts the next episode and ignores the action: the reward is 0, and `info` is that of a reset. With
    `DISABLED` episodes are restarted by `reset(options={"reset_mask": mask})`, bool, shape (num_envs,).

    Episodes are truncated after `max_episode_steps`, as Gymnasium's `TimeLimit` does with single environments.

    As in Gymnasium's own batches, each entry `key` of `info` has a mask `_key`, bool, shape (num_envs,): whether this
    reset or step is the environment's. `reward_terms` has none inside, so that its values sum to the reward. The masks
    of one step share their memory.

    With `device=`, what `reset` and `step` return are torch tensors on that device, except the texts in `info`;
    actions and options of `reset` may be tensors anyway.

    A subclass has the single environment's `Options`, and its `episodes_class` or `_new_episodes`; if it is `drawn`, a
    `_new_picture`, too.

    Args:
        num_envs: Number of environments.
        threads: Threads that step the dynamics, where there are any.
        max_episode_steps: Steps after which episodes are truncated; None for those of `registered_limit`, -1 for none.
        autoreset_mode: Gymnasium's, or its value.
        device: Of torch, such as `"cuda"` or `"cpu"`; None for arrays of numpy.
        **options: As in the single environment. A `render_mode` is None or `"rgb_array"`, for up to 64 environments,
            where the batch can be drawn.

    Attributes:
        options: As given.
        episodes: The task.
        max_episode_steps: None without a limit.
        device: Of the tensors; None for arrays.

    Raises:
        InputError: Invalid options, an unknown mode, a limit below 1, or no such device.
        InstallationError: Tensors without torch.
    """

    #: Of the ids of a class.
    registered_limit: ClassVar[int]
    Options: ClassVar[type[Any]] = EnvOptions
    episodes_class: ClassVar[type[Any]]
    drawn: ClassVar[bool] = False
    options: Any
    episodes: Any
    max_episode_steps: int | None

    metadata = {  # noqa: RUF012 (declared by Gymnasium)
        "render_modes": ["rgb_array"],
        "render_fps": FPS,
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        *,
        threads: int = 1,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
        device: str | None = None,
        **options: Any,
    ) -> None:
        self.options = given = self._checked(options)
        self.num_envs = check_count("num_envs", num_envs, most=2**17)  # refused before memory is asked for
        check_count("threads", threads, most=MAX_THREADS)
        self.max_episode_steps = check_limit(max_episode_steps, self.registered_limit)
        try:
            mode = AutoresetMode(autoreset_mode)
        except ValueError:
            names = ", ".join(mode.value for mode in AutoresetMode)
            raise InputError(f"autoreset_mode must be one of {names}, got {shown(autoreset_mode)}") from None
        self.render_mode = given.render_mode
        if self.render_mode is not None:
            if not self.drawn:
                raise InputError(
                    f"a native batch of this task is not drawn, got render_mode={self.render_mode!r}; "
                    "gym.make draws one environment"
                )
            check_known("render_mode of a native batch", self.render_mode, self.metadata["render_modes"])
            if num_envs > MAX_DRAWN:
                raise InputError(f"a native batch draws at most {MAX_DRAWN} environments, got {num_envs}")
        self.device = None if device is None else as_device(device)
        self.episodes = episodes = self._new_episodes(given, threads, device)
        self._picture = None if self.render_mode is None else self._new_picture()
        self.metadata = {**self.metadata, "autoreset_mode": mode, "render_fps": episodes.fps}
        self.single_action_space = episodes.action_space
        self.single_observation_space = in_dtype(episodes.observation_space, given.dtype)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.autoreset_mode = self._mode = mode  # the first is where TorchRL looks for it
        self._everyone = np.arange(self.num_envs)
        self._started = False
        self._ended = np.zeros(self.num_envs, dtype=np.bool_)
        self._elapsed = np.zeros(self.num_envs, dtype=np.int64)  # steps of the present episodes

    def _checked(self, options: dict[str, Any]) -> EnvOptions:
        """Check the options."""
        return options_from(self.Options, options)

    def _new_episodes(self, options: Any, threads: int, device: str | None) -> Episodes:
        """Return the episodes; those without dynamics need no threads."""
        return self.episodes_class(options, self.num_envs)

    def _new_picture(self) -> BatchPicture:
        """Return what draws one environment after the other, where the batch is `drawn`."""
        raise NotImplementedError

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Start the episodes of all environments, or of some.

        Args:
            seed: Of the first environment (the others count up), or one for each.
            options: As those of the single environment, one row for each environment; and `"reset_mask"`, bool, shape
                (num_envs,): which environments start anew (all by default).

        Raises:
            InputError: Unknown or malformed options, a wrong number of seeds, or a mask before all have started.
        """
        if isinstance(options, Mapping):
            options = {name: on_host(value) for name, value in options.items()}
        mask, others = self._reset_mask(options)
        start = self.episodes.check_start(others, self.num_envs)
        seeds = self._checked_seeds(seed)
        ids = self._everyone if mask is None else np.flatnonzero(mask)
        for index in ids:
            if seeds[index] is not None or not self._started:
                self.episodes.seed(int(index), seeding.np_random(seeds[index])[0])
        rows = [value if value is None or mask is None else value[ids] for value in start]
        self._begin(ids, type(start)(*rows))
        self._started = True
        self._ended[ids] = False
        info = self._selected(self.episodes.start_info(self._everyone))
        restarted = np.ones(self.num_envs, dtype=np.bool_) if mask is None else mask.copy()
        return self._handed_out(self._observe(), self._masked(info, restarted))

    def step(self, actions: ArrayLike) -> tuple[Floats, Floats, Any, Any, dict[str, Any]]:
        """Act in all environments.

        Args:
            actions: One for each environment, shape (num_envs, ...).

        Raises:
            InputError: Malformed actions, a step before the first reset, or with `AutoresetMode.DISABLED` one of an
                environment whose episode has ended.
        """
        check_started(self._started)
        checked = self.episodes.check_actions(on_host(actions), self.num_envs)
        if self._mode is AutoresetMode.SAME_STEP:
            return self._step_and_restart(checked)
        acting: Flags | None = None
        begun = np.flatnonzero(self._ended)
        if len(begun):
            if self._mode is AutoresetMode.DISABLED:
                raise InputError(
                    f"the episodes of environments {shown(np.flatnonzero(self._ended).tolist())} have ended; "
                    'reset(options={"reset_mask": mask}) starts new ones'
                )
            self._begin(begun)
            acting = ~self._ended
        outcome = self._act(checked, acting)
        self._ended = outcome.terminated | outcome.truncated
        info = self._selected(outcome.info)
        if len(begun):
            info = with_rows(info, begun, self._selected(self.episodes.start_info(begun)))
        info = self._masked(info)
        return self._handed_out(self._observe(), outcome.reward, outcome.terminated, outcome.truncated, info)

    def render(self) -> tuple[Any, ...] | None:
        """With `render_mode="rgb_array"` a frame of each environment, uint8, shape (height, width, 3); else None."""
        if self._picture is None:
            return None
        return tuple(self._picture.frame(index) for index in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:
        """Free the graphics memory of cameras and pictures."""
        self.episodes.close()
        if self._picture is not None:
            self._picture.close()

    def _step_and_restart(self, actions: Any) -> tuple[Floats, Floats, Any, Any, dict[str, Any]]:
        outcome = self._act(actions)
        info = self._selected(outcome.info)
        over = outcome.terminated | outcome.truncated
        observation = self._observe()
        final: dict[str, Any] = {}
        if over.any():
            (mask,) = self._handed_out(over)
            final = {
                "final_obs": observation,
                "_final_obs": mask,
                "final_info": self._masked(info, over),
                "_final_info": mask,
            }
            begun = np.flatnonzero(over)
            self._begin(begun)
            observation = self._observe()
            info = with_rows(info, begun, self._selected(self.episodes.goal_info(begun)))
        info = self._masked(info) | final
        return self._handed_out(observation, outcome.reward, outcome.terminated, outcome.truncated, info)

    def _observe(self) -> Any:
        return in_dtype(self.episodes.observe(), self.options.dtype)

    def _begin(self, ids: Ids, *start: Any) -> None:
        self.episodes.begin(ids, *start)
        self._elapsed[ids] = 0

    def _act(self, actions: Any, acting: Flags | None = None) -> Outcome:
        """Step, and truncate the episodes that have taken their steps, whether or not they terminate."""
        outcome = self.episodes.step(actions, acting)
        self._elapsed += 1 if acting is None else acting
        if self.max_episode_steps is None:
            return outcome
        return replace(outcome, truncated=outcome.truncated | (self._elapsed >= self.max_episode_steps))

    def _masked(self, info: Mapping[str, Any], mask: Flags | None = None) -> dict[str, Any]:
        """Add Gymnasium's masks to an `info`; by default its entries are of all environments."""
        (mask,) = self._handed_out(np.ones(self.num_envs, dtype=np.bool_) if mask is None else mask)
        return {**info, **{f"_{name}": mask for name in info}}

    def _handed_out(self, *values: Any) -> Any:
        return values if self.device is None else tuple(on_device(value, self.device) for value in values)

    def _selected(self, info: dict[str, Any]) -> dict[str, Any]:
        return numbers_of(info) if self.options.info == "numbers" else info

    def _checked_seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, Sequence | np.ndarray) and not isinstance(seed, str | bytes):
            seeds = [check_seed(value) for value in seed]
        else:
            first = check_count("seed", seed, least=0)
            seeds = list(range(first, first + self.num_envs))
        if len(seeds) != self.num_envs:
            raise InputError(f"there are {self.num_envs} environments and {len(seeds)} seeds")
        return seeds

    def _reset_mask(self, options: Mapping[str, Any] | None) -> tuple[Flags | None, Mapping[str, Any] | None]:
        """Return which environments a reset is for (None: all), and its other options."""
        if not isinstance(options, Mapping) or options.get("reset_mask") is None:
            return None, options
        mask = as_flags("reset_mask", options["reset_mask"])
        if mask.shape != (self.num_envs,) or not mask.any():
            raise InputError(f"reset_mask must have shape ({self.num_envs},) and a True value, got shape {mask.shape}")
        if not self._started:
            raise InputError("reset all environments before some of them")
        return mask, {name: value for name, value in options.items() if name != "reset_mask"}
