"""The demo: runs, prints, films; and says in one line what is wrong."""

import re

import gymnasium as gym
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

from kinreach.baselines import load_policy
from kinreach.cli import main
from kinreach.demo import _cli
from kinreach.demo._caption import FOUND, MISSED, REACHED, Caption, Moment
from kinreach.plots._colours import own_colour
from tests.policy_files import copy_policy


@pytest.fixture(autouse=True)
def no_screen(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)


@pytest.mark.parametrize(("env", "backend", "steps"), [("single", "kinematic", 20), ("multi", "mujoco", 30)])
def test_the_analytic_policy_reaches(env, backend, steps, capsys):
    command = ["demo", "--env", env, "--backend", backend, "--steps", str(steps), "--print", "nothing"]
    assert main(command) == 0
    out, err = capsys.readouterr()
    assert "No screen here" in err
    reached = int(out.strip().split()[-1])
    assert reached == 20 if env == "single" else reached >= 1


@pytest.mark.parametrize(("env", "steps"), [("single", 5), ("multi", 60)])
def test_trained_policies_reach(env, steps, capsys):
    command = ["demo", "--env", env, "--policy", f"ranked-{env}", "--backend", "kinematic", "--steps", str(steps)]
    assert main([*command, "--print", "nothing"]) == 0
    assert int(capsys.readouterr().out.strip().split()[-1]) >= 4
    assert main(["demo", "--env", "button", "--policy", "ranked-single"]) == 2
    assert "available: a file of a policy, analytic" in capsys.readouterr().err


def test_it_prints_what_is_asked(capsys):
    command = ["demo", "--policy", "random", "--backend", "kinematic", "--steps", "12", "--reset-every", "5"]
    assert main([*command, "--env", "multi", "--print", "action,observation,reward"]) == 0
    lines = capsys.readouterr().out.splitlines()
    for name in ("action", "observation", "reward"):
        assert len([line for line in lines if f" {name}: " in line]) == 12
    assert "12 steps, 3 episodes" in lines[-1]


def test_an_environment_has_its_own_number_of_steps(monkeypatch, capsys):
    found = {}

    def run(env, policy, arguments, *_):
        found[arguments.env] = arguments.steps
        return 0, 0, arguments.steps

    monkeypatch.setattr(_cli, "_run", run)
    for name in ("single", "real-arm", "moving", "lift", "button"):
        assert main(["demo", "--env", name]) == 0
    assert found == {"single": 20, "real-arm": 6, "moving": 200, "lift": 5, "button": 10_000}
    assert capsys.readouterr().out.count(" steps, ") == 5


@pytest.mark.slow
def test_the_reports_test_runs_by_default(capsys):
    """Report, section 2.3: 10000 random steps, a reset every 1000 or when done, action and observation printed."""
    assert main(["demo", "--env", "button"]) == 0
    *lines, last = capsys.readouterr().out.splitlines()
    assert len(lines) == 20_000
    actions = [int(line.split(": ")[1]) for line in lines if " action: " in line]
    assert len(actions) == 10_000
    assert set(actions) == set(range(54))
    observations = [line for line in lines if " observation: " in line]
    assert len(observations) == 10_000
    assert all(len(line.split("[")[1].split()) in (19, 20) for line in observations)
    steps, _, episodes, *_ = last.split()
    assert steps == "10000"
    assert int(episodes) >= 10


@pytest.mark.parametrize(("actuation", "steps"), [("tuned", 150), ("report", 600)])
def test_the_button_is_pressed_on_both_actuations(actuation, steps, capsys):
    command = ["demo", "--env", "button", "--policy", "analytic", "--actuation", actuation, "--steps", str(steps)]
    assert main([*command, "--print", "nothing"]) == 0
    assert int(capsys.readouterr().out.strip().split()[-1]) >= 2


def test_one_seed_gives_one_output(capsys):
    outputs = []
    for _ in range(2):
        assert main(["demo", "--policy", "random", "--backend", "kinematic", "--steps", "5", "--print", "reward"]) == 0
        outputs.append(capsys.readouterr().out)
    assert outputs[0] == outputs[1]


@pytest.mark.slow
@pytest.mark.parametrize("ending", [".gif", ".mp4"])
def test_it_films(ending, tmp_path, needs_gl, capsys):
    path = tmp_path / f"film{ending}"
    assert main(["demo", "--steps", "1", "--print", "nothing", "--video", str(path)]) == 0
    assert path.stat().st_size > 10_000
    if ending == ".gif":
        with Image.open(path) as film:
            assert film.info["loop"] == 0  # without end
            assert film.n_frames > 15  # the move takes more than a second
            assert film.size == (960, 540)
            film.seek(film.n_frames - 1)
            last = np.asarray(film.convert("RGB"))
        assert written(last, REACHED) > 50
        assert written(last[: last.shape[0] // 2, -220:], own_colour("closed-form")) > 50  # the tip, enlarged


@pytest.mark.parametrize(("observation", "least"), [("camera", 100), ("geometric", 0)])
@pytest.mark.slow
def test_a_film_shows_where_the_cameras_found_the_ball(observation, least, tmp_path, needs_gl):
    path = tmp_path / "film.gif"
    command = ["demo", "--steps", "1", "--backend", "kinematic", "--observation", observation, "--video", str(path)]
    assert main([*command, "--print", "nothing"]) == 0
    with Image.open(path) as film:
        below_left = np.asarray(film.convert("RGB"))[200:, :270]
    assert least <= written(below_left, FOUND) <= 10 * least


@pytest.mark.slow
def test_a_full_gif_ends_the_demo(tmp_path, monkeypatch, needs_gl, capsys):
    """What was filmed until then is kept, and all episodes end."""
    monkeypatch.setattr("kinreach.demo._film.MAX_GIF_FRAMES", 30)
    path = tmp_path / "film.gif"
    assert main(["demo", "--env", "moving", "--policy", "random", "--print", "nothing", "--video", str(path)]) == 0
    printed = capsys.readouterr()
    assert int(printed.out.split(" steps")[0]) <= 30
    assert "mp4" in printed.err
    with Image.open(path) as film:
        assert 5 < film.n_frames <= 15  # Pillow joins frames that are the same


def written(frame, colour):
    """How many pixels have a colour."""
    return int((np.abs(frame - 255 * np.array(to_rgb(colour))).max(axis=2) < 12).sum())


def test_a_caption_says_method_distance_and_end():
    """The tip is enlarged within 100 mm of the goal, in the smallest circle that it fits into."""
    black = np.zeros((540, 960, 3), dtype=np.uint8)
    places = {}
    for mm in (0.4, 4.0, 40.0, 400.0):
        caption = Caption("ppo")
        frame = caption.write(black, Moment(np.array([0.0, 1e-3 * mm]), 1e-3 * mm))
        assert written(frame, REACHED) == written(frame, MISSED) == 0
        box = frame[:230, 740:]
        if mm > 100:
            assert not box.any()
            continue
        rows, _ = np.nonzero(np.abs(box - 255 * np.array(to_rgb(caption.colour))).max(axis=2) < 12)
        places[mm] = round(float(rows.mean()))
    assert len(set(places.values())) == 1  # four tenths of each circle
    for caption.reached, colour in ((True, REACHED), (False, MISSED)):
        caption.verdict = "reached" if caption.reached else "missed"
        assert written(caption.write(black, None), colour) > 50


@pytest.mark.slow
@pytest.mark.parametrize(("env", "policy", "steps", "least"), [("moving", "ppo", 25, 12), ("real-arm", None, 1, 15)])
def test_it_films_what_does_not_draw_itself(env, policy, steps, least, tmp_path, needs_gl, capsys):
    path = tmp_path / "film.gif"
    command = ["demo", "--env", env, "--steps", str(steps), "--print", "nothing", "--video", str(path)]
    assert main([*command, *(["--policy", policy] if policy else [])]) == 0
    with Image.open(path) as film:
        first = np.asarray(film.convert("RGB"), dtype=float)
        film.seek(film.n_frames - 1)
        assert film.n_frames >= least
        assert np.abs(np.asarray(film.convert("RGB")) - first).max() > 50  # the arm went somewhere


def test_policies_get_what_they_learned_from(tmp_path, capsys):
    recipe = {**load_policy("thesis-ppo-single").card.recipe, "options": {"goal_in": "image"}}
    copy_policy("thesis-ppo-single", tmp_path / "image.safetensors", recipe=recipe)
    said = ["--backend", "kinematic", "--print", "observation", "--steps", "1", "--policy"]
    seen = []
    for name in ("thesis-ppo-single", str(tmp_path / "image.safetensors")):
        assert main(["demo", *said, name], prog="kinreach") == 0
        numbers = re.search(r"observation: \[(.*?)\]", capsys.readouterr().out, re.DOTALL).group(1)
        seen.append(np.array(numbers.split(), dtype=float)[:6].reshape(2, 3))
    metres, image = seen
    np.testing.assert_allclose(image, np.hstack([metres[:, :2] / metres[:, 2:], metres[:, 2:]]), atol=5e-4)
    three = ["--backend", "kinematic", "--print", "nothing", "--steps", "3"]
    assert main(["demo", *three, "--policy", "panda-single"], prog="kinreach") == 0
    assert "goal reached in 3" in capsys.readouterr().out


def test_episodes_are_short_unless_options_say_otherwise(monkeypatch, capsys):
    made, make = [], gym.make
    monkeypatch.setattr(gym, "make", lambda name, **options: made.append(options) or make(name, **options))
    for more in ([], ["--balls", "2"]):
        assert main(["demo", "--env", "real-arm", "--steps", "1", "--print", "nothing", *more]) == 0
    assert [options["balls"] for options in made] == [4, 2]


def test_films_name_the_method_that_acts(monkeypatch):
    class Seen(Exception):
        pass

    def make(task, mode, options, caption):
        raise Seen(caption.name)

    monkeypatch.setattr("kinreach.demo._cli._make", make)
    for env, given, name in (("single", [], "closed-form"), ("button", ["--policy", "analytic"], "analytic")):
        with pytest.raises(Seen, match=f"^{name}$"):
            main(["demo", "--env", env, *given])


@pytest.mark.slow
def test_methods_of_a_comparison_act(capsys):
    assert main(["demo", "--env", "moving", "--policy", "interception", "--steps", "60", "--print", "nothing"]) == 0
    assert "60 steps" in capsys.readouterr().out
    assert main(["demo", "--env", "moving", "--policy", "placo"]) == 2
    assert "first-sight, gradient-moving, gradient-moving-clear, interception" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--env", "chess"], "button, lift, moving, multi, obstacles, real-arm, single, space"),
        (["--env", "button", "--actuation", "magic"], "report, tuned"),
        (["--policy", "wisdom"], "closed-form, hybrid, lm, panda-single, pixels-single, placo, ppo-single, qp, random"),
        (["--policy", "space-single"], "unknown policy for kinreach/UR5SingleStep-v0"),
        (["--steps", "0"], "at least 1"),
        (["--print", "money"], "nothing"),
        (["--video", "film.avi"], ".gif or .mp4"),
        (["--backend", "bullet"], "kinematic, mujoco"),
    ],
)
def test_bad_input_is_one_line(arguments, message, capsys):
    assert main(["demo", *arguments]) == 2
    err = capsys.readouterr().err.strip().splitlines()[-1]
    assert message in err
    assert "Traceback" not in err


def test_a_policy_of_ones_own(capsys):
    assert main(["demo", "--policy", "kinreach.kinematics:QPSolver", "--backend", "kinematic", "--steps", "1"]) == 0
    assert "goal reached in 1" in capsys.readouterr().out


@pytest.mark.parametrize(("env", "flags"), [
    ("single", ["--observation", "--backend", "--resolution", "--margin"]),
    ("moving", ["--speeds", "--paths", "[m/s]"]),
    ("button", ["--actuation", "--max-episode-steps"]),
])  # fmt: skip
def test_help_lists_the_options_of_the_environment(env, flags, capsys):
    with pytest.raises(SystemExit):
        main(["demo", "--env", env, "--help"])
    said = capsys.readouterr().out
    assert f"options of {env}:" in said
    for words in flags:
        assert words in said


def test_options_of_the_environment_are_its_own(capsys):
    command = ["demo", "--env", "moving", "--steps", "2", "--print", "nothing"]
    assert main([*command, "--speeds", "0.1,0.2"]) == 0
    assert "2 steps" in capsys.readouterr().out
    assert main([*command, "--speeds", "5"]) == 2
    assert "the arm's tip is no faster" in capsys.readouterr().err
