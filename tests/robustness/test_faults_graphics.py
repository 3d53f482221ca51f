"""A graphics library that fails in the middle: one kind of error, and everything else goes on."""

import gymnasium as gym
import mujoco
import numpy as np
import pytest

import kinreach  # noqa: F401 (registers the environments)
from kinreach.compare import compare
from kinreach.errors import DrawingError, KinreachError
from kinreach.sim import ArmSimulation, render
from kinreach.sim.inside import FrameRenderer
from tests.cases import slow

pytestmark = pytest.mark.usefixtures("needs_gl")
DRAWN = mujoco.Renderer.render


@pytest.fixture
def failing_frame(monkeypatch):
    """`failing_frame(n)`: the n-th frame from now on cannot be drawn, the others can."""

    def fail(number):
        drawn = 0

        def draw(self, **options):
            nonlocal drawn
            drawn += 1
            if drawn == number:
                raise mujoco.FatalError("gladLoadGL error")
            return DRAWN(self, **options)

        monkeypatch.setattr(mujoco.Renderer, "render", draw)

    return fail


@pytest.mark.parametrize("number", [1, 5])
@pytest.mark.slow
def test_an_environment_says_which_frame_failed_and_goes_on(number, failing_frame):
    env = gym.make("kinreach/UR5SingleStep-v0", backend="kinematic", observation="camera").unwrapped
    failing_frame(number)
    outcomes = []
    for seed in range(4):
        try:
            outcomes.append(env.reset(seed=seed)[0])
        except DrawingError as error:
            outcomes.append(str(error))
    failed = [outcome for outcome in outcomes if isinstance(outcome, str)]
    assert len(failed) == 1
    assert failed[0].startswith(f"cannot draw frame {number} of 640x360 pixels, camera ")
    assert "gladLoadGL error" in failed[0]
    assert isinstance(DrawingError(""), KinreachError)
    env.close()
    fresh = gym.make("kinreach/UR5SingleStep-v0", backend="kinematic", observation="camera").unwrapped
    np.testing.assert_array_equal(fresh.reset(seed=3)[0], outcomes[3])
    fresh.close()


@pytest.mark.parametrize("mode", ["rgb_array", "depth_array"])
def test_a_picture_of_an_environment_fails_alone(mode, failing_frame):
    env = gym.make("kinreach/ButtonPress-v0", render_mode=mode).unwrapped
    env.reset(seed=0)
    failing_frame(2)
    before = env.render()
    with pytest.raises(DrawingError, match="frame 2"):
        env.render()
    np.testing.assert_array_equal(env.render(), before)
    env.step(13)
    env.close()


def test_a_context_that_cannot_be_made(monkeypatch):
    def refuse(*arguments, **options):
        raise RuntimeError("Cannot initialize a EGL device display")

    simulation = ArmSimulation("ur5-thesis")
    with monkeypatch.context() as patch:
        patch.setattr(mujoco, "Renderer", refuse)
        with pytest.raises(DrawingError, match="64x36 pixels: Cannot initialize"):
            FrameRenderer(simulation.model, width=64, height=36)
    assert render(simulation, width=64, height=36).shape == (36, 64, 3)


@pytest.mark.parametrize("camera", ["front", *slow("wrist", "overview")])
def test_a_frame_does_not_depend_on_the_ones_before_it(camera):
    simulation = ArmSimulation("ur5-thesis", visual=True)
    with FrameRenderer(simulation.model, width=160, height=90, shadows=False) as renderer:
        first = [renderer.rgb(simulation.data, camera), renderer.depth(simulation.data, camera)]
        for other in ("overview", "front", "wrist", camera):
            renderer.rgb(simulation.data, other)
            np.testing.assert_array_equal(renderer.rgb(simulation.data, camera), first[0])
            np.testing.assert_array_equal(renderer.depth(simulation.data, camera), first[1])


def test_a_closed_renderer_says_so():
    simulation = ArmSimulation("ur5-thesis")
    renderer = FrameRenderer(simulation.model, width=64, height=36)
    renderer.rgb(simulation.data, "front")
    for _ in range(2):
        renderer.close()
    with pytest.raises(DrawingError, match="close"):
        renderer.rgb(simulation.data, "front")


@pytest.mark.slow
def test_a_comparison_keeps_what_it_has_seen_and_goes_on(failing_frame, no_source_changes, tmp_path, monkeypatch):
    monkeypatch.setattr("kinreach.compare._figures.write_figures", lambda *arguments: {})
    monkeypatch.setattr("kinreach.compare._report.render_trials", lambda *arguments: [])
    settings = {"methods": ["closed-form"], "goals": 4, "seed": 1, "observation": "camera"}
    failing_frame(14)  # in the fourth look: each has four frames, and the first two are of the warm-up
    with pytest.raises(DrawingError):
        compare(**settings, out=tmp_path / "broken")
    assert len((tmp_path / "broken" / "records.jsonl").read_text().splitlines()) == 1 + 1
    compare(**settings, out=tmp_path / "broken")
    compare(**settings, out=tmp_path / "whole")
    broken, whole = (_without_times(tmp_path / name / "results.csv") for name in ("broken", "whole"))
    assert broken == whole
    assert len(whole) == 1 + 4


@pytest.mark.slow
def test_results_do_not_depend_on_the_pictures_of_the_report(failing_frame, no_source_changes, tmp_path):
    failing_frame(1)
    compare(methods=["closed-form"], goals=2, seed=1, out=tmp_path)
    assert (tmp_path / "results.json").exists()
    assert "cannot draw frame 1" in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert not (tmp_path / "scene.png").exists()


@pytest.fixture
def no_source_changes(monkeypatch):
    """The same code, even if somebody edits a module in between."""
    monkeypatch.setattr("kinreach._provenance.source_digest", lambda: "0" * 12)


def _without_times(path):
    header, *rows = (line.split(",") for line in path.read_text(encoding="utf-8").splitlines())
    kept = [index for index, name in enumerate(header) if name not in ("solve_s", "accept_s", "look_s")]
    return [[row[index] for index in kept] for row in [header, *rows]]


FORKED = """
import gymnasium as gym
import kinreach
from kinreach.errors import DrawingError
from kinreach.sim import ArmSimulation, render

options = {"observation": "camera", "backend": "kinematic", "width": 64, "height": 48}
if __name__ == "__main__":
    render(ArmSimulation("ur5-thesis"), width=64, height=48)
    for context in ("fork", "spawn"):
        env = gym.make_vec(
            "kinreach:kinreach/UR5SingleStep-v0", num_envs=2, vectorization_mode="async",
            vector_kwargs={"context": context}, **options,
        )
        try:
            print(context, env.reset(seed=0)[0].shape)
        except DrawingError as error:
            print(context, str(error)[:40])
        finally:
            env.close(terminate=True)
"""


@pytest.mark.slow
def test_a_child_that_was_forked_after_drawing_says_so_and_does_not_hang(run_python, tmp_path, needs_gl):
    (tmp_path / "forked.py").write_text(FORKED, encoding="utf-8")
    done = run_python("forked.py")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["fork this process was forked from one that ha", "spawn (2, 13)"]
