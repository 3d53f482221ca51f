"""What other people's programs do with the environments: ids, worker processes, films."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import RecordVideo

import kinreach  # noqa: F401 (registers the environments)
from kinreach._registration import BUTTON, MULTI, MULTI_KINEMATIC, SINGLE, SINGLE_KINEMATIC, SPACE
from kinreach.envs import RecordMotion
from kinreach.errors import InputError, UnknownOptionError
from kinreach.sim.inside import FrameRenderer
from tests.cases import stand_in

PAIRS = {SINGLE_KINEMATIC: SINGLE, MULTI_KINEMATIC: MULTI}


@pytest.mark.parametrize(("name", "plain"), PAIRS.items())
def test_ids_of_the_kinematic_backend(name, plain):
    for make in (gym.make, lambda id, **options: gym.make_vec(id, num_envs=2, **options)):
        one, other = make(name), make(plain, backend="kinematic")
        np.testing.assert_array_equal(one.reset(seed=1)[0], other.reset(seed=1)[0])
        action = one.action_space.sample()
        np.testing.assert_array_equal(one.step(action)[0], other.step(action)[0])
    assert gym.make(name).unwrapped.options.backend == "kinematic"


@pytest.mark.slow
def test_gymnasium_imports_kinreach_by_the_id(run_python):
    text = "import gymnasium as gym; print(gym.make('kinreach:kinreach/UR5SingleStep-v0').reset(seed=0)[0].shape)"
    done = run_python("-c", text)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "(13,)"


@pytest.mark.slow
def test_worker_processes_of_stable_baselines3(run_python, tmp_path):
    """Spawned workers have imported nothing: the id has to say where it is registered."""
    pytest.importorskip("stable_baselines3")
    text = """
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import SubprocVecEnv

if __name__ == "__main__":
    env = make_vec_env("kinreach:kinreach/UR5SingleStepKinematic-v0", 2, seed=0, vec_env_cls=SubprocVecEnv,
                       vec_env_kwargs={"start_method": "spawn"})
    print(env.reset().shape)
    env.close()
"""
    (tmp_path / "workers.py").write_text(text, encoding="utf-8")
    done = run_python("workers.py")
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "(2, 13)"


@pytest.mark.parametrize("name", [SINGLE, MULTI])
def test_info_is_flat_numbers_beside_texts_and_the_terms(name):
    """So that clients that take only numbers can leave the rest by its type."""
    env = gym.make(name, backend="kinematic")
    env.reset(seed=0)
    for _ in range(5):
        info = env.step(env.action_space.sample())[4]
        rest = {key for key, value in info.items() if not isinstance(value, int | float | bool | np.ndarray)}
        assert rest == {"reward_terms", "status", "impossible_reason"}
        assert all(value.dtype.kind in "fb" for value in info.values() if isinstance(value, np.ndarray))
        assert bool(info["impossible_reason"]) == (info["impossible_code"] > 0) == info["impossible"]
        env.reset()


@pytest.mark.parametrize(
    ("name", "options"),
    [
        (SINGLE_KINEMATIC, {}),
        (MULTI_KINEMATIC, {}),
        (BUTTON, {"info": "numbers"}),
        (SINGLE, {"info": "numbers"}),
        (SPACE, {"info": "numbers"}),
    ],
)
def test_info_of_numbers_only(name, options):
    """TorchRL stacks every entry: texts and dictionaries it cannot."""
    env, native = gym.make(name, **options), gym.make_vec(name, num_envs=2, **options)
    full = gym.make(PAIRS.get(name, name), **({"backend": "kinematic"} if name in PAIRS else {}))
    seen = 0
    for each in (env, native):
        infos = [each.reset(seed=0)[1], each.step(each.action_space.sample())[4]]
        assert infos[0].keys() <= infos[1].keys()
        infos += [infos[1]["final_info"]] if "final_info" in infos[1] else []
        for info in infos:
            numbers = {key: value for key, value in info.items() if key not in ("final_info", "_final_info")}
            assert all(np.asarray(value).dtype.kind in "biuf" for value in numbers.values())
            seen += len(numbers)
    full.reset(seed=0)
    said = full.step(full.action_space.sample())[4]
    env.reset(seed=0)
    assert set(said) - set(env.step(env.action_space.sample())[4]) == {
        key for key, value in said.items() if isinstance(value, str | dict)
    }
    assert seen > 40


@pytest.mark.parametrize("name", [SINGLE, MULTI_KINEMATIC, BUTTON])
def test_an_unknown_keyword_is_what_python_raises(name):
    """TorchRL tries `frameskip=`, and does without where it reads Python's words."""
    for make in (gym.make, lambda id, **options: gym.make_vec(id, num_envs=2, **options)):
        with pytest.raises(TypeError, match="unexpected keyword argument 'frameskip'") as refused:
            make(name, frameskip=1)
        assert isinstance(refused.value, UnknownOptionError)


class Clock:
    """A renderer without graphics: every pixel is the time of the simulation [0.01 s]."""

    def __init__(self, model, *, width, height, shadows):
        self.shape = (height, width, 3)

    def rgb(self, data, camera):
        return np.full(self.shape, round(100 * data.time), np.uint8)

    def close(self):
        pass


def test_a_film_of_a_single_step_shows_the_motion(films, tmp_path, monkeypatch):
    stand_in(monkeypatch, FrameRenderer, Clock)
    for record, mode in ((RecordVideo, "rgb_array"), (RecordMotion, "rgb_array_list")):
        env = record(gym.make(SINGLE, arm="arm3", render_mode=mode), str(tmp_path / mode), name_prefix="one")
        env.reset(seed=0)
        unwrapped = env.unwrapped
        *_, info = env.step(unwrapped.action_for(unwrapped.home + 0.3))
        env.reset()
        env.close()
    ends = [0, round(100 * info["move_s"]) % 256]
    env = gym.make(SINGLE, arm="arm3", render_mode="rgb_array_list").unwrapped
    counts = []
    for _ in range(2):
        env.reset(seed=0)
        env.render()
        env.step(env.action_for(env.home + 0.3))
        counts.append(len(env.render()))
    assert counts[0] == counts[1] > 10  # each motion from its beginning
    two, _, times, _ = ([int(frame[0, 0, 0]) for frame in film] for film in films)
    assert two == ends
    assert times[0] == ends[0]
    assert times[-1] == ends[1]
    assert set(np.diff(times)[1:-1]) <= {4, 5}  # 25 frames a second
    assert len(times) == pytest.approx(25 * info["move_s"], abs=3)


def test_frames_of_the_motion_need_a_list_of_them(tmp_path):
    with pytest.raises(InputError, match="rgb_array_list"):
        RecordMotion(gym.make(SINGLE), str(tmp_path))
