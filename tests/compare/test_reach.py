"""The reach tasks: solvers and policies in the environments, and where the distance that is left comes from."""

import json
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import kinreach
from kinreach._registration import SINGLE
from kinreach.baselines import rollout
from kinreach.baselines.inside import SolverPolicy
from kinreach.cli import main
from kinreach.compare import _curves as curves
from kinreach.compare import _figures as figures
from kinreach.compare import compare, get_task, resets_to
from kinreach.compare._reach import Budget, budget, goals_of
from kinreach.compare._runner import WARM_UP_GOALS
from kinreach.errors import InputError
from kinreach.kinematics import URKinematics
from kinreach.robots import BoxRegion, get_arm
from kinreach.vision import CameraGoalView

PRETRAINED = Path(kinreach.__file__).parent / "baselines/pretrained"
SOLVERS = ["closed-form", "lm", "qp"]
#: A pose 8 m away.
FAR = np.eye(4)
FAR[:3, 3] = 5.0


@pytest.fixture(scope="module")
def results():
    return compare(
        "ur5", ["closed-form", "lm", "ranked-single", "ranked-multi", "thesis-ppo-single", "hybrid"], goals=12
    )


def entry(results, name):
    return next(entry for entry in results["methods"] if entry["name"] == name)


def test_the_parts_of_a_distance_sum_to_it():
    rng = np.random.default_rng(0)
    for _ in range(500):
        goal, seen, meant, tip = rng.normal(size=(4, 3))
        parts = budget(goal, seen, meant, tip)
        assert sum(parts) == pytest.approx(np.linalg.norm(tip - goal))
        turned = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        assert budget(*(turned @ point + 1.0 for point in (goal, seen, meant, tip))) == pytest.approx(parts)
    assert budget(goal, seen, meant, goal) == Budget(0.0, 0.0, 0.0)
    assert budget(goal, goal, goal, tip) == pytest.approx((0.0, 0.0, np.linalg.norm(tip - goal)))


@pytest.mark.slow
def test_who_reaches(results):
    shares = {found["name"]: found["reached"] for found in results["methods"]}
    assert shares.pop("thesis-ppo-single") == 0.0
    assert set(shares.values()) == {1.0}


def test_the_closed_form_is_exact_and_the_controller_is_what_is_left(results):
    closed = entry(results, "closed-form")
    assert closed["ik_error_mm"]["p95"] < 1e-7
    assert closed["distance_mm"]["p95"] < 0.1
    assert closed["budget_mm"]["seeing"] == 0.0
    assert abs(closed["budget_mm"]["deciding"]) < 1e-7
    for found in results["methods"]:
        parts = found["budget_mm"]
        assert parts["seeing"] + parts["deciding"] + parts["moving"] == pytest.approx(parts["distance"], abs=1e-9)


def test_effort_is_counted(results):
    assert entry(results, "closed-form")["iterations"]["median"] == 0
    assert entry(results, "lm")["iterations"]["median"] >= 2
    assert entry(results, "hybrid")["iterations"]["median"] < entry(results, "lm")["iterations"]["median"]
    assert entry(results, "ranked-single")["iterations"]["median"] == 1
    assert entry(results, "ranked-multi")["iterations"]["median"] > 5
    assert entry(results, "ranked-single")["restarts"]["median"] is None  # policies have none
    assert entry(results, "closed-form")["candidates"]["median"] >= 1


def test_kinds_and_what_they_are_given(results):
    kinds = {found["name"]: found["kind"] for found in results["methods"]}
    assert (kinds["closed-form"], kinds["ranked-multi"], kinds["hybrid"]) == ("solver", "policy", "seeded solver")
    assert {f"given to a {kind}" for kind in kinds.values()} <= set(results["settings"]["terms"])


@pytest.mark.slow
def test_the_same_seed_gives_the_same_numbers(results):
    again = compare("ur5", ["ranked-multi", "closed-form"], goals=12)
    for name in ("closed-form", "ranked-multi"):
        for key in ("distance_mm", "reward_mean", "move_s", "budget_mm"):
            assert entry(again, name)[key] == entry(results, name)[key]


@pytest.mark.slow
def test_cameras_tell_all_methods_the_same(needs_gl, monkeypatch):
    looks, measure = [], CameraGoalView.measure
    monkeypatch.setattr(CameraGoalView, "measure", lambda *arguments: looks.append(1) or measure(*arguments))
    results = compare("ur5", ["closed-form", "ranked-single"], goals=3, observation="camera")
    assert len(looks) == 3 + WARM_UP_GOALS  # one look a goal
    closed, ranked = results["methods"]
    assert closed["observed_error_mm"] == ranked["observed_error_mm"]
    assert 0.01 < closed["observed_error_mm"]["median"] < 1.0
    assert closed["ik_error_mm"]["p95"] < 1e-7  # it goes where it was told
    assert closed["distance_mm"]["median"] > 0.05
    assert closed["reached"] == 1.0


@pytest.mark.slow
def test_noise_is_that_of_seed_and_goal_whoever_is_compared(needs_gl):
    noisy = {"observation": "camera", "options": {"rgb_noise": 6.0, "depth_noise": 0.002}}
    alone = compare("ur5", ["closed-form"], goals=2, seed=3, **noisy)
    among = compare("ur5", ["ranked-single", "closed-form"], goals=2, seed=3, **noisy)
    assert entry(among, "closed-form")["observed_error_mm"] == entry(alone, "closed-form")["observed_error_mm"]
    other = compare("ur5", ["closed-form"], goals=2, seed=4, **noisy)
    assert entry(other, "closed-form")["observed_error_mm"] != entry(alone, "closed-form")["observed_error_mm"]


class Nowhere:
    """A solver that finds nothing."""

    def solve(self, goal, seed, *, accept=None):
        kin = URKinematics("ur5-thesis", tip="tcp", base="world")
        return kin.nearest(FAR, seed)


def test_every_goal_of_every_seed_has_noise_of_its_own():
    seeds = {reset["seed"] for seed in range(4) for reset in resets_to(np.zeros((50, 3)), seed)}
    assert len(seeds) == 200


def test_a_solver_that_finds_nothing_is_impossible_and_says_why():
    (found,) = compare("ur5", [Nowhere], goals=3)["methods"]
    assert (found["kind"], found["impossible"], found["reached"]) == ("solver", 1.0, 0.0)
    assert found["outcomes"] == {"forfeited": 3}
    assert found["reward_mean"] == -100.0
    assert found["ik_error_mm"]["median"] is None
    env = gym.make(SINGLE, backend="kinematic")
    (trial,) = rollout(env, SolverPolicy(Nowhere(), env), [{"seed": 0}])
    assert "stretched elbow" in trial["impossible_reason"]
    blind = SolverPolicy(Nowhere(), env)
    for unseen in (np.full(3, np.nan), [0.5, np.nan, -0.175], [0.5, 0.1, np.inf]):
        blind.reset(None, {"q": np.zeros(6), "seen": unseen})
        assert blind.act(None) is None
        assert (blind.reason, blind.diagnostics) == ("no camera found the ball", {"iterations": 0})


class Low:
    """A solver that aims 20 mm below the goal: the finger tips are pressed into the table, near the goal."""

    def solve(self, goal, seed, *, accept=None):
        kin = URKinematics("ur5-thesis", tip="tcp", base="world")
        return kin.axis_goal(goal.position - (0.0, 0.0, 0.02), goal.axis, seed)


def test_what_is_impossible_is_no_success_however_near_it_ended():
    (found,) = compare("ur5", [Low], goals=3)["methods"]
    assert found["impossible"] == 1.0
    assert found["distance_mm"]["p95"] < 25
    assert set(found["success_at_mm"].values()) == {0.0}


def test_a_posture_that_cannot_be_taken_is_impossible():
    def into_the_table(observation):
        return np.array([-0.5, 0.1, 0.0, 0.0, 0.0, 0.0])  # the arm stretched out, slanting into the table

    (found,) = compare("ur5", [into_the_table], goals=2)["methods"]
    assert found["impossible"] == 1.0
    assert found["success_at_mm"]["50"] == 0.0


def test_the_arm3_task_keeps_what_some_posture_reaches():
    results = compare("arm3", SOLVERS, goals=6)
    assert [found["reached"] for found in results["methods"]] == [1.0, 1.0, 1.0]
    assert entry(results, "closed-form")["distance_mm"]["p95"] < 0.1
    assert "posture_error" not in results["methods"][0]


def test_an_arm_that_reaches_no_goal_is_said_so():
    arm = get_arm("arm3")
    far = replace(arm, workcell=replace(arm.workcell, goals=BoxRegion(x=(3.0, 4.0), y=(0.0, 1.0), z=(0.2, 0.4))))
    with pytest.raises(InputError, match="arm 'arm3' reaches none of 1000 goals"):
        compare("arm3", ["closed-form"], arm=far, goals=1)


def test_goals_of_arm3_are_those_drawn_that_some_posture_reaches():
    env = gym.make(SINGLE, arm="arm3").unwrapped
    drawn = goals_of(env, 14, 2).tolist()
    kept = [reset["options"]["goal"].tolist() for reset in get_task("arm3").resets(14, 2, env)]
    refused = [goal for goal in drawn if goal not in kept]
    assert len(refused) >= 1
    assert [goal for goal in drawn if goal in kept] == kept[: len(drawn) - len(refused)]
    for goal in (*kept, *refused):
        found = env.kinematics.all_solutions(goal).q
        assert any(env.accept(q) for q in found) == (goal in kept)


@pytest.mark.slow
def test_one_missing_package_disables_its_own_method_only(run_python):
    code = """
import sys
sys.modules["placo"] = None
from kinreach.compare import compare, _figures as figures
from kinreach.errors import InstallationError
results = compare("ur5", goals=1)
print([entry["name"] for entry in results["methods"]])
print(results["settings"]["left_out"])
try:
    compare("ur5", ["placo"], goals=1)
except InstallationError as error:
    print("refused:", error)
"""
    done = run_python("-c", code)
    assert done.returncode == 0, done.stderr
    names, left_out, refused = done.stdout.splitlines()
    assert "'lm'" in names
    assert "'placo'" not in names
    assert "placo" in left_out
    assert refused.startswith("refused: cannot import placo")


@pytest.mark.usefixtures("needs_placo")
def test_an_arm_from_its_urdf_file_on_the_command_line(tmp_path, capsys, without_pictures):
    file = f"{get_arm('ur5').package_root()}/example-robot-data/robots/ur_description/urdf/ur5_robot.urdf"
    arguments = ["--arm", file, "--goals", "3", "--out", str(tmp_path)]
    assert main(["compare", *arguments]) == 0
    found = json.loads((tmp_path / "results.json").read_text())
    assert [entry["name"] for entry in found["methods"]] == ["closed-form", "placo", "lm", "qp"]
    assert {entry["reached"] for entry in found["methods"]} == {1.0}
    assert file in capsys.readouterr().out


@pytest.mark.usefixtures("needs_placo")
@pytest.mark.slow
def test_the_panda_has_solvers_and_a_policy_of_its_own():
    found = compare("ur5", arm="panda", goals=10)
    assert [entry["name"] for entry in found["methods"]] == ["closed-form", "placo", "lm", "qp", "panda-single"]
    assert {entry["reached"] for entry in found["methods"]} == {1.0}
    with pytest.raises(InputError, match="trained on the arm 'panda'"):
        compare("ur5", methods=[str(PRETRAINED / "panda-single.safetensors")], goals=1)


@pytest.mark.usefixtures("needs_placo")
@pytest.mark.parametrize("task", ["ur5", "space"])
@pytest.mark.slow
def test_five_joints_have_solvers_and_placo_with_weights(task):
    found = compare(task, arm="so101", goals=6)
    assert [entry["name"] for entry in found["methods"]] == ["closed-form", "placo", "lm", "qp", "placo-weights"]
    assert [entry["reached"] for entry in found["methods"]][:4] == 4 * [1.0]
    errors = {entry["name"]: entry["distance_mm"]["median"] for entry in found["methods"]}
    assert errors["closed-form"] < 0.1 < errors["placo-weights"]  # what its weights leave of the point


@pytest.mark.parametrize("medians", [(1e-5, 0.04, 1.4, 43.0), (0.02, 8.0), (3.0,)])
def test_figures_show_where_methods_differ(medians):
    """`errors` has one scale in both panels; `success` reaches from the smallest distances to the largest tolerance."""
    rng, tolerances = np.random.default_rng(0), ["50", "5", "0.5"]
    methods, trials = [], []
    for number, middle in enumerate(medians):
        found = middle * rng.lognormal(0.0, 0.5, 40)
        trials += [
            {"method": str(number), "goal_index": i, "impossible": False, "distance": d / 1e3}
            for i, d in enumerate(found)
        ]
        share = {name: float((found <= float(name)).mean()) for name in tolerances}
        intervals = {name: [max(0.0, at - 0.1), min(1.0, at + 0.1)] for name, at in share.items()}
        said = {"success_at_mm": share, "success_at_mm_ci": intervals}
        methods.append({"name": str(number), "goals": 40, "colour": f"C{number}", **said})
    results = {"methods": methods, "settings": {"goals": 40, "seed": 0, "command": "again"}}
    (axes,) = curves.draw_success(trials, results).axes
    low, high = axes.get_xlim()
    assert low <= 1e3 * min(trial["distance"] for trial in trials) * 3.0
    assert low > 1e3 * min(trial["distance"] for trial in trials) / 30.0
    assert 50.0 < high < 100.0
    marks = [line for line in axes.get_lines() if line.get_marker() == "o"]
    assert len(marks) == len(medians)
    for mark, method in zip(marks, methods, strict=True):
        assert mark.get_xdata() == pytest.approx([float(name) for name in tolerances])
        assert mark.get_ydata() == pytest.approx([100 * share for share in method["success_at_mm"].values()])
    draw = figures.draw_errors(lambda t: 10.0 * 1e3 * t["distance"], lambda t: None, near_mm=10.0)
    left, right = draw(trials, results).axes
    assert left.get_xlim() == right.get_xlim()
