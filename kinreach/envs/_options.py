"""Options of environments, each spelled once in a dataclass, and what `reset` is given."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields
from typing import Any, TypeVar

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec, load_env_creator
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import (
    MAX_DISTANCE,
    Floats,
    as_floats,
    check_count,
    check_entries,
    check_known,
    check_number,
    shown,
)
from kinreach.errors import InputError, UnknownOptionError
from kinreach.kinematics.inside import MARGIN
from kinreach.robots import THESIS_ARM, ArmDescription
from kinreach.sim.inside import CAMERA, HEIGHT, MAX_HEIGHT, MAX_WIDTH, WIDTH
from kinreach.vision import SensorNoise
from kinreach.vision.inside import PIPELINES

Options = TypeVar("Options")
Environment = TypeVar("Environment", bound=type)

RENDER_MODES = ("human", "rgb_array", "rgb_array_list", "depth_array")
#: A camera is at least so far from what it looks at [m].
NEAREST = 1e-3
#: Ways to observe a goal and to move an arm.
OBSERVATION_KINDS, BACKENDS = ("camera", "geometric", "pixels"), ("mujoco", "kinematic", "warp")
#: What `info` holds.
INFOS = ("all", "numbers")
#: Types of the numbers of observations; pictures have their own.
FLOAT32, FLOAT64 = "float32", "float64"
#: Where the table of the options goes in a docstring.
PLACE = "<table of the options>"


def about(description: str, *, observation: str = "", flag: str | None = "") -> dict[str, str | None]:
    """Metadata of a field of a dataclass of options, for the table in the docstring and for commands.

    Args:
        description: With the unit.
        observation: The only `observation` that uses the option.
        flag: Its name on the command line, if it is another one; None for an option without a flag.
    """
    return {"description": description, "observation": observation, "flag": flag}


@dataclass(frozen=True, kw_only=True)
class EnvOptions:
    """Options of every environment. One whose default is a tuple takes a list of at least one."""

    info: str = field(
        default="all",
        metadata=about(
            '`"all"`, or only `"numbers"`: no texts, and no dictionary of the reward\'s terms (for TorchRL)', flag=None
        ),
    )

    dtype: str = field(
        default=FLOAT32,
        metadata=about(
            'type of the observations\' numbers: `"float32"` or `"float64"`, which is what `info` always has', flag=None
        ),
    )

    render_mode: str | None = field(
        default=None,
        metadata=about(
            '`"human"`, `"rgb_array"`, `"rgb_array_list"` (frames of the motion) or `"depth_array"`', flag=None
        ),
    )
    render_camera: str | Sequence[float] = field(
        default=CAMERA,
        metadata=about(
            "what `render` draws from: a camera of the scene; a place x, y, z [m]; or six numbers, a place and what it "
            "looks at",
            flag=None,
        ),
    )
    render_width: int = field(default=WIDTH, metadata=about("of what `render` draws [px]", flag=None))
    render_height: int = field(default=HEIGHT, metadata=about("of what `render` draws [px]", flag=None))

    def __post_init__(self) -> None:
        check_known("info", self.info, INFOS)
        check_known("dtype", self.dtype, (FLOAT32, FLOAT64))
        if self.render_mode is not None:
            check_known("render_mode", self.render_mode, RENDER_MODES)
        if not isinstance(self.render_camera, str):
            object.__setattr__(self, "render_camera", _viewpoint(self.render_camera))
        check_count("render_width [px]", self.render_width, most=MAX_WIDTH)
        check_count("render_height [px]", self.render_height, most=MAX_HEIGHT)
        for entry in fields(self):
            if isinstance(entry.default, tuple):
                given: Any = getattr(self, entry.name)
                if isinstance(given, str) or not isinstance(given, Sequence | np.ndarray) or not len(given):
                    what = "name" if isinstance(entry.default[0], str) else "number"
                    raise InputError(f"{entry.name} must be a list of at least one {what}, got {shown(given)}")
                object.__setattr__(self, entry.name, tuple(given))


def _viewpoint(given: Any) -> tuple[float, ...]:
    """Check the place of a camera [m], three numbers, or with what it looks at six."""
    numbers = as_floats("render_camera", given)
    if numbers.shape not in ((3,), (6,)):
        raise InputError(
            "render_camera must be the name of a camera, a place x, y, z [m], or six numbers, a place and what it "
            f"looks at, got {shown(given)}"
        )
    check_entries("render_camera [m]", numbers, MAX_DISTANCE)
    if numbers.size == 6 and np.linalg.norm(numbers[3:] - numbers[:3]) < NEAREST:
        raise InputError(f"render_camera must look at a place at least {NEAREST:g} m away, got {shown(given)}")
    return tuple(numbers.tolist())


@dataclass(frozen=True, kw_only=True)
class CameraOptions(EnvOptions):
    """Options of environments in which an arm may see its goal with cameras."""

    observation: str = field(default="geometric", metadata=about('`"camera"`, `"geometric"` or `"pixels"`'))
    backend: str = field(
        default="mujoco",
        metadata=about('`"mujoco"` (dynamics) or `"kinematic"`; in native batches also `"warp"` (tried on CPUs only)'),
    )
    arm: str | ArmDescription = field(
        default=THESIS_ARM, metadata=about("name of a registered arm, or an `ArmDescription`")
    )
    margin: float = field(
        default=MARGIN,
        metadata=about(
            "parts that are nearer count as colliding where `accept` and the kinematic backend judge a posture [m]; "
            "under dynamics contacts decide"
        ),
    )
    pipeline: str = field(
        default="hybrid",
        metadata=about('how the ball is found: `"hybrid"` or the thesis\'s own, `"thesis"`', observation="camera"),
    )
    width: int = field(default=640, metadata=about("width of the cameras' images [px]", observation="camera"))
    height: int = field(default=360, metadata=about("height of the cameras' images [px]", observation="camera"))
    rgb_noise: float = field(
        default=0.0, metadata=about("standard deviation of the colours' noise [levels of 255]", observation="camera")
    )
    depth_noise: float = field(
        default=0.0, metadata=about("standard deviation of the depth's noise [m]", observation="camera")
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        check_known("observation", self.observation, OBSERVATION_KINDS)
        check_known("backend", self.backend, BACKENDS)
        check_known("pipeline", self.pipeline, PIPELINES)
        for name in ("width", "height"):
            check_count(f"{name} [px]", getattr(self, name), least=16, most=16384)
        check_number("rgb_noise", self.rgb_noise, least=0.0, most=255.0)
        check_number("depth_noise", self.depth_noise, least=0.0, most=1.0)
        check_number("margin [m]", self.margin, least=0.0, most=MAX_DISTANCE)

    @property
    def noise(self) -> SensorNoise:
        """Noise of the cameras, from `rgb_noise` and `depth_noise`."""
        return SensorNoise(rgb_sigma=self.rgb_noise, depth_sigma=self.depth_noise)


def _specific_first(kind: type[Any]) -> list[Field[Any]]:
    """Return the fields of a class of options, those that many environments have at the end."""
    common = [entry.name for entry in fields(EnvOptions)]
    return sorted(fields(kind), key=lambda entry: entry.name in common)


def options_from(kind: type[Options], given: Mapping[str, Any]) -> Options:
    """Make the options of an environment from its keywords."""
    available = [entry.name for entry in _specific_first(kind)]
    if unknown := [name for name in given if name not in available]:
        names = ", ".join(map(repr, unknown))  # the wording is Python's: TorchRL looks for it
        limit = "; the limit of steps is Gymnasium's, max_episode_steps=" if "max_steps" in unknown else ""
        raise UnknownOptionError(
            f"got an unexpected keyword argument {names}; available: {', '.join(available)}{limit}"
        )
    return kind(**given)


def with_options(kind: type[Any]) -> Callable[[Environment], Environment]:
    """Decorate an environment's class: set its `Options`, its signature and the table in its docstring."""
    rows = [
        f"| `{entry.name}` | `{_quoted(entry.default)}` | {entry.metadata['description']} |"
        for entry in _specific_first(kind)
        if entry.default is not MISSING
    ]
    table = "\n    ".join(["| Parameter | Default | Description |", "|-----------|---------|-------------|", *rows])

    def decorate(environment: Environment) -> Environment:
        environment.__signature__ = inspect.signature(kind)  # type: ignore[attr-defined]
        environment.Options = kind  # type: ignore[attr-defined]
        if environment.__doc__ is not None:
            environment.__doc__ = environment.__doc__.replace(PLACE, table)
        return environment

    return decorate


def _quoted(value: object) -> str:
    return f'"{value}"' if isinstance(value, str) else repr(value)


def in_dtype(values: Any, dtype: str) -> Any:
    """Return observations or their space, those in a dictionary too, with doubles as numbers of a `dtype`.

    Rounding is monotone: an observation stays within the bounds of its space.
    """
    if isinstance(values, spaces.Dict):
        return spaces.Dict({name: in_dtype(part, dtype) for name, part in values.items()})
    if isinstance(values, Mapping):
        return {name: in_dtype(part, dtype) for name, part in values.items()}
    if values.dtype != np.float64 or dtype == FLOAT64:
        return values
    if isinstance(values, spaces.Box):
        return spaces.Box(values.low.astype(dtype), values.high.astype(dtype), dtype=np.dtype(dtype).type)
    return values.astype(dtype)


def spec_of(environment: str) -> EnvSpec:
    """Return the spec of a registered environment; `module:id` imports the module.

    Raises:
        gym.error.Error: No such module or id.
    """
    module, _, name = environment.rpartition(":")
    try:
        if module:
            importlib.import_module(module)
    except ImportError as error:
        raise gym.error.UnregisteredEnv(str(error)) from error
    return gym.spec(name)


def in_doubles(environment: str) -> dict[str, str]:
    """Return the options with which a registered environment observes in double precision; none if it has no choice."""
    spec = spec_of(environment)
    maker = spec.entry_point if spec.vector_entry_point is None else spec.vector_entry_point
    maker = load_env_creator(maker) if isinstance(maker, str) else maker
    chooses = isinstance(kind := getattr(maker, "Options", None), type) and issubclass(kind, EnvOptions)
    return {"dtype": FLOAT64} if chooses and "dtype" not in spec.kwargs else {}


def given_options(options: Mapping[str, Any] | None, names: Collection[str]) -> dict[str, Any]:
    """Check the names of the options of `reset(options=...)` and return them."""
    if options is not None and not isinstance(options, Mapping):
        raise InputError(f"reset options must be a mapping of {', '.join(names)}, got {shown(options)}")
    given = dict(options or {})
    if unknown := [name for name in given if name not in names]:
        raise InputError(f"unknown reset options {shown(unknown)}; available: {', '.join(names)}")
    return given


def option_rows(
    options: Mapping[str, Any] | None, sizes: Mapping[str, int], count: int | None
) -> tuple[Floats | None, ...]:
    """Return the options of `reset(options=...)` as arrays with a row for each environment, in the order of `sizes`.

    Sizes are lengths of rows. With a `count`, of a batch, arrays have shape (count, size), and what is given must, too.
    Else the options are plain rows, and arrays have shape (1, size). Options that are not given are None.
    """
    given = {name: value for name, value in given_options(options, sizes).items() if value is not None}
    rows: list[Floats | None] = []
    for name, size in sizes.items():
        if name not in given:
            rows.append(None)
            continue
        values = as_floats(name, given[name])
        shape = (size,) if count is None else (count, size)
        if values.shape != shape:
            raise InputError(f"{name} must have shape {shape}, got {values.shape}")
        check_entries(name, values, MAX_DISTANCE)
        rows.append(values.reshape(-1, size))
    return tuple(rows)


def option_values(
    options: Mapping[str, Any] | None, checks: Mapping[str, Callable[[Any], Any]], count: int | None
) -> tuple[NDArray[Any] | None, ...]:
    """Return the options of `reset(options=...)` that are one value, such as a name, as `option_rows` does.

    Each is checked by its function, which returns it. In a batch one value may stand for all environments.
    """
    given = given_options(options, checks)
    columns: list[NDArray[Any] | None] = []
    for name, check in checks.items():
        value = given.get(name)
        if value is None:
            columns.append(None)
            continue
        one = count is None or isinstance(value, str) or np.ndim(value) == 0
        values = (count or 1) * [value] if one else list(value)
        if len(values) != (count or 1):
            raise InputError(f"{name} must have a value for each of {count} environments, got {len(values)}")
        columns.append(np.array([check(each) for each in values]))
    return tuple(columns)


def check_box_actions(actions: ArrayLike, shape: tuple[int, ...], count: int | None) -> Floats:
    """Return actions in [-1, 1] of a batch, shape (count, *shape), or that of one environment as a row of one.

    What is outside [-1, 1] is clipped.
    """
    values, wanted = as_floats("action", actions), shape if count is None else (count, *shape)
    if values.shape != wanted:
        raise InputError(f"action must have shape {wanted}, got {values.shape}")
    if not (values.min() >= -1.0 and values.max() <= 1.0):
        if not np.isfinite(values).all():
            raise InputError("action must be finite")
        values = np.clip(values, -1.0, 1.0)
    return values[None] if count is None else values


def check_seed(seed: object) -> int | None:
    """Check the seed of an environment; NumPy's integers are valid too."""
    return None if seed is None else check_count("seed", seed, least=0)


def check_limit(max_episode_steps: object, registered: int) -> int | None:
    """Return the steps after which episodes of a batch are truncated, as Gymnasium means them; None for no limit.

    None means the registered limit, and -1 none.
    """
    if max_episode_steps is None:
        return registered
    steps = check_count("max_episode_steps", max_episode_steps, least=-1)
    if steps == 0:
        raise InputError("max_episode_steps must be at least 1, or -1 for episodes without a limit, got 0")
    return None if steps == -1 else steps


def check_started(started: bool) -> None:
    if not started:
        raise InputError("reset the environment before its first step")
