"""Methods of every task as Minari datasets, which their environments play again."""

import json

import numpy as np
import pytest

from kinreach.cli import main
from kinreach.compare import demonstrate
from kinreach.compare._task import _OWN
from kinreach.errors import InputError, MethodError, UnknownNameError

#: The scripted or planned method of every task, how many episodes, and options.
METHODS = {
    "ur5": ("closed-form", 3, {"backend": "kinematic"}),
    "space": ("closed-form", 3, {"backend": "kinematic"}),
    "arm3": ("closed-form", 3, {"backend": "kinematic"}),
    "button": ("analytic", 1, {}),
    "real-arm": ("identified", 1, {}),
    "moving": ("interception", 2, {"sights": 2}),
    "obstacles": ("path", 2, {"clutter": (0, 4)}),
    "lift": ("closed-form", 1, {"backend": "kinematic"}),
    "push": ("script", 1, {}),
    "pick-and-place": ("script", 1, {}),
}


@pytest.fixture
def minari(tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "datasets"))
    pytest.importorskip("h5py", reason="needs minari and h5py")
    return pytest.importorskip("minari", reason="needs minari and h5py")


def test_every_task_of_the_package_has_one():
    assert set(METHODS) == set(_OWN)


@pytest.mark.parametrize("task", METHODS)
def test_the_environment_plays_the_dataset_again(task, minari):
    method, episodes, options = METHODS[task]
    trials = demonstrate(task, method, f"tests/{task}-v0", episodes=episodes, options=options)
    dataset = minari.load_dataset(f"tests/{task}-v0")
    env, played = dataset.recover_environment(), 0
    assert dataset.total_episodes == episodes
    for trial, episode in zip(trials, dataset.iterate_episodes(), strict=True):
        assert (len(episode), episode.rewards.sum()) == (trial["steps"], pytest.approx(trial["return"]))
        (start,) = dataset.storage.get_episode_metadata([episode.id])
        observation, info = env.reset(seed=start["seed"], options=start.get("options"))
        rows = [(observation, info)]
        for action, reward in zip(episode.actions, episode.rewards, strict=True):
            observation, gained, *_, info = env.step(action)
            rows.append((observation, info))
            assert gained == reward
        for index, (observation, info) in enumerate(rows):
            # between actions the methods of the real arm look, with noise that is not drawn without them
            np.testing.assert_allclose(observation, episode.observations[index], atol=2e-3 * (task == "real-arm"))
            assert set(info) == set(episode.infos)
            for name in ("q", "goal", "is_success", *(name for name in ("tip", "distance") if name in info)):
                np.testing.assert_array_equal(info[name], episode.infos[name][index])
        assert bool(episode.infos["is_success"][-1]) == trial["reached"]
        played += 1
    assert played == episodes
    about = json.loads(dataset.storage.metadata["description"])
    assert (about["task"], about["methods"], about["goals"]) == (task, [method], episodes)


class EverySecond:
    """Finds an action in every second episode."""

    episodes = 0

    def reset(self, observation, info):
        self.episodes += 1

    def act(self, observation):
        return np.zeros(6) if self.episodes % 2 else None


def test_episodes_without_an_action_are_left_out(minari):
    trials = demonstrate("ur5", EverySecond, "tests/some-v0", episodes=6, options={"backend": "kinematic"})
    dataset = minari.load_dataset("tests/some-v0")
    assert (len(trials), dataset.total_episodes) == (6, 3)
    found = [float(episode.infos["distance"][-1]) for episode in dataset.iterate_episodes()]
    assert found == [trial["distance"] for trial in trials[::2]]


class Nothing:
    """Finds no action."""

    def reset(self, observation, info): ...

    def act(self, observation):
        return None


def test_what_cannot_be_recorded_is_refused(minari):
    kinematic = {"options": {"backend": "kinematic"}, "episodes": 1}
    with pytest.raises(InputError, match="none of 1 episodes can be recorded"):
        demonstrate("ur5", Nothing, "tests/none-v0", **kinematic)
    with pytest.raises(UnknownNameError, match="ur5 method"):
        demonstrate("ur5", "script", "tests/none-v0", **kinematic)
    with pytest.raises(InputError, match="such as tests/none-v0"):
        demonstrate("ur5", "closed-form", "tests/none", **kinematic)
    with pytest.raises(MethodError, match="method 'broken' failed: ZeroDivisionError"):
        demonstrate("ur5", broken, "tests/none-v0", **kinematic)
    options = {"backend": "kinematic", "reward": broken}
    with pytest.raises(InputError, match="must be JSON types"):
        demonstrate("ur5", "closed-form", "tests/none-v0", episodes=1, options=options)
    assert not minari.list_local_datasets()


def broken(*arguments):
    return 1 / 0


def test_the_command_records_what_it_says(minari, capsys):
    words = ["demonstrate", "--task", "ur5", "--method", "closed-form", "--episodes", "2", "--backend", "kinematic"]
    assert main([*words, "--minari", "tests/one-v0"]) == 0
    first, again, last = capsys.readouterr().out.splitlines()
    assert (first, last) == ("closed-form: 2 of 2 goals reached", "Dataset: tests/one-v0")
    assert again == f"Again: kinreach {' '.join(words[:7])} --seed 0 --backend kinematic --minari tests/one-v0"
    assert main([*words, "--minari", "tests/one-v0"]) == 2
    assert "there is a dataset tests/one-v0 already" in capsys.readouterr().err
