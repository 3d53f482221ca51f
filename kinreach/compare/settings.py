"""What a comparison is asked to do, checked before anything is measured."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass
from typing import Any

from kinreach.checks import check_count, check_known, shown
from kinreach.compare.methods import METHODS, known, short_name
from kinreach.compare.observation import CAMERA, GEOMETRIC, CameraSettings
from kinreach.compare.tasks import TASKS, ButtonTask
from kinreach.compare.tasks.button import EpisodeSettings
from kinreach.errors import InputError, raise_unknown

DEFAULT_GOALS = 200
#: More are refused before anything is measured: a comparison of so many would take a month, and its results gigabytes.
MOST_GOALS = 10**7
MOST_SEED = 2**63 - 1


@dataclass(frozen=True)
class Settings:
    """A comparison: the same settings give the same numbers, times aside.

    Attributes:
        task: Name of a task.
        methods: Names of the methods to compare, or paths of policies' files (`*.safetensors`, tasks `"ur5"` and
            `"button"`); all of the task's own if empty.
        goals: Number of goals.
        seed: Of the goals and of the cameras' noise. The first N goals of a seed, and what is seen of them, are the
            same for every number of goals.
        observation: What the methods are told: `"geometric"`, the true goal, or `"camera"`, what the cameras saw.
        camera: How the cameras look; its defaults if None and the observation is `"camera"`.
        episode: Of the task `"button"`: how long episodes are and how the arm is driven; its defaults if None.

    Raises:
        UnknownNameError: A task, method or observation does not exist; the message lists those that do.
        InputError: A number is out of range, a method is named twice, or there are options for cameras that do not
            look or for episodes that are not played.
    """

    task: str = "ur5"
    methods: tuple[str, ...] = ()
    goals: int = DEFAULT_GOALS
    seed: int = 0
    observation: str = GEOMETRIC
    camera: CameraSettings | None = None
    episode: EpisodeSettings | None = None

    def __post_init__(self) -> None:
        check_known("task", self.task, TASKS)
        available = METHODS[self.task]
        object.__setattr__(self, "methods", _names(self.methods) or tuple(available))
        for name in self.methods:
            if not known(self.task, name):
                raise_unknown(f"{self.task} method", name, available)
        for name, count in Counter(map(short_name, self.methods)).items():
            if count > 1:
                raise InputError(f"method {name!r} is named twice")
        object.__setattr__(self, "goals", check_count("the number of goals", self.goals, most=MOST_GOALS))
        object.__setattr__(self, "seed", check_count("the seed", self.seed, least=0, most=MOST_SEED))
        check_known(f"{self.task} observation", self.observation, TASKS[self.task].observations)
        for kind, group in ((CameraSettings, self.camera), (EpisodeSettings, self.episode)):
            if group is not None and not isinstance(group, kind):
                raise InputError(f"{shown(group)} is no {kind.__name__}")
        if self.observation == CAMERA and self.camera is None:
            object.__setattr__(self, "camera", CameraSettings())
        if self.observation != CAMERA and self.camera is not None:
            raise InputError(
                f"pipeline, resolution and noise need observation '{CAMERA}', got observation '{self.observation}'"
            )
        if self.task == ButtonTask.name and self.episode is None:
            object.__setattr__(self, "episode", EpisodeSettings())
        if self.task != ButtonTask.name and self.episode is not None:
            raise InputError(f"max steps and actuation need task '{ButtonTask.name}', got task '{self.task}'")

    def to_dict(self) -> dict[str, Any]:
        """As JSON types."""
        return {**asdict(self), "methods": list(self.methods)}


def _names(methods: Any) -> tuple[str, ...]:
    """Names of methods; what is printed, drawn and written to files must be text that can be."""
    names = tuple(methods) if isinstance(methods, list | tuple) else (methods,)
    for name in names:
        if not isinstance(name, str) or not name.isprintable():
            raise InputError(f"methods must be named in printable text, got {shown(name)}")
    return names
