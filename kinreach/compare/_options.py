"""Flags of the command line from the dataclass of an environment's options.

The environment's class has it as its attribute `Options`. Fields of truth values, numbers, texts, and tuples of them
become flags. `metadata["description"]` is the help, with the unit.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import gymnasium as gym
from gymnasium.envs.registration import load_env_creator

from kinreach._checks import STEP_LIMIT, shown
from kinreach.envs.inside import spec_of
from kinreach.errors import InputError

#: Both become `--resolution`.
SIZE = ("width", "height")


@dataclass(frozen=True)
class Flag:
    """A flag of the command line.

    Attributes:
        name: Without dashes, with underscores.
        expects: Description of its values, for messages.
        parse: From text to options of the environment; raises ValueError or KeyError.
        observation: That the option is for; empty for all.
    """

    name: str
    metavar: str
    help: str
    expects: str
    parse: Callable[[str], Mapping[str, Any]]
    observation: str = ""

    @property
    def spelled(self) -> str:
        return f"--{self.name.replace('_', '-')}"

    def options(self, text: str) -> Mapping[str, Any]:
        try:
            return self.parse(text)
        except (ValueError, KeyError):
            raise InputError(f"{self.spelled} must be {self.expects}, got {shown(text)}") from None


def options_class(environment: str) -> type[Any] | None:
    """Return the dataclass of options of a registered environment; None if it names none."""
    try:
        entry = spec_of(environment).entry_point
        creator = load_env_creator(entry) if isinstance(entry, str) else entry
    except (gym.error.Error, ImportError, AttributeError):  # which the comparison reports
        return None
    found = getattr(creator, "Options", None)
    return found if isinstance(found, type) and is_dataclass(found) else None


class OptionFlags(Mapping[str, Flag]):
    """Flags for the options of an environment, by name.

    Args:
        environment: Its id.
        defaults: Those that differ from the dataclass's.
        taken: Names of other flags of the command, which are left out.
    """

    def __init__(self, environment: str, defaults: Mapping[str, Any], *, taken: Sequence[str] = ()) -> None:
        self._flags = _flags(environment, defaults, taken)

    def __getitem__(self, name: str) -> Flag:
        return self._flags[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._flags)

    def __len__(self) -> int:
        return len(self._flags)

    def add_to(self, parser: argparse.ArgumentParser, title: str) -> None:
        """Add them to a parser, as a group with a title; their values stay text."""
        group = parser.add_argument_group(title)
        for flag in self.values():
            group.add_argument(flag.spelled, metavar=flag.metavar, help=flag.help.replace("%", "%%"))

    def texts(self, arguments: argparse.Namespace) -> dict[str, str]:
        """Return the texts of those that were given."""
        return {name: getattr(arguments, name) for name in self if getattr(arguments, name) is not None}

    def options(self, texts: Mapping[str, str], observation: str | None = None) -> dict[str, Any]:
        """Return the options of the environment from texts; flags for another observation are refused."""
        options: dict[str, Any] = {}
        for name, text in texts.items():
            flag = self[name]
            if observation is not None and flag.observation not in ("", observation):
                raise InputError(
                    f"{flag.spelled} needs observation {flag.observation!r}, got observation {observation!r}"
                )
            options.update(flag.options(text))
        return options


def _flags(environment: str, defaults: Mapping[str, Any], taken: Sequence[str]) -> dict[str, Flag]:
    kind = options_class(environment)
    if kind is None:
        return {}
    try:
        hints = get_type_hints(kind)
    except NameError as error:
        raise InputError(f"the types of {kind.__name__}, options of {environment}, cannot be read: {error}") from error
    given = {entry.name: defaults.get(entry.name, _default(entry)) for entry in fields(kind)}
    found = {}
    for entry in fields(kind):
        flag = _flag(entry, hints[entry.name], given[entry.name])
        if flag is not None and flag.name not in taken:
            found[flag.name] = flag
    if all(name in found for name in SIZE):
        width, _ = (found.pop(name) for name in SIZE)
        description = f"width and height of the images [px] (default: {given['width']}x{given['height']})"
        found["resolution"] = Flag(
            "resolution", "WxH", description, "WIDTHxHEIGHT, such as 640x360", _size, width.observation
        )
    limit = defaults.get(STEP_LIMIT, gym.spec(environment.rpartition(":")[2]).max_episode_steps)
    if limit is not None and STEP_LIMIT not in taken:
        description = f"steps after which an episode is truncated (default: {limit})"
        found[STEP_LIMIT] = Flag(STEP_LIMIT, "N", description, "a whole number", lambda text: {STEP_LIMIT: int(text)})
    return found


def _flag(entry: Field[Any], hint: Any, default: Any) -> Flag | None:
    parsed, name = _parser_of(hint), entry.metadata.get("flag", "")
    if parsed is None or name is None or entry.name == "render_mode":
        return None
    parse, metavar, expects = parsed
    many = isinstance(default, list | tuple)
    if many:
        expects += f", such as {_written(default[:2])}"
    description = re.sub(r'[`"]', "", entry.metadata.get("description", ""))
    description += "" if default is None or default is MISSING else f" (default: {_written(default)})"
    observation = entry.metadata.get("observation", "")
    return Flag(
        name or entry.name, metavar, description.strip(), expects, lambda text: {entry.name: parse(text)}, observation
    )


def _default(entry: Field[Any]) -> Any:
    return entry.default if entry.default_factory is MISSING else entry.default_factory()


def _parser_of(hint: Any) -> tuple[Callable[[str], Any], str, str] | None:
    """Return the parser of a type with its metavar and its name in messages; None for other types."""
    origin, arguments = get_origin(hint), [kind for kind in get_args(hint) if kind not in (NoneType, Ellipsis)]
    if origin in (Union, UnionType) and len(arguments) == 1:
        return _parser_of(arguments[0])
    known: Mapping[Any, tuple[Callable[[str], Any], str, str]] = {
        bool: (lambda text: {"true": True, "false": False}[text.lower()], "true|false", "true or false"),
        int: (int, "N", "a whole number"),
        float: (float, "X", "a number"),
        str: (str, "NAME", "a text"),
    }
    if origin in (tuple, list, Sequence) and len(set(arguments)) == 1:
        if arguments[0] not in (int, float, str):
            return None
        parse, metavar, _ = known[arguments[0]]
        words = "names" if arguments[0] is str else "numbers"
        return (
            lambda text: tuple(parse(part) for part in text.split(",")),
            f"{metavar},{metavar}",
            f"{words} with commas between them",
        )
    return known.get(hint)


def _size(text: str) -> Mapping[str, Any]:
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise ValueError
    return {"width": int(width), "height": int(height)}


def _written(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ",".join(map(_written, value))
    return str(value).lower() if isinstance(value, bool) else f"{value:g}" if isinstance(value, float) else str(value)
