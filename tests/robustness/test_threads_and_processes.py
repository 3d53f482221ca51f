"""Threads, forked and spawned processes, and pickles find what one thread of one process finds."""

import pickle
import subprocess
import sys
import warnings
from pathlib import Path

import cloudpickle
import numpy as np
import pytest

from kinreach.baselines.inside import LearnedPolicy
from kinreach.kinematics import (
    Arm3Kinematics,
    ArmKinematics,
    ClosedFormSolver,
    CollisionChecker,
    LevenbergMarquardtSolver,
    PlacoSolver,
    QPSolver,
    Solver,
    Tolerance,
    UR5Kinematics,
    URKinematics,
)
from kinreach.sim import ArmSimulation, BatchSimulation
from tests.cases import slow
from tools.endurance import workers
from tools.endurance.jobs import JOBS, SHARED, UNPICKLED

ROOT = Path(__file__).parents[2]
COSTLY = "lm, 3-DOF arm"
LIGHT = [name for name in JOBS if "reach" not in name and "dynamics" not in name and "Simulation" not in name]


@pytest.fixture
def impatient():
    """Threads take turns a thousand times as often as usual."""
    usual = sys.getswitchinterval()
    sys.setswitchinterval(5e-6)
    yield
    sys.setswitchinterval(usual)


@pytest.mark.usefixtures("impatient")
@pytest.mark.parametrize("name", [*(name for name in LIGHT if name != COSTLY), *slow(COSTLY)])
def test_eight_threads_find_what_one_finds(name):
    found = workers.in_threads(1, jobs=[name])
    assert found.count == workers.THREADS * (2 if name in SHARED else 1)


@pytest.mark.parametrize("name", LIGHT)
def test_warnings_of_the_process_are_left_alone(name, monkeypatch):
    """To silence a warning for a moment silences, or wakes, those of all other threads."""

    def forbidden(*_, **__):
        raise AssertionError("the filters of all threads are changed")

    make, do = JOBS[name]
    with monkeypatch.context() as patch:
        patch.setattr(warnings, "catch_warnings", forbidden)
        patch.setattr(warnings, "simplefilter", forbidden)
        found = do(make())
    assert len(found) > 0


@pytest.mark.slow
@pytest.mark.usefixtures("impatient")
def test_eight_threads_simulate_what_one_simulates():
    heavy = [name for name in JOBS if name not in LIGHT]
    assert workers.in_threads(1, jobs=heavy).count == workers.THREADS * len(heavy)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_processes_find_what_the_first_one_finds(method):
    """In a fresh interpreter: where a convex hull has failed before, qhull sorts the next ones in another way."""
    code = f"from tools.endurance import workers; print(workers.in_processes([{method!r}]).count)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=1200)
    assert done.stdout.strip() == str(3 * len(JOBS) - 2 * len(UNPICKLED)), done.stderr


@pytest.mark.parametrize("library", [pickle, cloudpickle])
@pytest.mark.parametrize("name", [name for name in LIGHT if name not in UNPICKLED])
def test_a_pickled_instance_is_as_good_as_the_first(name, library):
    make, do = JOBS[name]
    instance = make()
    expected = workers.bits(do(instance))
    twin = library.loads(library.dumps(instance))
    assert workers.bits(do(twin)) == expected
    assert workers.bits(do(instance)) == expected


def test_a_distance_does_not_depend_on_what_was_asked_before():
    postures = np.random.default_rng(7).uniform(-3.0, 3.0, (200, 6))
    checker = CollisionChecker("ur5-thesis")
    forwards = [checker.distance(q) for q in postures]
    backwards = [checker.distance(q) for q in postures[::-1]][::-1]
    assert forwards == backwards
    assert len({found.distance for found in forwards}) > 150


def test_a_pickled_instance_keeps_its_options():
    options = {"tolerance": Tolerance(1e-5, 1e-4), "dt": 0.1, "max_iterations": 7, "max_restarts": 3, "rng_seed": 5}
    solver = PlacoSolver(UR5Kinematics(tip="tool0", base="world"), **options)
    twin = pickle.loads(pickle.dumps(solver))
    assert {name: getattr(twin, name) for name in options} == options
    assert (twin.kin.tip, twin.kin.base) == ("tool0", "world")
    checker = CollisionChecker(UR5Kinematics(), obstacles=(), margin=0.05)
    twin = pickle.loads(pickle.dumps(checker))
    assert twin.pairs == checker.pairs
    assert not any("table" in pair for pair in twin.pairs)
    near = [q for q in np.random.default_rng(0).uniform(-2, 2, (300, 6)) if 0 < checker.distance(q).distance < 0.05]
    assert len(near) >= 5
    assert all(twin.in_collision(q) for q in near)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "options"),
    [("kinreach/UR5MultiStep-v0", {"backend": "kinematic"}), ("kinreach/UR5SingleStep-v0", {}),
     ("kinreach/ButtonPress-v0", {})],
)  # fmt: skip
def test_a_worker_that_is_killed_is_an_error_and_no_hang(name, options):
    assert workers.killed_worker(2, name=name, **options).count == 2


def test_what_is_not_for_several_threads_says_so():
    for each in (ArmSimulation, BatchSimulation):
        assert "one per thread" in " ".join(each.__doc__.lower().split()), each
    shared = [
        ArmKinematics, UR5Kinematics, URKinematics, Arm3Kinematics, ClosedFormSolver, LevenbergMarquardtSolver,
        QPSolver, PlacoSolver, CollisionChecker, Solver, LearnedPolicy,
    ]  # fmt: skip
    for each in shared:
        assert "Threads may share" in " ".join(each.__doc__.split()), each
