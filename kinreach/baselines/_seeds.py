"""Train all seeds of a recipe, each as a job of an engine; files come back as values."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from kinreach._files import locked, make_writable, read_bytes, replacing
from kinreach._jobs import Engine
from kinreach.baselines._policies import LearnedPolicy, load_policy
from kinreach.baselines._recipes import Recipe, get_recipe
from kinreach.baselines._training import (
    CHECKPOINT,
    MAX_CHECKPOINT,
    RUN,
    Run,
    clear,
    kept_run,
    make_folder,
    new_folders,
    read_checkpoint,
    run_identity,
    segments,
)


@dataclass(frozen=True)
class Training:
    """A training as a job.

    Attributes:
        name: Of the recipe, or `module:attribute`, which is imported where the job runs.
        begins: Policy with whose weights the actor begins, or None.
        export: As in `train`.
        checkpoint: Content of the checkpoint to resume, or None.
    """

    name: str
    recipe: Recipe
    identity: Mapping[str, Any]
    begins: LearnedPolicy | None
    export: bool
    checkpoint: bytes | None


class Kept(NamedTuple):
    """Results of a training so far.

    Attributes:
        files: Contents of the files in its folder, by their paths.
        notices: Sentences for `notice`.
    """

    done: int
    files: Mapping[str, bytes]
    notices: tuple[str, ...]


def train_seeds(
    name: str,
    folders: Mapping[int, Path],
    engine: Engine,
    *,
    steps: int | None,
    resume: bool,
    fresh: bool,
    start: str | Path | None,
    threads: int,
    export: bool,
    progress: Callable[[int, int], None],
    notice: Callable[[str], None],
) -> Iterator[Run]:
    """Train a recipe with several seeds, and yield each finished run; arguments and errors as in `train`.

    This process writes the folders, with the files of `train`, after every segment, wherever the trainings run. The
    name may be `module:attribute`. `progress` gets the actions of all seeds.

    Raises:
        ClusterError: The engine lost a training; finished ones are kept.
    """
    recipe = get_recipe(name)
    recipe = recipe if steps is None else replace(recipe, steps=steps)
    begins = None if start is None else load_policy(start)
    with ExitStack() as stack:
        jobs: list[Training] = []
        finished: list[Run] = []
        for seed, folder in folders.items():
            identity = run_identity(recipe, seed, threads, begins)
            stack.enter_context(new_folders(folder))
            make_writable(folder)
            stack.enter_context(locked(folder, "a training"))
            if (run := kept_run(folder, identity, resume=resume, fresh=fresh, export=export)) is not None:
                finished.append(run)
                continue
            make_folder(folder)
            checkpoint = None
            if resume and (path := folder / CHECKPOINT).exists():
                read_checkpoint(path, identity)  # refuses that of another run
                checkpoint = read_bytes(path, "the checkpoint", most=MAX_CHECKPOINT)
            jobs.append(Training(name, recipe, identity, begins, export, checkpoint))
        yield from finished
        done = dict.fromkeys(range(len(jobs)), 0)
        for index, kept in engine.map(train_here, jobs, threads=threads):
            job = jobs[index]
            folder = folders[job.identity["seed"]]
            _write(folder, kept.files, keep=job.checkpoint is not None)
            done[index] = kept.done
            progress(sum(done.values()) + recipe.steps * len(finished), recipe.steps * len(folders))
            for text in kept.notices:
                notice(text)
            if RUN in kept.files and (run := kept_run(folder, job.identity)) is not None:
                yield run


def train_here(job: Training) -> Iterator[Kept]:
    """Train in a temporary folder; yield its files after each segment and in the end."""
    if ":" in job.name:
        get_recipe(job.name)
    notices: list[str] = []
    with TemporaryDirectory(prefix="kinreach-") as name:
        folder = Path(name)
        if job.checkpoint is not None:
            (folder / CHECKPOINT).write_bytes(job.checkpoint)
        done = 0
        for policy in segments(
            job.recipe, folder, job.identity, resume=True, begins=job.begins, export=job.export, notice=notices.append
        ):  # fmt: skip
            done = policy.card.steps
            yield Kept(done, _contents(folder), tuple(notices))
            notices.clear()
        yield Kept(done, _contents(folder), tuple(notices))


def _contents(folder: Path) -> dict[str, bytes]:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def _write(folder: Path, files: Mapping[str, bytes], *, keep: bool) -> None:
    """Write files, last the one that marks the run as finished; a finished run stays until a longer one is."""
    if RUN in files or not keep:
        clear(folder)
    for name in sorted(files, key=lambda name: (name == RUN, name)):
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        with replacing(path) as temporary:
            temporary.write_bytes(files[name])
