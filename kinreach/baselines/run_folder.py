"""The folder of a training run: its files, the run in it if that is finished, and what an earlier one left."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from kinreach.baselines.learned import LearnedPolicy, load_policy
from kinreach.baselines.policy_file import PolicyCard
from kinreach.errors import OutputError

CHECKPOINT, POLICY, CURVE, EPISODE, RUN, MODEL = (
    "checkpoint.pt",
    "policy.safetensors",
    "curve.csv",
    "episode.csv",
    "run.json",
    "model.zip",
)


@dataclass(frozen=True)
class Run:
    """A finished training run.

    Attributes:
        folder: Where its files are.
        card: Of its policy.
        policy: The policy.
        seconds: Wall time of the call that finished it.
        cpu_seconds: CPU time of that call.
    """

    folder: Path
    card: PolicyCard
    policy: LearnedPolicy
    seconds: float
    cpu_seconds: float


def finished_run(folder: Path, identity: dict[str, Any], *, export: bool = False) -> Run | None:
    """The run in a folder, if it is this one and has come to its end.

    Args:
        folder: Of the run.
        identity: What `run.json` must say.
        export: Whether a finished run has stable-baselines3's own file as well.
    """
    try:
        run = json.loads((folder / RUN).read_text(encoding="utf-8"))
        same = {name: run[name] for name in identity} == identity
        seconds, cpu_seconds = float(run["seconds"]), float(run["cpu_seconds"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
    wanted = (POLICY, MODEL) if export else (POLICY,)
    if not same or (folder / CHECKPOINT).exists() or not all((folder / name).exists() for name in wanted):
        return None
    policy = load_policy(folder / POLICY)
    return Run(folder, policy.card, policy, seconds, cpu_seconds)


def remove(folder: Path, names: Iterable[str]) -> None:
    """Remove files, as far as they are there.

    Raises:
        OutputError: The file system refused.
    """
    for name in names:
        try:
            (folder / name).unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(f"cannot remove {folder / name}: {error.strerror or error}") from error
