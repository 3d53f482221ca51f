"""Lifting in the comparison: scripted grasps, and what failed where."""

from importlib import resources

import gymnasium as gym
import mujoco
import numpy as np
import pytest

from kinreach.compare import compare, get_task

GEOMS = mujoco.mjtGeom
SHAPES = {"ball": GEOMS.mjGEOM_SPHERE, "cube": GEOMS.mjGEOM_BOX, "cylinder": GEOMS.mjGEOM_CYLINDER}


class Aside:
    """The closed form, too far to the left, or with fingers that do not close, by turns."""

    def __init__(self, env):
        self._scripted = get_task("lift").methods["closed-form"].make(env)

    def reset(self, observation, info):
        self._turn = int(1e6 * info["goal"][0]) % 3

    def act(self, observation):
        action = self._scripted.act(observation)
        action[0] += 0.06 * (self._turn == 0)
        action[6] = np.where(self._turn == 1, 0.5, action[6])
        return None if self._turn == 2 else action


@pytest.mark.usefixtures("needs_placo")
@pytest.mark.slow
def test_failures_add_up():
    own = get_task("lift").methods
    methods = {"closed-form": own["closed-form"], "placo": own["placo"], "aside": Aside}
    found = compare("lift", methods, goals=8, options={"attempts": 1})
    entries = {entry["name"]: entry for entry in found["methods"]}
    for entry in entries.values():
        assert sum(entry["failed"].values()) + entry["reached"] == pytest.approx(1.0)
        assert set(entry["failed"]) == {"seen", "reached", "closed", "slipped", "dropped"}
    assert [entries[name]["reached"] for name in entries] == [1.0, 1.0, 0.0]
    failed = entries["aside"]["failed"]
    assert failed["reached"] > 0
    assert failed["closed"] > 0
    assert entries["aside"]["outcomes"].get("forfeited", 0) > 0


@pytest.mark.usefixtures("needs_placo")
@pytest.mark.slow
def test_another_arm_and_another_object():
    found = compare("lift", goals=3, arm="ur5e", options={"shapes": ("cube",), "sizes": (0.03,)})
    assert [entry["reached"] for entry in found["methods"]] == [1.0, 1.0]
    assert found["settings"]["arm"] == "ur5e"
    assert "lifts" in found["settings"]["title"]


@pytest.mark.slow
def test_a_policy_of_small_steps_acts_in_small_steps():
    """In the same table as grasps in one decision, under its name and as a file, for the same objects."""
    file = str(resources.files("kinreach.baselines") / "pretrained" / "ppo-lift-multi.safetensors")
    found = compare("lift", ["ranked-lift", "ppo-lift-multi", file], goals=2, options={"attempts": 1})
    one, steps, same = found["methods"]
    assert one["attempts"] == 1.0
    assert 20 < steps["attempts"] < 150
    assert steps["attempts"] == same["attempts"]
    assert [entry["reached"] for entry in found["methods"]] == [1.0, 1.0, 1.0]


def test_the_picture_of_a_trial_has_the_object_where_it_ended():
    """Lifted, and after fingers that did not close; of every shape."""
    task = get_task("lift")
    for (shape, kind), closes in zip(SHAPES.items(), (True, True, False), strict=True):
        env = gym.make(task.environment, dtype="float64", shapes=(shape,), sizes=(0.03,), attempts=1)
        script = task.methods["closed-form"].make(env)
        observation, _ = env.reset(seed=0)
        action = script.act(observation)
        *_, info = env.step(action if closes else np.append(action[:-1], 1.0))
        assert info["is_success"] == closes
        np.testing.assert_allclose(env.unwrapped.data.joint("object").qpos[:3], info["position"])
        scene = task.scene(env, {name: np.array(value).tolist() for name, value in info.items()})
        mujoco.mj_forward(scene.model, scene.data)
        np.testing.assert_allclose(scene.data.body("object").xpos, info["position"], atol=1e-9)
        np.testing.assert_allclose(scene.data.body("object").xmat, np.ravel(info["rotation"]), atol=1e-9)
        np.testing.assert_allclose(scene.q, info["q"])
        geom, ball = scene.model.geom("object"), scene.model.geom("ball")
        assert (geom.type[0], geom.size[0]) == (kind, pytest.approx(0.03))
        assert ball.group[0] == 3  # hidden


def test_the_picture_of_causes_adds_up_to_all_objects():
    """Beside each method's name its bars: the share that it lifts, then the causes one after the other."""
    rng, bars = np.random.default_rng(0), 0
    settings = {"goals": 40, "seed": 0, "command": "again", "options": {}}
    for count in (1, 3):
        shares = rng.dirichlet(np.ones(6), count)
        methods = [
            {"name": f"m{i}", "colour": "#0072B2", "reached": share[0],
             "failed": dict(zip(("seen", "reached", "closed", "slipped", "dropped"), share[1:], strict=True))}
            for i, share in enumerate(shares)
        ]  # fmt: skip
        figure = get_task("lift").figures["causes"]([], {"methods": methods, "settings": settings})
        (axes,) = figure.axes
        assert [label.get_text() for label in axes.get_yticklabels()] == [f"m{i}" for i in range(count)]
        for i, share in enumerate(shares):
            own = sorted((bar for bar in axes.patches if round(bar.get_y() + bar.get_height() / 2) == i), key=start)
            assert [bar.get_width() for bar in own] == pytest.approx(100 * share)
            assert [start(bar) for bar in own] == pytest.approx(100 * (share.cumsum() - share))
            assert {round(bar.get_height(), 6) for bar in own} == {0.6}
            assert own[0].get_facecolor() != own[1].get_facecolor()
            bars += len(own)
        low, high = sorted(axes.get_ylim())
        assert all(low < bar.get_y() < bar.get_y() + bar.get_height() < high for bar in axes.patches)
    assert bars == 24


def start(bar):
    return bar.get_x()
