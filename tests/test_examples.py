"""Every example runs as a user would run it, and what it prints says what it claims."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"


PAGE = (EXAMPLES.parent / "docs" / "guides/examples.md").read_text(encoding="utf-8")
NUMBER = re.compile(r"-?\d+\.?\d*(?:e[+-]?\d+)?(?: [mu]s\b)?")
#: Their numbers are of a training, which differs from processor to processor.
TRAINED = (
    "03_own_policy",
    "06_own_algorithm",
    "07_stable_baselines3",
    "08_pytorch_loop",
    "17_search",
    "20_behaviour_cloning",
    "21_hindsight",
)


def shown(name: str) -> str:
    """What the documentation says that an example prints."""
    (text,) = re.findall(
        rf"^\[`python examples/{name}\.py`\]\(.*?\)\n\n```text\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE
    )
    return text


def differences(shown: str, printed: str, *, trained: bool = False) -> list[tuple[str, str]]:
    """Where two outputs differ: in words, or in numbers by more than their last digit.

    Times may differ, and numbers of trainings; rounding errors (1e-15) by a factor of 100.
    """
    words = [" ".join(NUMBER.sub(" # ", text).split()) for text in (shown, printed)]
    if words[0] != words[1]:
        return [(words[0], words[1])]
    pairs = zip(NUMBER.findall(shown), NUMBER.findall(printed), strict=True)
    return [pair for pair in pairs if not trained and not alike(*pair)]


def alike(shown: str, printed: str) -> bool:
    if shown.endswith("s"):
        return printed[-2:] == shown[-2:]
    if "e" in shown:
        return "e" in printed and 0.01 <= float(printed) / float(shown) <= 100
    digits = len(shown.partition(".")[2])
    return abs(float(printed) - float(shown)) <= 1.01 * 10.0**-digits


def test_a_stale_output_is_noticed():
    said = "a: 100 % reached, 0.03 mm and 5.1 ms, 3e-16 off, [ 0.   -2.13]"
    assert differences(said, "a: 100 % reached, 0.04 mm and 99.0 ms, 2e-15 off, [-0.   -2.12]") == []
    stale = [("0.03", "1.50"), ("5.1 ms", "5.1 us"), ("3e-16", "3e-11"), ("-2.13", "-2.15"), ("mm", "m"), ("100", "98")]
    for old, new in stale:
        assert differences(said, said.replace(old, new)), (old, new)
    assert differences(said, said.replace("0.03", "7.50"), trained=True) == []
    assert differences(said, said.replace("reached", "missed"), trained=True)


@pytest.fixture
def run(tmp_path):
    """`run(name)`: what an example prints, run in an empty folder; it is what the documentation shows."""

    def run_example(name: str) -> str:
        done = subprocess.run(
            [sys.executable, str(EXAMPLES / f"{name}.py")],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(EXAMPLES.parent)},
            capture_output=True,
            text=True,
            timeout=1200,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        assert differences(shown(name), done.stdout, trained=name in TRAINED) == []
        return done.stdout

    return run_example


def reached(text: str) -> dict[str, float]:
    """Share of goals in percent by method, from lines such as `lm: 100 % reached, ...`."""
    return {name: float(share) for name, share in re.findall(r"^(\S+): ([\d.]+) % reached", text, re.MULTILINE)}


def numbers(pattern: str, text: str) -> list[float]:
    return [float(found) for found in re.findall(pattern, text)]


@pytest.mark.slow
def test_my_ur(run):
    text = run("01_my_ur")
    assert len(re.findall(r"^\d [\[ -].* free$", text, re.MULTILINE)) >= 2
    assert "x -0.5 m: [" in text
    assert "x -0.9 m: too far away" in text
    assert 0.5 < numbers(r"tool ([\d.]+) mm off there", text)[0] < 5


@pytest.mark.slow
def test_own_arm(run):
    text = run("13_own_arm")
    assert "Jacobian: (6, 7)" in text
    errors = numbers(r": ok, ([\d.]+) mm off", text)
    assert len(errors) == 3
    assert max(errors) < 0.1  # the solvers' tolerance
    touching = re.search(r"deeper touches: \[(.*)\]", text).group(1)
    assert "'table'" in touching
    assert "'panda_hand'" in touching
    assert "simulated move: reached" in text
    assert numbers(r"tip ([\d.]+) mm from the goal", text)[0] < 1.0
    assert "compare, lm: 100 % reached" in text


@pytest.mark.slow
def test_self_motion(run):
    text = run("14_self_motion")
    assert len(re.findall(r"^a curve of [\d.]+ rad, closed: False$", text, re.MULTILINE)) >= 3
    assert len(re.findall(r" on curve \d$", text, re.MULTILINE)) == 3


@pytest.mark.slow
def test_move_a_ur(run, tmp_path):
    text = run("15_move_a_ur")
    assert numbers(r"(\d+) straight lines", text)[0] > 1
    assert numbers(r"within (\d+) mrad", text)[0] < 10
    assert numbers(r"([\d.]+) mm from the goal", text)[0] < 0.2
    assert (tmp_path / "results" / "move_a_ur.png").stat().st_size > 10_000


@pytest.mark.slow
def test_own_solver(run):
    text = run("02_own_solver")
    assert reached(text) == {"closed-form": 100, "scipy": 100}
    assert max(numbers(r"reached, ([\d.]+) mm", text)) < 0.2


@pytest.mark.slow
def test_own_policy(run):
    text = run("03_own_policy")
    shares = reached(text)
    assert list(shares) == ["closed-form", "memory", "model"]
    assert shares["closed-form"] == 100
    assert shares["memory"] > 80
    assert shares["model"] == 0


@pytest.mark.slow
def test_own_reward(run):
    text = run("04_own_reward")
    ways = numbers(r"([\d.]+) rad from home", text)
    thesis, own = numbers(r"home: thesis (-?[\d.]+)", text), numbers(r"this reward (-?[\d.]+)", text)
    assert len(ways) == len(thesis) == len(own) >= 4
    possible = [i for i, value in enumerate(thesis) if value > -100]
    assert len(possible) >= 2
    for i in possible:  # minus a tenth of the way, and the distance, which is next to nothing
        assert own[i] == pytest.approx(-0.1 * ways[i], abs=0.02)
    assert max(range(len(own)), key=own.__getitem__) == min(possible, key=ways.__getitem__)
    mean, best = numbers(r"(-[\d.]+) (?:in the mean|for the best)", text)
    assert mean < best < 0


@pytest.mark.slow
def test_own_task(run):
    assert reached(run("05_own_task")) == {"closed-form": 100, "lm": 100, "ranked-single": 0, "random": 0}


@pytest.mark.slow
def test_own_environment(run):
    text = run("18_own_environment")
    assert numbers(r"to the goal: (\d+) of 20", text) == [20]


@pytest.mark.slow
def test_own_algorithm(run):
    pytest.importorskip("sb3_contrib")
    text = run("06_own_algorithm")
    assert {"curve.csv", "policy.safetensors", "run.json"} <= set(text.splitlines()[0].split())
    assert "trained: TQC" in text
    assert "[64, 64, 32, 6] silu" in text
    assert "on 200 held-out goals" in text


@pytest.mark.slow
def test_stable_baselines3(run, tmp_path):
    before, after = numbers(r"(?:before|after): (-?[\d.]+)", run("07_stable_baselines3"))
    assert after > before + 10
    assert after > -5
    assert (tmp_path / "results" / "reach.safetensors").stat().st_size > 10_000


@pytest.mark.slow
def test_hindsight(run):
    before, after = numbers(r"(?:before|after): (\d+) of 100", run("21_hindsight"))
    assert before <= 5
    assert after >= 40


@pytest.mark.slow
def test_pytorch_loop(run):
    text = run("08_pytorch_loop")
    distances = numbers(r"distance +(\d+) mm", text)
    assert len(distances) == 13
    assert distances[-1] < distances[0] / 3
    assert numbers(r"learned: .* ([\d.]+) mm in the median", text)[0] < distances[0] / 3


@pytest.mark.slow
def test_behaviour_cloning(run):
    pytest.importorskip("minari")
    text = run("20_behaviour_cloning")
    assert numbers(r"learned from (\d+) episodes", text) == [200]
    assert numbers(r"reached: (\d+) of 200", text)[0] > 100
    assert numbers(r"distance: ([\d.]+) mm", text)[0] < 10


@pytest.mark.slow
def test_so101(run):
    pytest.importorskip("placo")
    text = run("19_so101")
    assert numbers(r"([\d.]+) at most", text) == [0.0, 15.1]
    assert numbers(r"([\d.]+) a tick", text)[0] == 0.5


@pytest.mark.slow
def test_search(run, tmp_path):
    pytest.importorskip("optuna")
    text = run("17_search")
    finished, early = map(int, re.search(r"(\d) finished, (\d) ended early", text).groups())
    assert finished + early == 4
    assert finished >= 2
    assert re.search(r"^\d+ mm: rate [\d.e-]+, [2-8] epochs$", text, re.MULTILINE)
    assert (tmp_path / "results" / "search" / "trial-0" / "policy.safetensors").is_file()


@pytest.mark.usefixtures("needs_gl")
@pytest.mark.slow
def test_seeing(run, tmp_path):
    text = run("09_seeing")
    errors = numbers(r"([\d.]+) mm off", text)
    assert len(errors) == 6
    assert max(errors) < 1.0
    assert (tmp_path / "results" / "seeing.jpg").stat().st_size > 10_000


@pytest.mark.slow
def test_million(run):
    text = run("10_million_fk_ik")
    assert numbers(r"(\d+) of 1000000 solved", text) == [1e6, 1e6]
    assert max(numbers(r"([\de.-]+) mm off", text)) < 1e-4  # the closed form's tolerance of 1e-7 m
    assert len(re.findall(r"a pose takes fk [\d.]+ us, batch [\d.]+ us, nearest_batch [\d.]+ us", text)) == 2


@pytest.mark.slow
def test_calibrated_ur(run):
    text = run("11_calibrated_ur")
    assert "the data sheet is 3.5 mm off in the median" in text
    assert "8 postures for one pose" in text
    nominal, real = numbers(r"reached, ([\d.]+) mm from the goal", text)
    assert real < 0.1 < 1.0 < nominal


@pytest.mark.slow
def test_calibrate(run, tmp_path):
    text = run("16_calibrate")
    assert "rows         20 used, 0 dropped" in text
    before, after = numbers(r"([\d.]+) / [\d.]+  data sheet", text)[0], numbers(r"([\d.]+) / [\d.]+  expected", text)[0]
    assert after < 0.15 < 0.8 < before
    assert (tmp_path / "results" / "calibration.png").stat().st_size > 10_000


@pytest.mark.slow
def test_any_urdf(run):
    text = run("12_any_urdf")
    assert "UF_ROBOT: 7 joints, tip link_eef, SevenAxisKinematics" in text
    assert numbers(r"at once, ([\de.-]+) from Pinocchio's", text)[0] < 1e-10
    assert numbers(r"(\d+) singular postures", text)[0] >= 6
    assert min(numbers(r"(\d+) of 50 poses", text)) >= 45
    assert max(numbers(r"within ([\d.]+) mm", text)) <= 0.1
    assert "compare, lm: 100 % reached" in text
