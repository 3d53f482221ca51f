"""Trials made up for tests of what is done with trials, cameras for those without OpenGL, and policies that fail."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from kinreach.baselines.policies import Network, PolicyCard, read_policy, save_policy
from kinreach.checks import Floats
from kinreach.compare.tasks import UR5Task
from kinreach.compare.trials import EpisodeTrial, ReachTrial
from kinreach.sim.simulation import ArmSimulation
from kinreach.vision.cameras import SensorNoise
from kinreach.vision.goal_view import GoalLook, geometric_goal_view

TrialFactory = Callable[..., list[ReachTrial]]

_GOOD = ReachTrial(
    goal=0,
    method="closed-form",
    x=0.4,
    y=-0.1,
    z=-0.175,
    reached=True,
    impossible=False,
    status="completed",
    reason="",
    distance=0.0015,
    posture_error=0.002,
    reward=20.0,
    ik_error=1e-12,
    iterations=0,
    restarts=0,
    candidates=1,
    solve_s=2e-4,
    accept_s=1e-4,
    move_s=1.25,
    q=(0.1, -1.5, 1.5, -1.5, -1.5, 0.0),
    move_error=0.0015,
    seeing=0.0,
    deciding=-0.0005,
    moving=0.002,
)


@pytest.fixture
def make_trials() -> TrialFactory:
    """`make_trials(n, **values)`: good trials on goals 0 … n - 1, but for the given values."""
    return lambda count, **values: [replace(_GOOD, goal=index, **values) for index in range(count)]


@pytest.fixture
def impossible() -> ReachTrial:
    """A trial in which no posture was found."""
    nothing = dict.fromkeys(("q", "move_s", "ik_error", "move_error", "seeing", "deciding", "moving"))
    nothing |= {"reached": False, "reward": -100.0}
    return replace(_GOOD, impossible=True, status="out of reach", reason="too far", distance=0.5, **nothing)


@pytest.fixture
def make_episodes() -> Callable[..., list[EpisodeTrial]]:
    """`make_episodes(n, **values)`: episodes on goals 0 … n - 1 that were pressed, but for the given values."""
    good = EpisodeTrial(
        goal=0, method="analytic", x=0.4, y=-0.3, z=0.2, reached=True, impossible=False, status="pressed", reason="",
        distance=0.04, reward=85.0, solve_s=0.004, move_s=1.0, q=(0.1, 1.2, -0.3), steps=25, wrong_presses=0,
        energy=900.0,
    )  # fmt: skip
    return lambda count, **values: [replace(good, goal=index, **values) for index in range(count)]


@pytest.fixture(scope="module")
def button_policy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file with a policy for the button task that nobody trained: its preferences are random numbers."""
    rng = np.random.default_rng(5)
    linear = [(rng.standard_normal((54, 19)), rng.standard_normal(54))]
    one, none = np.ones(54), np.zeros(54)
    network = Network(np.zeros(19), np.ones(19), np.zeros(0), linear, "tanh", "linear", one, none)
    card = PolicyCard("kinreach/ButtonPress-v0", "preferences", "tanh", "linear", "none", {"name": "untrained"}, 0, 0)
    path = tmp_path_factory.mktemp("policy") / "untrained.safetensors"
    save_policy(path, card, network)
    return path


class StandInView:
    """Plays `CameraGoalView` without drawing: perfect cameras, or as the class's attributes say.

    Attributes:
        sigma: Of normal noise on the six numbers, drawn from the generator of the look [m].
        found: Which camera finds the ball.
        blind: Looks, counted from the first one on, in which none does.
        made: Every view that was made.
    """

    sigma: ClassVar[float] = 0.0
    found: ClassVar[tuple[bool, bool]] = (True, True)
    blind: ClassVar[tuple[int, ...]] = ()
    made: ClassVar[list[StandInView]] = []

    def __init__(self, arm: Any, *, width: int, height: int, pipeline: str, noise: SensorNoise) -> None:
        self.arm, self.width, self.height, self.pipeline, self.noise = arm, width, height, pipeline, noise
        self.looks: list[tuple[Floats, Floats]] = []
        self.closed = False
        self.made.append(self)

    def look(self, simulation: ArmSimulation, rng: np.random.Generator) -> GoalLook:
        """The posture and the ball are written down."""
        found = np.array(self.found) & (len(self.looks) not in self.blind)
        self.looks.append((simulation.q, simulation.ball_position))
        values = geometric_goal_view(self.arm, simulation.ball_position) + self.sigma * rng.standard_normal(6)
        return GoalLook(np.where(np.repeat(found, 3), values, 0.0), found, (None, None), ())

    def __enter__(self) -> StandInView:
        return self

    def __exit__(self, *_: object) -> None:
        self.closed = True


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch) -> type[StandInView]:
    """Cameras that a `StandInView` plays; change its attributes to spoil them."""
    fresh = type("Fresh", (StandInView,), {"made": []})
    monkeypatch.setattr("kinreach.compare.observation.CameraGoalView", fresh)
    return fresh


@pytest.fixture
def no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out figures and report; and the same code, even if somebody edits a module in between."""
    monkeypatch.setattr("kinreach.compare.figures.write_all", lambda out, trials, results: {})
    monkeypatch.setattr("kinreach.compare.report.write_report", lambda path, trials, results, figures: None)
    monkeypatch.setattr("kinreach.provenance.source_digest", lambda: "0" * 12)


@pytest.fixture
def clumsy(tmp_path: Path) -> Path:
    """A folder with `single.safetensors` and `multi.safetensors`: the shipped ones, but they run into the table."""
    for name in ("single", "multi"):
        card, network = read_policy(Path(str(files("kinreach.baselines"))) / "pretrained" / f"{name}.safetensors")
        lower = np.add(network.shift, (0, 0.3, 0, 0, 0, 0))  # shoulder_lift by 54 degrees, or at every step
        save_policy(tmp_path / f"{name}.safetensors", card, replace(network, shift=lower))
    return tmp_path


@pytest.fixture(scope="module")
def task() -> UR5Task:
    """The UR5's task."""
    return UR5Task()


@pytest.fixture(scope="module")
def simulation() -> ArmSimulation:
    """The UR5's simulation."""
    return ArmSimulation("ur5")
