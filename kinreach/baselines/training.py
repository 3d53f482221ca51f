"""Training runs: from a recipe and a seed to a policy, a learning curve and what it takes to go on.

A run is a sequence of segments. Each begins with fresh episodes and generators that follow from the seed and the
number of the segment alone, so that a run that went on from the state after any segment gives the same policy as one
that was never interrupted.
"""

from __future__ import annotations

import io
import json
import math
import random
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

from kinreach import provenance
from kinreach.baselines.checkpoint import load_checkpoint, save_checkpoint
from kinreach.baselines.export import network_of
from kinreach.baselines.learned import LearnedPolicy, load_policy
from kinreach.baselines.learning_curve import COLUMNS, TRACE_COLUMNS, LearningCurve, curve_csv
from kinreach.baselines.models import Trainee, build
from kinreach.baselines.policy_file import PolicyCard, save_policy
from kinreach.baselines.recipes import Recipe
from kinreach.files import make_writable, replacing, write_text

#: Called with actions done, actions planned, and the last row of the learning curve by column.
Progress = Callable[[int, int, dict[str, float | None]], None]

CHECKPOINT, POLICY, CURVE, EPISODE, RUN = (
    "checkpoint.pt",
    "policy.safetensors",
    "curve.csv",
    "episode.csv",
    "run.json",
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


def train(
    recipe: Recipe,
    folder: str | Path,
    *,
    seed: int = 0,
    steps: int | None = None,
    resume: bool = False,
    threads: int = 1,
    export: bool = False,
    progress: Progress = lambda done, planned, row: None,
) -> Run:
    """Train a policy.

    Writes into the folder: `policy.safetensors`, `curve.csv`, `run.json` (recipe, seed, versions, times), TensorBoard's
    logs, and, until it is done, `checkpoint.pt`.

    Args:
        recipe: What to train.
        folder: Where to; created if need be.
        seed: Of networks, exploration and training goals.
        steps: Actions instead of the recipe's.
        resume: Go on from the checkpoint in the folder, if there is one; the same run, if it is finished, is kept.
        threads: Of torch.
        export: Write stable-baselines3's own `model.zip` too. Loading such a file can run code: load only your own.
        progress: Told how far it is.

    Raises:
        OutputError: The folder cannot be written.
        InputError: The checkpoint is damaged, or of another run.
    """
    folder = Path(folder)
    make_writable(folder)
    recipe = recipe if steps is None else replace(recipe, steps=steps)
    identity = json.loads(json.dumps({"recipe": recipe.to_dict(), "seed": seed, "versions": _versions()}))
    if resume and not export and (done := _finished(folder, identity)) is not None:
        return done
    torch.set_num_threads(threads)
    clock, cpu = time.perf_counter(), time.process_time()
    trainee = build(recipe, _entropy(seed, 0)[0], steps=recipe.steps)
    model, checkpoint = trainee.model, folder / CHECKPOINT
    model.set_logger(configure(str(folder / "tensorboard"), ["tensorboard"]))
    try:
        first = load_checkpoint(checkpoint, identity, trainee) if resume and checkpoint.exists() else 0
        if first:  # the run may have been killed between its checkpoint and its curve
            _write_curves(folder, trainee.curve)
        for segment, target in enumerate(_targets(recipe, model)):
            if segment < first:
                continue
            _begin_segment(trainee, seed, segment)
            model.learn(
                target - model.num_timesteps,
                callback=_Report(trainee, recipe.steps, progress),
                reset_num_timesteps=False,
                log_interval=None,  # type: ignore[arg-type]
            )
            trainee.curve.cut()
            save_checkpoint(checkpoint, identity, segment, trainee)
            _write_curves(folder, trainee.curve)
    finally:
        trainee.env.close()
        model.logger.close()
    seconds, cpu_seconds = time.perf_counter() - clock, time.process_time() - cpu
    network = network_of(model)
    card = PolicyCard(
        environment=recipe.environment,
        meaning=recipe.meaning,
        activation=network.activation,
        output=network.output,
        algorithm=recipe.algorithm,
        recipe=identity["recipe"],
        seed=seed,
        steps=model.num_timesteps,
        versions=identity["versions"],
    )
    save_policy(folder / POLICY, card, network)
    run = {**identity, "steps": model.num_timesteps, "seconds": seconds, "cpu_seconds": cpu_seconds,
           "resumed": first > 0, "machine": provenance.machine()}  # fmt: skip
    write_text(folder / RUN, json.dumps(run, indent=2) + "\n")
    if export:
        archive = io.BytesIO()
        model.save(archive)
        with replacing(folder / "model.zip") as temporary:
            temporary.write_bytes(archive.getbuffer())
    checkpoint.unlink(missing_ok=True)
    return Run(folder, card, LearnedPolicy(card, network), seconds, cpu_seconds)


def _finished(folder: Path, identity: dict[str, Any]) -> Run | None:
    """The run in a folder, if it is this one and has come to its end."""
    try:
        run = json.loads((folder / RUN).read_text(encoding="utf-8"))
        same = {name: run[name] for name in identity} == identity
        seconds, cpu_seconds = float(run["seconds"]), float(run["cpu_seconds"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
    if not same or (folder / CHECKPOINT).exists() or not (folder / POLICY).exists():
        return None
    policy = load_policy(folder / POLICY)
    return Run(folder, policy.card, policy, seconds, cpu_seconds)


def _write_curves(folder: Path, curve: LearningCurve) -> None:
    write_text(folder / CURVE, curve_csv(curve.rows))
    if curve.traced and curve.trace:
        write_text(folder / EPISODE, curve_csv(curve.trace, TRACE_COLUMNS))


class _Report(BaseCallback):
    """Passes on how far the training is, with each new row of the learning curve."""

    def __init__(self, trainee: Trainee, planned: int, progress: Progress) -> None:
        super().__init__()
        self._trainee, self._planned, self._progress = trainee, planned, progress
        self._rows = len(trainee.curve.rows)

    def _on_step(self) -> bool:
        rows = self._trainee.curve.rows
        if len(rows) > self._rows:
            self._rows = len(rows)
            row = dict(zip(COLUMNS, rows[-1], strict=True))
            for name in COLUMNS[2:]:
                if row[name] is not None:
                    self.logger.record(f"curve/{name}", row[name])
            self.logger.dump(self.num_timesteps)
            self._progress(self.num_timesteps, self._planned, row)
        return True


def _targets(recipe: Recipe, model: BaseAlgorithm) -> list[int]:
    """Actions done after each segment, in whole updates."""
    update = model.n_envs * (model.n_steps if isinstance(model, OnPolicyAlgorithm) else 1)
    updates = math.ceil(recipe.steps / update)
    segments = min(recipe.segments, updates)
    return [update * (updates * (index + 1) // segments) for index in range(segments)]


def _begin_segment(trainee: Trainee, seed: int, segment: int) -> None:
    """Fresh episodes, and generators that follow from seed and segment."""
    ours, torchs, numpys, environments = _entropy(seed, segment + 1)
    random.seed(ours)
    torch.manual_seed(torchs)
    np.random.seed(numpys)
    trainee.model.action_space.seed(ours)
    trainee.env.seed(environments)
    trainee.model._last_obs = None


def _entropy(seed: int, key: int) -> list[int]:
    return [int(word >> 1) for word in np.random.SeedSequence(seed, spawn_key=(key,)).generate_state(4)]


def _versions() -> dict[str, str]:
    found = provenance.versions(("numpy", "torch", "stable-baselines3", "mujoco"))
    return {name: str(version) for name, version in found.items() if name != "kinreach-source"}
