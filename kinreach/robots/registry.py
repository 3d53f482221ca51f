"""Arms by name. Modules in `kinreach.robots.arms` are found by themselves; others join with `register_arm`."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache

from kinreach.errors import InputError
from kinreach.inputs import check_known
from kinreach.robots import arms
from kinreach.robots.description import ArmDescription


@cache
def _arms() -> dict[str, ArmDescription]:
    modules = (importlib.import_module(f"{arms.__name__}.{info.name}") for info in pkgutil.iter_modules(arms.__path__))
    return {module.ARM.name: module.ARM for module in modules}


def register_arm(arm: ArmDescription) -> None:
    """Make an arm that lives outside kinreach available by its name.

    Raises:
        InputError: Another arm has that name already.
    """
    if _arms().get(arm.name, arm) is not arm:
        raise InputError(f"an arm named {arm.name!r} is registered already")
    _arms()[arm.name] = arm


def get_arm(name: str) -> ArmDescription:
    """The arm with this name.

    Raises:
        UnknownNameError: There is none; the message lists those there are.
    """
    check_known("arm", name, _arms())
    return _arms()[name]


def as_arm(arm: str | ArmDescription) -> ArmDescription:
    """The arm with this name, or the description itself.

    Raises:
        UnknownNameError: There is no such arm.
    """
    return arm if isinstance(arm, ArmDescription) else get_arm(arm)


def arm_names() -> tuple[str, ...]:
    """Names of all registered arms, sorted."""
    return tuple(sorted(_arms()))
