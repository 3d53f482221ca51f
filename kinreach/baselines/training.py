"""Training runs: from a recipe and a seed to a policy, a learning curve and what it takes to go on.

A run is a sequence of segments. Each begins with fresh episodes and generators that follow from the seed and the
number of the segment alone, so that a run that went on from the state after any segment gives the same policy as one
that was never interrupted.
"""

from __future__ import annotations

import io
import json
import math
import pickle
import random
import time
import warnings
import zipfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

from kinreach import provenance
from kinreach.baselines.algorithms import network_of
from kinreach.baselines.evaluation import HELD_OUT
from kinreach.baselines.learning_curve import COLUMNS, TRACE_COLUMNS, LearningCurve, curve_csv
from kinreach.baselines.models import Trainee, build
from kinreach.baselines.policies import LearnedPolicy, PolicyCard, load_policy, save_policy
from kinreach.baselines.recipes import Recipe
from kinreach.checks import MOST_THREADS, check_count, check_path, shown
from kinreach.errors import InputError, OutputError
from kinreach.files import make_writable, replacing, write_text

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


#: Attributes of algorithms that change during training, as far as an algorithm has them.
_COUNTERS = ("num_timesteps", "_n_updates", "_episode_num", "_n_calls", "exploration_rate", "rate")
_CURVE = ("rows", "steps", "episodes", "trace", "traced", "_sums", "_counted", "_ended")
_BUFFER = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


def save_checkpoint(path: Path, identity: dict[str, Any], segment: int, trainee: Trainee) -> None:
    """Write the state after a segment, whole or not at all.

    Args:
        path: Of the file.
        identity: Recipe, seed and versions of the run; `sources`, digests of the code that had a part in the state.
        segment: Its number.
        trainee: In that state.

    Raises:
        OutputError: The file system refused.
    """
    model, curve = trainee.model, trainee.curve
    state: dict[str, Any] = {
        "identity": identity,
        "segment": segment,
        "parameters": model.get_parameters(),
        "variables": {name: getattr(model, name).detach() for name in _variables(model)},
        "counters": {name: getattr(model, name) for name in _COUNTERS if hasattr(model, name)},
        "curve": {name: getattr(curve, name) for name in _CURVE},
    }
    if isinstance(model, OffPolicyAlgorithm) and model.replay_buffer is not None:
        buffer: Any = model.replay_buffer
        kept = buffer.buffer_size if buffer.full else buffer.pos
        arrays = {name: torch.from_numpy(getattr(buffer, name)[:kept]) for name in _BUFFER}
        state["buffer"] = {"arrays": arrays, "pos": buffer.pos, "full": buffer.full}
    content = io.BytesIO()  # torch's own file writer reports a full disk as a damaged archive
    torch.save(state, content)
    with replacing(path) as temporary:
        temporary.write_bytes(content.getbuffer())


def load_checkpoint(path: Path, identity: dict[str, Any], trainee: Trainee) -> tuple[int, list[str]]:
    """Put a fresh trainee into the state after the last segment.

    Args:
        path: Of the file.
        identity: What was given to `save_checkpoint`, but for `sources`: the code may have changed.
        trainee: A fresh one.

    Returns:
        The number of the next segment, and `sources`: digests of the code that had a part in the state.

    Raises:
        InputError: The file is not a checkpoint, or is one of another run.
    """
    try:
        content = io.BytesIO(path.read_bytes())
        if not zipfile.is_zipfile(content):  # torch would try it as a plain pickle, and warn before it refuses
            raise ValueError("no archive")
        content.seek(0)
        state = torch.load(content, weights_only=True)
        said = dict(state["identity"])
        sources = said.pop("sources", None)
        if said != identity or not isinstance(sources, list):
            raise InputError(
                f"{path} belongs to a run with other settings or versions; train without --resume, or elsewhere"
            )
        model, curve = trainee.model, trainee.curve
        model.set_parameters(state["parameters"], exact_match=True)
        for name in _variables(model):
            getattr(model, name).data.copy_(state["variables"][name])
        for name in (name for name in _COUNTERS if hasattr(model, name)):
            setattr(model, name, _number(state["counters"][name]))
        for name in _CURVE:
            setattr(curve, name, state["curve"][name])
        if "buffer" in state:
            buffer: Any = model.replay_buffer  # type: ignore[attr-defined]
            for name in _BUFFER:
                rows = state["buffer"]["arrays"][name]
                getattr(buffer, name)[: len(rows)] = rows.numpy()
            buffer.pos, buffer.full = state["buffer"]["pos"], state["buffer"]["full"]
        return int(state["segment"]) + 1, [str(source) for source in sources]
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    except (pickle.UnpicklingError, RuntimeError, KeyError, TypeError, AttributeError, EOFError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path} is no checkpoint, or a damaged one") from None


def _number(value: Any) -> Any:
    if not isinstance(value, int | float):
        raise TypeError(f"a counter must be a number, got {type(value).__name__}")
    return value


def _variables(model: BaseAlgorithm) -> list[str]:
    """Names of tensors that are no parameters of a module, such as SAC's entropy coefficient."""
    return list(model._get_torch_save_params()[1])


#: Of torch's and numpy's generators.
MOST_SEED = 2**31 - 1
#: Called with actions done, actions planned, and the last row of the learning curve by column.
Progress = Callable[[int, int, dict[str, float | None]], None]


def _warn(text: str) -> None:
    warnings.warn(text, stacklevel=4)


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
    notice: Callable[[str], None] = _warn,
) -> Run:
    """Train a policy.

    Writes into the folder: `policy.safetensors`, `curve.csv`, `run.json` (recipe, seed, versions, digests of the code
    that had a part in it, times), TensorBoard's logs, and, until it is done, `checkpoint.pt`. What an earlier run left
    there is removed when this one begins to train; its checkpoint, when this one has its own.

    Only one training at a time in a process: the generators of `random`, `numpy` and torch are seeded, as
    stable-baselines3 does it, and stay where the training leaves them; torch's number of threads is as before.

    Args:
        recipe: What to train.
        folder: Where to; created if need be.
        seed: Of networks, exploration and training goals.
        steps: Actions instead of the recipe's.
        resume: Go on from the checkpoint in the folder, if there is one; the same run, if it is finished, is kept.
        threads: Of torch.
        export: Write stable-baselines3's own `model.zip` too. Loading such a file can run code: load only your own.
            A run that was finished without it is trained again: there is more in it than in the policy.
        progress: Told how far it is.
        notice: Told that a checkpoint was made by other code of kinreach; a `UserWarning` by default.

    Raises:
        OutputError: The folder cannot be written.
        InputError: An argument cannot be used, or the checkpoint is damaged, or of another run.
    """
    if not isinstance(recipe, Recipe):
        raise InputError(f"recipe must be a Recipe, see `get_recipe`; got {shown(recipe)}")
    seed = check_count("seed", seed, least=0, most=MOST_SEED)
    threads = check_count("threads", threads, most=MOST_THREADS)
    steps = None if steps is None else check_count("steps", steps)
    folder = check_path("folder", folder)
    make_writable(folder)
    recipe = recipe if steps is None else replace(recipe, steps=steps)
    identity = json.loads(json.dumps({"recipe": recipe.to_dict(), "seed": seed, "versions": _versions()}))
    if resume and (done := finished_run(folder, identity, export=export)) is not None:
        return done
    others = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        return _train(recipe, folder, identity, resume=resume, export=export, progress=progress, notice=notice)
    finally:
        torch.set_num_threads(others)


def _train(
    recipe: Recipe,
    folder: Path,
    identity: dict[str, Any],
    *,
    resume: bool,
    export: bool,
    progress: Progress,
    notice: Callable[[str], None],
) -> Run:
    seed, source = identity["seed"], provenance.source_digest()
    clock, cpu = time.perf_counter(), time.process_time()
    trainee = build(recipe, _entropy(seed, 0)[0], steps=recipe.steps)
    model, checkpoint = trainee.model, folder / CHECKPOINT
    model.set_logger(configure(str(folder / "tensorboard"), ["tensorboard"]))
    try:
        first, sources = load_checkpoint(checkpoint, identity, trainee) if resume and checkpoint.exists() else (0, [])
        if sources and sources[-1] != source:
            was = f"{checkpoint} was made by other code of kinreach ({sources[-1]}, now {source})"
            notice(f"{was}: the policy may not be that of an uninterrupted run")
        sources = sources if sources[-1:] == [source] else [*sources, source]
        remove(folder, (RUN, POLICY, MODEL) if first else (RUN, POLICY, MODEL, CURVE, EPISODE))
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
            _end_segment(trainee)
            save_checkpoint(checkpoint, {**identity, "sources": sources}, segment, trainee)
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
        goal_seeds=goal_seeds(seed, len(_targets(recipe, model))),
    )
    save_policy(folder / POLICY, card, network)
    run = {**identity, "sources": sources, "steps": model.num_timesteps, "seconds": seconds, "cpu_seconds": cpu_seconds,
           "resumed": first > 0, "machine": provenance.machine()}  # fmt: skip
    write_text(folder / RUN, json.dumps(run, indent=2) + "\n")
    if export:
        archive = io.BytesIO()
        model.save(archive)
        with replacing(folder / MODEL) as temporary:
            temporary.write_bytes(archive.getbuffer())
    remove(folder, (CHECKPOINT,))
    return Run(folder, card, LearnedPolicy(card, network), seconds, cpu_seconds)


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


def _end_segment(trainee: Trainee) -> None:
    """Close the curve's window, and cut what the replay buffer holds of the episodes that end here.

    A return over several steps goes on to the next row unless this one ended or was cut off, and the next one will be
    of another episode. The 1-step returns of a row that is cut off are those of one that is not.
    """
    trainee.curve.cut()
    buffer = getattr(trainee.model, "replay_buffer", None)
    if buffer is not None:
        last = buffer.pos - 1
        buffer.timeouts[last] = np.maximum(buffer.timeouts[last], 1 - buffer.dones[last])


def goal_seeds(seed: int, segments: int) -> dict[str, Any]:
    """Seeds of all goals that a policy has to do with, as its card says them.

    Args:
        seed: Of the training.
        segments: Parts of the training.
    """
    return {"training": [_entropy(seed, index + 1)[3] for index in range(segments)], "held_out": HELD_OUT}


def _entropy(seed: int, key: int) -> list[int]:
    return [int(word >> 1) for word in np.random.SeedSequence(seed, spawn_key=(key,)).generate_state(4)]


def _versions() -> dict[str, str]:
    found = provenance.versions(("numpy", "torch", "stable-baselines3", "mujoco"))
    return {name: str(version) for name, version in found.items() if name != "kinreach-source"}
