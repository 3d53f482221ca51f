"""The state of an environment as a value: what its episodes change, MuJoCo's model and state, and random generators.

An environment's objects are walked through by their attributes. What is found is copied if it can change: arrays,
lists, dictionaries, generators, MuJoCo's structures and objects of this package's environments and simulation. It is
put back in place, because arrays are seen by several of them; so a new task needs no code for this.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass, is_dataclass
from enum import Enum
from functools import cache
from typing import Any

import numpy as np

from kinreach.envs._batch import Episodes
from kinreach.errors import InputError
from kinreach.robots import ArmDescription
from kinreach.sim.inside import mujoco

#: Where the objects are at home that have a state; those of other rooms stay as they are.
ROOMS = ("kinreach.envs.", "kinreach.sim.", "kinreach.baselines.")
#: Objects that only draw.
DRAWING = ("FrameRenderer", "ScenePicture", "SceneViewer")
#: Arrays of a model that are longer are its meshes and pictures, which stay.
MAX_FIELD = 50_000
_PLAIN = (type(None), bool, int, float, complex, str, bytes, np.generic, Enum)


@dataclass(frozen=True)
class Saved:
    """Content of an object.

    Attributes:
        kind: Its class.
        content: By attribute, key or index; or all of it.
    """

    kind: type
    content: Any


class _Left:
    """What is not a part of the state."""


def saved(value: Any) -> Any:
    """Return what a value is now, with nothing in it that can change later."""
    match value:
        case np.ndarray():
            return value.copy()
        case np.random.Generator():
            return Saved(np.random.Generator, copy.deepcopy(value.bit_generator.state))
        case mujoco.MjData():
            return Saved(mujoco.MjData, copy.copy(value))
        case mujoco.MjModel():
            return Saved(mujoco.MjModel, {name: np.copy(getattr(part, field)) for name, part, field in _fields(value)})
        case list():
            return Saved(list, [saved(each) for each in value])
        case dict():
            return Saved(dict, {key: saved(each) for key, each in value.items()})
        case tuple():
            parts = [saved(each) for each in value]
            return _Left if any(part is _Left for part in parts) else Saved(type(value), parts)
    if isinstance(value, ArmDescription):  # another environment has its own
        return _Left
    if isinstance(value, _PLAIN) or _is_frozen(value):
        return value
    if _has_state(value):
        return Saved(type(value), {name: saved(each) for name, each in vars(value).items()})
    return _Left


def put_back(now: Any, then: Any) -> Any:
    """Make a value what it was, in place if that can be; return it.

    Args:
        now: What is there, in this environment or in another one that is alike.
        then: Of `saved`.

    Raises:
        InputError: The state is of an environment with other options.
    """
    if then is _Left:
        return now
    if isinstance(then, np.ndarray):
        if isinstance(now, np.ndarray) and (now.shape, now.dtype) == (then.shape, then.dtype) and now.flags.writeable:
            now[...] = then
            return now
        return then.copy()
    if not isinstance(then, Saved):
        return then
    kind: Any = then.kind
    content = then.content
    if issubclass(kind, tuple):
        parts = now if isinstance(now, tuple) and len(now) == len(content) else len(content) * (None,)
        new = [put_back(one, each) for one, each in zip(parts, content, strict=True)]
        return kind(*new) if hasattr(kind, "_fields") else kind(new)
    if kind in (list, dict):
        now = now if type(now) is kind else kind()
        if kind is list:
            now[:] = [put_back(now[i] if i < len(now) else None, each) for i, each in enumerate(content)]
            return now
        kept = {key: put_back(now.get(key), each) for key, each in content.items()}
        now.clear()
        now.update(kept)
        return now
    if not isinstance(now, kind):
        raise InputError(f"the state is of an environment with other options: it has a {kind.__name__}")
    if kind is np.random.Generator:
        now.bit_generator.state = copy.deepcopy(content)
    elif kind is mujoco.MjModel:
        fields = [*_fields(now)]
        shapes = {name: np.shape(getattr(part, field)) for name, part, field in fields}
        if shapes != {name: each.shape for name, each in content.items()}:
            raise InputError("the state is of an environment with other options: its model has other parts")
        for name, part, field in fields:
            _write(part, field, content[name])
    elif kind is mujoco.MjData:
        if now.qpos.shape != content.qpos.shape:
            raise InputError("the state is of an environment with other options: its model has other joints")
        mujoco.mj_copyData(now, now.model, content)
    else:
        for name, each in content.items():
            if each is not _Left:
                vars(now)[name] = put_back(vars(now).get(name), each)
    return now


def _fields(model: Any) -> Iterator[tuple[str, Any, str]]:
    """Yield the fields of a model that can be written: a name, the part of the model that has it, its name there."""
    for at, part in (("", model), ("opt.", model.opt), ("stat.", model.stat)):
        for name in _writable(type(part).__name__):
            field = getattr(part, name)
            if not isinstance(field, np.ndarray) or (field.flags.writeable and 0 < field.size <= MAX_FIELD):
                yield at + name, part, name


@cache
def _writable(kind: str) -> tuple[str, ...]:
    """Names of the arrays of a structure by its name, and of numbers that are not sizes."""
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    sample = next(part for part in (model, model.opt, model.stat) if type(part).__name__ == kind)
    wanted = np.ndarray if kind == mujoco.MjModel.__name__ else (np.ndarray, int, float)
    return tuple(name for name in dir(sample) if name[0] != "_" and isinstance(getattr(sample, name), wanted))


def _write(part: Any, field: str, value: Any) -> None:
    now = getattr(part, field)
    if isinstance(now, np.ndarray):
        now[...] = value
    elif now != value:
        setattr(part, field, value.item())


def _is_frozen(value: Any) -> bool:
    return is_dataclass(value) and bool(getattr(type(value), "__dataclass_params__").frozen)  # noqa: B009


def _has_state(value: Any) -> bool:
    kind = type(value)
    if kind.__name__ in DRAWING or not hasattr(value, "__dict__"):
        return False
    return f"{kind.__module__}.".startswith(ROOMS) or isinstance(value, Episodes)
