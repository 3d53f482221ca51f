"""Options of environments, each spelled once in a dataclass, and what `reset` is given."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Mapping
from dataclasses import MISSING, fields
from typing import Any, TypeVar

from kinreach._checks import MAX_DISTANCE, Floats, as_floats, check_count, check_entries, shown
from kinreach.errors import InputError, UnknownOptionError

Options = TypeVar("Options")
Environment = TypeVar("Environment", bound=type)

RENDER_MODES = ("human", "rgb_array", "rgb_array_list", "depth_array")
RENDER_MODES_TEXT = '`"human"`, `"rgb_array"`, `"rgb_array_list"` (frames of the motion) or `"depth_array"`'
#: What `info` holds.
INFOS = ("all", "numbers")
INFOS_TEXT = '`"all"`, or only `"numbers"`: no texts, and no dictionary of the reward\'s terms (for TorchRL)'
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


def options_from(kind: type[Options], given: Mapping[str, Any]) -> Options:
    """Make the options of an environment from its keywords."""
    available = [entry.name for entry in fields(kind)]  # type: ignore[arg-type]
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
        for entry in fields(kind)
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


def check_not_over(over: bool) -> None:
    if over:
        raise InputError("the episode is over; reset the environment")
