"""The episodes of a task's method as a Minari dataset, to learn from."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Any

from kinreach import _provenance as provenance
from kinreach._statistics import Trial
from kinreach.baselines.inside import check_dataset, write_dataset
from kinreach.compare._runner import Environments, naming, prepare, resets_of
from kinreach.compare._task import Task
from kinreach.errors import InputError


def demonstrate(
    task: str | Task,
    method: Any,
    dataset: str,
    *,
    episodes: int = 100,
    seed: int = 0,
    arm: str | None = None,
    observation: str | None = None,
    options: Mapping[str, Any] | None = None,
    command: str = "kinreach.compare.demonstrate(...)",
    progress: Callable[[int], None] = lambda done: None,
) -> list[Trial]:
    """Record a method's episodes on the goals of a comparison as a Minari dataset, with every `info`.

    `minari.load_dataset` reads it. Each episode has the seed and the options of its reset: the environment plays it
    again. All are kept, reached or not, but those in which the method finds no action; `infos["is_success"]` says
    which are reached.

    Args:
        task: Name of a registered task, or a task.
        method: As one of `methods` in `compare`: a name of the task's, or yours.
        dataset: Name of the new dataset, such as `"push/script-v0"`.
        episodes: Number of goals, the first of those that `compare` has with this seed.
        seed: Of the goals.
        arm: Name of another arm, as in `compare`.
        observation: As in `compare`.
        options: Of the task's environments, which must be JSON types.
        command: That records the dataset again, for its description.
        progress: Called with the number of finished episodes.

    Returns:
        A trial for each goal, as `kinreach.baselines.rollout` yields it.

    Raises:
        InstallationError: Minari or h5py is missing, or a package of the method.
        InputError: An argument is invalid, the dataset exists, or no episode has actions.
        UnknownNameError: The task, method, arm or observation is unknown.
    """
    check_dataset(dataset)
    comparison = prepare(
        task,
        [method],
        goals=episodes,
        seed=seed,
        arm=arm,
        observation=observation,
        options=options,
        command=command,
    )
    ((name, chosen),) = comparison.methods.items()
    with ExitStack() as stack:
        environments = Environments(comparison.task, stack)
        env, policy = environments.of(chosen), environments.policy(chosen)
        try:
            env.spec.to_json()  # type: ignore[union-attr]
        except (TypeError, ValueError) as error:
            raise InputError(f"options of a dataset's environment must be JSON types: {error}") from error
        with naming(f"method {name!r} failed"):
            return write_dataset(
                dataset,
                env,
                policy,
                resets_of(comparison.task, episodes, seed, environments.default),
                algorithm=name,
                about={**comparison.settings(), "command": command, "versions": provenance.versions()},
                progress=progress,
            )
