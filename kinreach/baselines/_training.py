"""Training runs: from a recipe and a seed to a policy, a learning curve and checkpoints.

A run is a sequence of segments. Each begins with fresh episodes, and with generators seeded by the seed and the number
of the segment, so that a resumed run gives the same policy as an uninterrupted one. A run's identity is its recipe,
seed, threads, versions, and the policy that it starts from. A folder holds one run, which is finished when there is
`run.json`, written last. A finished run with fewer actions can go on: its checkpoint stays.
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
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

from kinreach import _provenance as provenance
from kinreach._checks import MAX_THREADS, check_count, check_path, shown
from kinreach._files import locked, make_writable, open_input, read_text, replacing, write_text
from kinreach.baselines._evaluation import HELD_OUT
from kinreach.baselines._learning_curve import COLUMNS, TRACE_COLUMNS, LearningCurve, curve_csv
from kinreach.baselines._models import Trainee, build
from kinreach.baselines._policies import LearnedPolicy, load_policy
from kinreach.baselines._policy_file import POLICY_FILE, PolicyCard, save_policy
from kinreach.baselines._recipes import Recipe
from kinreach.errors import InputError, KinreachError, OutputError, TrainingError

CHECKPOINT, POLICY, CURVE = "checkpoint.pt", POLICY_FILE, "curve.csv"
EPISODE, RUN, MODEL = "episode.csv", "run.json", "model.zip"
#: Of a run that went on: numbers of actions after which it was finished before.
LONGER_THAN = "longer_than"
#: Folder of TensorBoard's logs, in that of the run.
TENSORBOARD = "tensorboard"
#: Sizes of what is read again [bytes]; a checkpoint has the replay buffer.
MAX_RUN, MAX_CHECKPOINT = 16 * 1024 * 1024, 64 * 1024**3
#: Of torch's and numpy's generators.
MAX_SEED = 2**31 - 1
#: Called with the numbers of finished and of planned actions, and the last row of the learning curve by column.
TrainingProgress = Callable[[int, int, dict[str, float | None]], None]
#: Attributes of algorithms that change during training, if present.
_COUNTERS = ("num_timesteps", "_n_updates", "_episode_num", "_n_calls", "exploration_rate", "rate")
_CURVE = ("rows", "steps", "episodes", "trace", "traced", "_sums", "_counted", "_ended")
_BUFFER = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


@dataclass(frozen=True)
class Run:
    """A finished training run.

    Attributes:
        seconds: Wall time of the call that finished it.
        cpu_seconds: CPU time of that call.
    """

    folder: Path
    card: PolicyCard
    policy: LearnedPolicy
    seconds: float
    cpu_seconds: float


def _warn(text: str) -> None:
    warnings.warn(text, stacklevel=5)


def train(
    recipe: Recipe,
    folder: str | Path,
    *,
    seed: int = 0,
    steps: int | None = None,
    resume: bool = False,
    fresh: bool = False,
    start: str | Path | None = None,
    threads: int = 1,
    export: bool = False,
    progress: TrainingProgress = lambda done, planned, row: None,
    notice: Callable[[str], None] = _warn,
) -> Run:
    """Train a policy.

    The folder gets `policy.safetensors`, `curve.csv`, `run.json` (recipe, seed, threads, versions, digests of the
    code, times), TensorBoard's logs, and `checkpoint.pt`. Without `resume` the training begins anew and replaces the
    same run, or an interrupted one. Another finished run is an error, unless `fresh` is set.

    Run one training at a time in a process: it seeds the generators of `random`, `numpy` and torch. Torch's number of
    threads is restored.

    Args:
        recipe: What to train.
        folder: Created if it does not exist.
        seed: Of networks, exploration and training goals.
        steps: Actions instead of the recipe's.
        resume: Continue from the checkpoint in the folder, if it can be read; keep the same run if it is finished. With
            more `steps` a finished run goes on; schedules of the algorithm then refer to the new number.
        fresh: Replace any run in the folder.
        start: Policy with whose weights the actor begins, by its name or its file, such as the one that the recipe
            ships; its network must be the recipe's. Scheduled exploration stays at its last value.
        threads: Of torch. Another number gives another policy.
        export: Write stable-baselines3's own `model.zip` too. To load one with stable-baselines3 can run code: do so
            only with your own.
        progress: Called with the numbers of finished and of planned actions, and the last row of the learning curve.
        notice: Called with a sentence if a checkpoint is of other code or cannot be read; warns by default.

    Raises:
        OutputError: The folder cannot be written, or another training is writing there.
        InputError: An argument is invalid, the model cannot be exported, the start has another network than the recipe,
            or the folder holds another run.
        TrainingError: A reward, an observation, a loss or a weight became NaN or infinite; the last checkpoint is kept.
    """
    if not isinstance(recipe, Recipe):
        raise InputError(f"recipe must be a Recipe, see `get_recipe`; got {shown(recipe)}")
    seed = check_count("seed", seed, least=0, most=MAX_SEED)
    threads = check_count("threads", threads, most=MAX_THREADS)
    steps = None if steps is None else check_count("steps", steps)
    folder = check_path("folder", folder)
    if resume and fresh:
        raise InputError("resume goes on with a run, fresh replaces it: one of them")
    recipe = recipe if steps is None else replace(recipe, steps=steps)
    begins = None if start is None else load_policy(start)
    identity = run_identity(recipe, seed, threads, begins)
    with new_folders(folder), _written(folder):
        if (done := kept_run(folder, identity, resume=resume, fresh=fresh, export=export)) is not None:
            return done
        common: dict[str, Any] = {"begins": begins, "export": export, "progress": progress, "notice": notice}
        for _ in segments(recipe, folder, identity, resume=resume, **common):
            pass
        return _run_in(folder)


@contextmanager
def _written(folder: Path) -> Iterator[None]:
    """Make a folder for a training, which alone writes there."""
    make_writable(folder)
    with locked(folder, "a training"):
        yield


@contextmanager
def new_folders(folder: Path) -> Iterator[None]:
    """Remove the folders that a refused training has made, as long as they are empty."""
    there = next(each for each in (folder, *folder.absolute().parents) if each.exists())
    try:
        yield
    except KinreachError:
        for each in (folder / TENSORBOARD, folder, *folder.absolute().parents):
            if each == there:
                break
            with suppress(OSError):
                each.rmdir()
        raise


def run_identity(recipe: Recipe, seed: int, threads: int, begins: LearnedPolicy | None = None) -> dict[str, Any]:
    """Return the identity of a run, as JSON values."""
    facts = {"recipe": recipe.to_dict(), "seed": seed, "threads": threads, "versions": _versions()}
    try:
        written = json.dumps(facts | ({} if begins is None else {"start": begins.digest}), allow_nan=False)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"settings and options of the recipe {recipe.name} must be JSON values: {error}; a reward of your own "
            'is the recipe\'s reward="module:function"'
        ) from None
    return json.loads(written)


def kept_run(
    folder: Path, identity: Mapping[str, Any], *, resume: bool = True, fresh: bool = False, export: bool = False
) -> Run | None:
    """Return the run in a folder if it is finished and kept; `export` asks for stable-baselines3's own file as well."""
    if fresh or not _holds(folder, identity, resume=resume) or not resume:
        return None
    if export and not (folder / MODEL).exists():
        raise InputError(f"{folder} holds this run finished without {MODEL}; train it again without --resume")
    return _run_in(folder)


def _run_in(folder: Path) -> Run:
    run = json.loads(read_text(folder / RUN, "the run", most=MAX_RUN))
    policy = load_policy(folder / POLICY)
    return Run(folder, policy.card, policy, float(run["seconds"]), float(run["cpu_seconds"]))


def _holds(folder: Path, identity: Mapping[str, Any], *, resume: bool) -> bool:
    """Return whether a folder holds this run, finished; refuse another finished run, unless it can go on to this."""
    if not (folder / POLICY).exists() or (not (folder / RUN).exists() and (folder / CHECKPOINT).exists()):
        return False
    otherwise = "train into another folder, or replace it with --fresh (fresh=True)"
    try:
        run = json.loads(read_text(folder / RUN, "the run", most=MAX_RUN))
        _ = float(run["seconds"]), float(run["cpu_seconds"])
    except (OSError, ValueError, KeyError, TypeError):
        raise InputError(f"{folder} holds a policy, and no {RUN} with its recipe and seed; {otherwise}") from None
    if not (differences := _differences(run, identity)):
        return True
    if _is_shorter(run, identity):
        if resume and (folder / CHECKPOINT).exists():
            return False
        if resume:
            otherwise = f"it has no {CHECKPOINT} to go on with; begin with its policy, --from, in another folder"
        else:
            otherwise = f"go on with it with --resume (resume=True), {otherwise}"
    raise InputError(f"{folder} holds a finished run with {differences}; {otherwise}")


def _is_shorter(run: Mapping[str, Any], identity: Mapping[str, Any]) -> bool:
    """Return whether a run is another with fewer actions."""
    try:
        steps = run["recipe"]["steps"]
        other = {**run, "recipe": {**run["recipe"], "steps": identity["recipe"]["steps"]}}
        return bool(steps < identity["recipe"]["steps"]) and not _differences(other, identity)
    except (KeyError, TypeError):
        return False


def _differences(run: Mapping[str, Any], identity: Mapping[str, Any]) -> str:
    """Return the differences between two runs in words; empty if there are none."""
    other, wanted = dict(_flat(run)), dict(_flat(identity))
    names = [*wanted, *(name for name in other if name not in wanted and name.partition(".")[0] in identity)]
    found = [
        f"{name} {shown(other.get(name))}, not {shown(wanted.get(name))}"
        for name in names
        if (name in other) != (name in wanted) or other.get(name) != wanted.get(name)
    ]
    return "; ".join([*found[:3], f"{len(found) - 3} more"] if len(found) > 3 else found)


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield values of nested objects by their dotted names."""
    for name, value in values.items():
        if isinstance(value, dict) and value:
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def segments(
    recipe: Recipe,
    folder: Path,
    identity: Mapping[str, Any],
    *,
    resume: bool,
    begins: LearnedPolicy | None = None,
    export: bool = False,
    progress: TrainingProgress = lambda done, planned, row: None,
    notice: Callable[[str], None] = _warn,
) -> Iterator[LearnedPolicy]:
    """Train, and yield the policy after each segment; arguments and errors as in `train`.

    By then the segment's files are written, and after the last one those of the finished run.
    """
    others = torch.get_num_threads()
    torch.set_num_threads(identity["threads"])
    try:
        yield from _segments(recipe, folder, identity, resume, begins, export, progress, notice)
    finally:
        torch.set_num_threads(others)


def make_folder(folder: Path) -> None:
    """Create the folder of a run, and that of its logs."""
    make_writable(folder)
    make_writable(folder / TENSORBOARD)


def clear(folder: Path) -> None:
    """Remove the results of an earlier training, but not its checkpoint."""
    _remove(folder, (RUN, POLICY, MODEL, CURVE, EPISODE))


def _segments(
    recipe: Recipe,
    folder: Path,
    identity: Mapping[str, Any],
    resume: bool,
    begins: LearnedPolicy | None,
    export: bool,
    progress: TrainingProgress,
    notice: Callable[[str], None],
) -> Iterator[LearnedPolicy]:
    make_folder(folder)
    seed, source = identity["seed"], provenance.source_digest()
    clock, cpu = time.perf_counter(), time.process_time()
    checkpoint = folder / CHECKPOINT
    going_on = resume and checkpoint.exists()
    state = read_checkpoint(checkpoint, identity) if going_on else None
    trainee = build(recipe, _entropy(seed, 0)[0], steps=recipe.steps, start=begins)
    first = 0
    sources: list[str] = []
    ends: list[int] = []
    if state is not None:
        try:
            first, sources = restore(trainee, state)
            ends = _ends(state["identity"], recipe.steps)
        except (LookupError, TypeError, AttributeError, RuntimeError, ValueError):
            trainee.env.close()
            trainee = build(recipe, _entropy(seed, 0)[0], steps=recipe.steps, start=begins)
    if going_on and not first:
        notice(f"{checkpoint} cannot be read: the training starts over")
    if sources and sources[-1] != source:
        was = f"{checkpoint} was made by other code of kinreach ({sources[-1]}, now {source})"
        notice(f"{was}: the policy may not be that of an uninterrupted run")
    sources = sources if sources[-1:] == [source] else [*sources, source]
    model = trainee.model
    model.set_logger(configure(str(folder / TENSORBOARD), ["tensorboard"]))
    targets = _targets(recipe, model, ends)
    identity = {**identity, LONGER_THAN: ends} if ends else identity
    try:
        if not ends:  # a run that goes on is a finished one until it is longer
            clear(folder)
        if first:
            _write_curves(folder, trainee.curve)
        for segment, target in enumerate(targets):
            if segment < first:
                continue
            _begin_segment(trainee, seed, segment)
            try:
                _learn(trainee, target, _Report(trainee, recipe.steps, progress))
            except TrainingError as error:
                kept = "the last checkpoint is kept" if segment else "there is no checkpoint yet"
                raise TrainingError(f"{error} after {model.num_timesteps} actions; {kept}") from error
            _end_segment(trainee)
            last = segment + 1 == len(targets)
            save_checkpoint(checkpoint, {**identity, "sources": sources}, segment, trainee, last)
            _write_curves(folder, trainee.curve)
            yield LearnedPolicy(_card(recipe, identity, trainee, len(targets)), trainee.network)
    finally:
        trainee.env.close()
        model.logger.close()
    seconds, cpu_seconds = time.perf_counter() - clock, time.process_time() - cpu
    _remove(folder, (RUN, MODEL))
    save_policy(folder / POLICY, _card(recipe, identity, trainee, len(targets)), trainee.network)
    if export:
        archive = io.BytesIO()
        model.save(archive)
        with replacing(folder / MODEL) as temporary:
            temporary.write_bytes(archive.getbuffer())
    run = {**identity, "sources": sources, "steps": model.num_timesteps, "seconds": seconds, "cpu_seconds": cpu_seconds,
           "resumed": first > 0, "machine": provenance.machine()}  # fmt: skip
    write_text(folder / RUN, json.dumps(run, indent=2) + "\n")


def _card(recipe: Recipe, identity: Mapping[str, Any], trainee: Trainee, segments: int) -> PolicyCard:
    model, network = trainee.model, trainee.network
    discrete = isinstance(model.action_space, spaces.Discrete)
    return PolicyCard(
        environment=recipe.environment,
        meaning="preferences" if discrete else "posture" if recipe.networks.posture else "action",
        activation=network.activation,
        output=network.output,
        algorithm=recipe.algorithm,
        recipe=identity["recipe"] | {name: identity[name] for name in ("start", LONGER_THAN) if name in identity},
        seed=identity["seed"],
        steps=model.num_timesteps,
        versions=identity["versions"],
        goal_seeds=goal_seeds(identity["seed"], segments),
    )


def _remove(folder: Path, names: Iterable[str]) -> None:
    for name in names:
        try:
            (folder / name).unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(f"cannot remove {folder / name}: {error.strerror or error}") from error


def save_checkpoint(
    path: Path, identity: dict[str, Any], segment: int, trainee: Trainee, finished: bool = False
) -> None:
    """Write the state after a segment, whole or not at all; the identity has `sources`, digests of the code."""
    model, curve = trainee.model, trainee.curve
    state: dict[str, Any] = {
        "identity": identity,
        "segment": segment,
        "finished": finished,
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


def read_checkpoint(path: Path, identity: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the state after the last segment, or None if it cannot be read; refuse that of another run.

    That of a finished run with fewer actions is one that this run goes on from.
    """
    with open_input(path, "the checkpoint", most=MAX_CHECKPOINT) as file:
        try:
            if not zipfile.is_zipfile(file):  # torch would try it as a plain pickle, and warn before it refuses
                return None
            file.seek(0)
            state: dict[str, Any] = torch.load(file, weights_only=True)
            other = dict(state["identity"])
        except (OSError, pickle.UnpicklingError, RuntimeError, LookupError, TypeError, EOFError, ValueError):
            return None
    differences = _differences(other, identity)
    if differences and not (state.get("finished") is True and _is_shorter(other, identity)):
        raise InputError(
            f"{path} belongs to a run with {differences}; train without --resume to begin anew, or into another folder"
        )
    return state


def restore(trainee: Trainee, state: Mapping[str, Any]) -> tuple[int, list[str]]:
    """Restore the state of a checkpoint; return the number of the next segment, and digests of the code so far."""
    model, curve = trainee.model, trainee.curve
    model.set_parameters(state["parameters"])
    for name in _variables(model):
        getattr(model, name).data.copy_(state["variables"][name])
    for name in (name for name in _COUNTERS if hasattr(model, name)):
        setattr(model, name, state["counters"][name])
    for name in _CURVE:
        setattr(curve, name, state["curve"][name])
    if "buffer" in state:
        buffer: Any = model.replay_buffer  # type: ignore[attr-defined]
        for name in _BUFFER:
            rows = state["buffer"]["arrays"][name]
            getattr(buffer, name)[: len(rows)] = rows.numpy()
        buffer.pos, buffer.full = state["buffer"]["pos"], state["buffer"]["full"]
    return int(state["segment"]) + 1, [str(source) for source in state["identity"]["sources"]]


def _variables(model: BaseAlgorithm) -> list[str]:
    """Return names of tensors that are not parameters of a module, such as SAC's entropy coefficient."""
    _, names = model._get_torch_save_params()
    return list(names)


def _write_curves(folder: Path, curve: LearningCurve) -> None:
    write_text(folder / CURVE, curve_csv(curve.rows))
    if curve.traced and curve.trace:
        write_text(folder / EPISODE, curve_csv(curve.trace, TRACE_COLUMNS))


class _Report(BaseCallback):
    """Log and report each new row of the learning curve."""

    def __init__(self, trainee: Trainee, planned: int, progress: TrainingProgress) -> None:
        super().__init__()
        self._trainee, self._planned, self._progress = trainee, planned, progress
        self._rows = len(trainee.curve.rows)

    def _on_rollout_start(self) -> None:
        for name, value in self.logger.name_to_value.items():  # of the update before
            if "loss" in name and not math.isfinite(value):
                raise TrainingError(f"{name} became {value:g}")

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


def _learn(trainee: Trainee, target: int, callback: BaseCallback) -> None:
    model = trainee.model
    try:
        model.learn(
            target - model.num_timesteps,
            callback=callback,
            reset_num_timesteps=False,
            log_interval=None,  # type: ignore[arg-type]
        )
    finally:  # torch's distributions raise another error where a parameter is not finite
        for name, value in model.policy.named_parameters():
            if not torch.isfinite(value).all():
                raise TrainingError(f"the network's {name} became NaN or infinite")


def _ends(identity: Mapping[str, Any], steps: int) -> list[int]:
    """Return the numbers of actions after which the run of a checkpoint was finished, on its way to `steps`."""
    ends, last = [int(end) for end in identity.get(LONGER_THAN, ())], int(identity["recipe"]["steps"])
    return [*ends, last] if last < steps else ends


def _targets(recipe: Recipe, model: BaseAlgorithm, ends: Sequence[int]) -> list[int]:
    """Return the numbers of actions after each segment, in whole updates; the run was finished before after `ends`."""
    update = model.n_envs * (model.n_steps if isinstance(model, OnPolicyAlgorithm) else 1)
    targets: list[int] = []
    done = 0
    for end in (*ends, recipe.steps):
        more = math.ceil(end / update) - done
        segments = min(recipe.segments, more)
        targets += [update * (done + more * (index + 1) // segments) for index in range(segments)]
        done += more
    return targets


def _begin_segment(trainee: Trainee, seed: int, segment: int) -> None:
    """Seed all generators by seed and segment, and begin new episodes."""
    ours, torchs, numpys, environments = _entropy(seed, segment + 1)
    random.seed(ours)
    torch.manual_seed(torchs)
    np.random.seed(numpys)
    trainee.model.action_space.seed(ours)
    trainee.env.seed(environments)
    trainee.model._last_obs = None


def _end_segment(trainee: Trainee) -> None:
    """Cut the episodes of the learning curve and of the replay buffer.

    Returns over several steps would continue in the next row, which is of another episode.
    """
    trainee.curve.cut()
    buffer = getattr(trainee.model, "replay_buffer", None)
    if buffer is not None:
        last = buffer.pos - 1
        buffer.timeouts[last] = np.maximum(buffer.timeouts[last], 1 - buffer.dones[last])


def goal_seeds(seed: int, segments: int) -> dict[str, Any]:
    """Return the seeds of all goals of a policy, for its card; `segments` are the parts of the training."""
    return {"training": [_entropy(seed, index + 1)[3] for index in range(segments)], "held_out": HELD_OUT}


def _entropy(seed: int, key: int) -> list[int]:
    return [int(word >> 1) for word in np.random.SeedSequence(seed, spawn_key=(key,)).generate_state(4)]


def _versions() -> dict[str, str]:
    found = provenance.versions(("numpy", "torch", "stable-baselines3", "mujoco"))
    return {name: str(version) for name, version in found.items() if name != "kinreach-source"}
