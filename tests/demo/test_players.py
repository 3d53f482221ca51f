"""Every environment that is registered, with everybody who is offered for it."""

import gymnasium as gym
import pytest

import kinreach  # noqa: F401
from kinreach._registration import BUTTON, MOVING, REAL_ARM, SINGLE, SINGLE_KINEMATIC, TRAINING_ENVIRONMENTS
from kinreach.compare import get_task
from kinreach.compare._task import task_names
from kinreach.demo.inside import new_player, playable, playable_names
from kinreach.errors import InputError
from kinreach.kinematics.inside import SOLVERS
from kinreach.robots import get_arm
from kinreach.view._episodes import EpisodeRequest

#: Beside the page's own: these episodes are watched by nobody.
SHORT = {REAL_ARM: {"balls": 1, "budgets": (0, 5), "again": 0}, MOVING: {"speeds": (0.6,)}}


def test_all_that_is_registered_can_be_played():
    registered = {name for name, spec in gym.registry.items() if name.startswith("kinreach/") and spec.entry_point}
    assert set(playable_names()) == registered - set(TRAINING_ENVIRONMENTS)
    assert len(registered) >= 8


@pytest.mark.slow
def test_all_methods_of_comparisons_are_offered():
    """By their own names, or by those of the policies that they are."""
    offered, ur5 = 0, get_arm("ur5-thesis")
    for name in task_names():
        task = get_task(name)
        for key, method in task.methods.items():
            if task.arm in ("", "ur5-thesis"):
                players = playable(method.environment or task.environment).players(ur5)
                shipped = [version.removeprefix("policy ") for version in method.versions]
                assert {key, *shipped} & set(players), (name, key, players)
                offered += 1
    assert offered >= 25


@pytest.mark.slow
@pytest.mark.parametrize("name", playable_names())
def test_everybody_who_is_offered_plays(name):
    players = playable(name).players(get_arm("ur5-thesis"))
    assert len(players) == len(set(players)) >= 2
    assert players[-1] == "random"
    for player in players:
        episode = EpisodeRequest(name, player, get_arm("ur5-thesis"), seed=2, options=SHORT.get(name, {})).play(
            simple=True
        )
        assert len(episode.frames) >= 2, player
        assert episode.verdict.startswith(("Reached", "Not reached")), player
        assert len(episode.steps) == episode.trial["steps"], player
    assert set(players) >= set(SOLVERS) or not playable(name).solvable


@pytest.mark.parametrize("arm", ["panda", "arm3"])
@pytest.mark.slow
def test_everybody_who_is_offered_for_another_arm_plays(arm):
    players = playable(SINGLE).players(get_arm(arm))
    assert ("closed-form" in players, "hybrid" in players) == (True, False)
    for player in players:
        assert EpisodeRequest(SINGLE, player, get_arm(arm), options={"backend": "kinematic"}).play(simple=True).steps, (
            player
        )


@pytest.mark.slow
@pytest.mark.parametrize("observation", ["camera", "pixels"])
def test_everybody_plays_by_pictures(observation, needs_gl):
    known, ur5 = playable(SINGLE), get_arm("ur5-thesis")
    players = known.players(ur5, observation=observation)
    assert ("pixels-single" in players, "ranked-single" in players) == (
        observation == "pixels",
        observation == "camera",
    )
    reached = 0
    for player in players:
        asked = EpisodeRequest(SINGLE, player, ur5, options={"observation": observation, "backend": "kinematic"})
        reached += asked.play(simple=True).trial["reached"]
    assert reached >= len(players) - 3


def test_a_player_of_ones_own():
    env = gym.make(SINGLE, backend="kinematic")
    assert new_player("kinreach.kinematics._solvers:ClosedFormSolver", env).reset
    for name, said in (("nobody:Nothing", "cannot import"), ("wisdom", "unknown policy for"), ("button", "unknown")):
        with pytest.raises(InputError, match=said) as refused:
            new_player(name, env)
        names = str(refused.value).partition("available: ")[2].partition(";")[0].split(", ")
        assert len(names) == len(set(names))
    with pytest.raises(InputError, match="there is no environment 'kinreach/Nothing-v0'"):
        playable("kinreach/Nothing-v0")
    with pytest.raises(InputError, match="cannot import the environment nothing:a/B-v0"):
        playable("nothing:a/B-v0")
    assert playable(f"kinreach:{BUTTON}").name == BUTTON
    assert "backend" not in playable(SINGLE_KINEMATIC).choices
