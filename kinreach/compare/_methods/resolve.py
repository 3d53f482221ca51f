"""Make methods of names, files of policies, classes, objects and functions."""

from __future__ import annotations

import inspect
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym

from kinreach._checks import shown
from kinreach._objects import load_object
from kinreach._provenance import digest
from kinreach._registration import LIFT
from kinreach.baselines import load_policy
from kinreach.baselines.inside import (
    LearnedPolicy,
    Policy,
    SolverPolicy,
    as_policy,
    policy_version,
    run_name,
)
from kinreach.compare._task import POLICY, SOLVER, Method, Task
from kinreach.envs.inside import reach_task
from kinreach.errors import InputError, raise_unknown
from kinreach.kinematics import Solver
from kinreach.plots.inside import method_colours
from kinreach.robots import THESIS_ARM, ArmDescription

#: How names of policies' files end; those of stable-baselines3's models are refused with a remedy.
POLICY_FILES = (".safetensors", ".zip")


def resolve_methods(task: Task, given: Iterable[Any] | Mapping[str, Any]) -> dict[str, Method]:
    """Return methods by their names in results, in the given order; all of the task's own if nothing is given.

    Args:
        task: What they will do.
        given: Each is a name of the task's, the path of a policy's file (`policy.safetensors`), `"module:attribute"`, a
            `Method`, a solver or policy, a class of one, a stable-baselines3 model, or a function from observation to
            action. A mapping gives names; else an object has that of its `name`, its function or its class. Files of
            one name get those of their folders as well.

    Raises:
        InputError: A name occurs twice, or an entry is none of these.
        UnknownNameError: The name is unknown.
    """
    if isinstance(given, Mapping):
        found = [(_label(name), _method(task, value)) for name, value in given.items()]
    else:
        if not isinstance(given, Iterable):
            raise InputError(f"methods must be a list of names and objects, got {shown(given)}")
        chosen = [given] if isinstance(given, str) else list(given)
        chosen = chosen or list(task.methods)
        found = [(name, _method(task, value)) for name, value in zip(_names(task, chosen), chosen, strict=True)]
    for name, count in Counter(name for name, _ in found).items():
        if count > 1:
            raise InputError(f"method {name!r} is named twice")
    return dict(found)


def solver_method(new: Callable[[Any], Solver]) -> Method:
    """Make a method of a solver of inverse kinematics.

    Args:
        new: From a kinematics to a solver for it.
    """
    return Method(lambda env: SolverPolicy(new(_kinematics(env)), env), SOLVER)


def policy_method(policy: str, environment: str, **options: Any) -> Method:
    """Make a method of a policy, from the package or a file, with options of its environment beside the task's."""
    return Method(lambda env: load_policy(policy), POLICY, environment, policy_version(policy), options=options)


def _form(policy: LearnedPolicy) -> dict[str, Any]:
    """Return the option `steps` of `kinreach/Lift-v0` for a policy."""
    return {"steps": policy.needed_options.get("steps", "single")} if policy.card.environment == LIFT else {}


def _kinematics(env: gym.Env[Any, Any]) -> Any:
    return env.unwrapped.kinematics  # type: ignore[attr-defined]


def colours(methods: Mapping[str, Method]) -> dict[str, str]:
    """Return a colour for each method: its own, that of its name in all figures, or another."""
    own = {name: method.colour for name, method in methods.items() if method.colour}
    others = method_colours((name for name in methods if name not in own), taken=own.values())
    return {name: own.get(name) or others[name] for name in methods}


def _label(name: object) -> str:
    if not isinstance(name, str) or not name or not name.isprintable():
        raise InputError(f"methods must be named in printable text, got {shown(name)}")
    return name


def _names(task: Task, given: Sequence[Any]) -> list[str]:
    """Return names; files of the same name have that of their folder too, else their path."""
    names = [_name(task, value) for value in given]
    for longer in (lambda file: run_name(Path(file)) or "/".join(Path(file).with_suffix("").parts[-2:]), str):
        names = [
            longer(value) if names.count(name) > 1 and _is_file(value) else name
            for name, value in zip(names, given, strict=True)
        ]
    return names


def _is_file(given: Any) -> bool:
    return isinstance(given, str) and given.endswith(POLICY_FILES)


def _name(task: Task, given: Any) -> str:
    if isinstance(given, str):
        if _is_file(_label(given)):
            return Path(given).stem
        if ":" in given and given not in task.methods:
            own = getattr(load_object("method", given), "name", None)
            return _label(own) if isinstance(own, str) else given.rpartition(":")[2]
        return given
    own = getattr(given, "name", None) or getattr(given, "__name__", None) or type(given).__name__
    return _label(own)


def _method(task: Task, given: Any) -> Method:
    if isinstance(given, Method):
        return given
    if isinstance(given, str):
        if given in task.methods:
            return task.methods[given]
        if _is_file(given) and task.variants:
            return _from_file(task, given)
        if ":" not in given:
            raise_unknown(f"{task.name} method", given, task.methods)
        return _method(task, load_object("method", given))
    if not (hasattr(given, "solve") or hasattr(given, "act") or hasattr(given, "predict") or callable(given)):
        raise InputError(f"a method is a name, a solver, a policy or a function, got {shown(given)}")

    def make(env: gym.Env[Any, Any]) -> Policy:
        made = _construct(given, env) if isinstance(given, type) else given
        return SolverPolicy(made, env) if hasattr(made, "solve") else as_policy(made)

    return Method(make, SOLVER if hasattr(given, "solve") else POLICY, task.environment, _source(given))


def _from_file(task: Task, path: str) -> Method:
    """Make a method of a policy's file, for the environment of its card."""
    policy = load_policy(path)
    environment = policy.card.environment
    if environment not in task.variants:
        raise InputError(f"the policy {path} is for {environment}, not for one of: {', '.join(task.variants)}")
    trained, arm = (policy.arm or THESIS_ARM), task.options.get("arm", task.arm)
    name = arm.name if isinstance(arm, ArmDescription) else arm
    if task.arm and name != trained:
        raise InputError(f"the policy {path} was trained on the arm {trained!r}, not on {name!r}")
    if policy.needed_options.get("goal_in", reach_task.CAMERA) != reach_task.CAMERA:
        raise InputError(f"the policy {path} takes goals in pictures, the methods of a comparison take them in metres")
    return Method(lambda env: policy, POLICY, environment, policy_version(path), options=_form(policy))


def _construct(cls: Callable[..., Any], env: gym.Env[Any, Any]) -> Any:
    """Construct a user's class; one with an argument gets the kinematics (solvers) or the environment."""
    needed = [
        parameter
        for parameter in inspect.signature(cls).parameters.values()
        if parameter.default is parameter.empty
        and parameter.kind in (parameter.POSITIONAL_ONLY, parameter.POSITIONAL_OR_KEYWORD)
    ]
    if not needed:
        return cls()
    return cls(_kinematics(env) if hasattr(cls, "solve") else env)


def _source(given: Any) -> dict[str, str]:
    """Return a digest of the file that defines a user's object, by the name of its class."""
    cls = given if isinstance(given, type) or inspect.isroutine(given) else type(given)
    try:
        text = Path(inspect.getfile(cls)).read_bytes()
    except (TypeError, OSError):
        text = b""
    return {f"{cls.__module__}:{cls.__qualname__}": digest(text)}
