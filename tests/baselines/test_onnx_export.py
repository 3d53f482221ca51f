"""A policy as an ONNX model answers as it does in NumPy, and carries its card."""

import json
from dataclasses import replace

import numpy as np
import pytest

from kinreach.baselines import load_policy
from kinreach.baselines._batch import make_batch
from kinreach.baselines._eyes import Eye
from kinreach.baselines._onnx_export import export_onnx
from kinreach.baselines._policy_file import ACTIVATIONS, Network
from kinreach.baselines.inside import LearnedPolicy, pretrained_names
from kinreach.cli import main
from kinreach.envs import moving
from kinreach.errors import InputError
from tests.baselines.test_steering import episodes, steering_policy

REASON = "needs onnx and onnxruntime"
onnx = pytest.importorskip("onnx", reason=REASON)
onnxruntime = pytest.importorskip("onnxruntime", reason=REASON)

OBSERVATIONS = 1000


def answers(path, observations):
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    said = observations if isinstance(observations, dict) else {"observation": observations}
    return session.run(["action"], {part.name: said[part.name] for part in session.get_inputs()})[0]


def assert_equal(policy, path, observations, count=OBSERVATIONS):
    expected, found = policy.act(observations), answers(path, observations)
    assert found.shape == expected.shape == (count, *expected.shape[1:])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)
    assert len(np.unique(found)) > 3
    first = {name: seen[:1] for name, seen in observations.items()} if policy.network.eyes else observations[:1]
    np.testing.assert_allclose(answers(path, first), expected[:1], rtol=0, atol=1e-6)


@pytest.mark.parametrize("name", [name for name in pretrained_names() if not load_policy(name).network.eyes])
def test_policies_of_the_package(name, tmp_path):
    policy = load_policy(name)
    env = make_batch(policy.card.environment, 1, policy.needed_options)
    space = env.single_observation_space
    env.close()
    draws = np.random.default_rng(0).normal(size=(OBSERVATIONS, *space.shape))
    observations = np.clip(draws, space.low, space.high)
    export_onnx(policy, tmp_path / "policy.onnx", observations=space.shape[0])
    assert_equal(policy, tmp_path / "policy.onnx", observations)


def test_a_model_of_single_precision(tmp_path):
    """As stable-baselines3 saves it in `model.zip`."""
    policy = load_policy("ppo-single")
    layers = [tuple(part.astype(np.float32) for part in layer) for layer in policy.network.layers]
    single = LearnedPolicy(policy.card, replace(policy.network, layers=layers))
    export_onnx(single, tmp_path / "policy.onnx")
    assert_equal(single, tmp_path / "policy.onnx", np.random.default_rng(1).normal(size=(OBSERVATIONS, single.inputs)))


@pytest.mark.parametrize("walks", [False, True])
@pytest.mark.slow
def test_a_policy_that_sees_pictures(walks, tmp_path):
    policy = load_policy("pixels-single")
    if walks:
        policy = LearnedPolicy(replace(policy.card, environment="kinreach/UR5MultiStep-v0"), policy.network)
    export_onnx(policy, tmp_path / "policy.onnx")
    rng = np.random.default_rng(0)
    for count, size in ((40, (72, 128)), (40, (15, 22)), (3, (1, 1))):
        seen = {
            name: rng.integers(0, 256, size=(count, *size, 3), dtype=np.uint8) for name in ("front_rgb", "wrist_rgb")
        }
        seen["joints"] = rng.uniform(-3.0, 3.0, size=(count, 6))
        assert_equal(policy, tmp_path / "policy.onnx", seen, count)


@pytest.mark.parametrize("walks", [False, True])
def test_a_policy_that_sees_small_pictures(walks, tmp_path):
    """With convolutions of other sizes and strides than those of the package."""
    policy, rng = load_policy("pixels-single"), np.random.default_rng(walks)
    channels = policy.network.eyes[0].places // 2
    eyes = []
    for shapes, strides in ([(4, 3, 5, 5), (channels, 4, 3, 3)], [2, 1]), ([(channels, 3, 3, 3)], [3]):
        layers = [
            (rng.normal(size=shape) / np.sqrt(shape[1]) / shape[2], rng.normal(size=shape[0])) for shape in shapes
        ]
        eyes.append(Eye(layers, strides, 2000.0 if eyes else 2.0))
    card = replace(policy.card, environment="kinreach/UR5MultiStep-v0") if walks else policy.card
    policy = LearnedPolicy(card, replace(policy.network, eyes=eyes))
    export_onnx(policy, tmp_path / "policy.onnx")
    for count, size in ((6, (9, 14)), (3, (1, 1))):
        seen = {
            name: rng.integers(0, 256, size=(count, *size, 3), dtype=np.uint8) for name in ("front_rgb", "wrist_rgb")
        }
        seen["joints"] = rng.uniform(-3.0, 3.0, size=(count, 6))
        assert_equal(policy, tmp_path / "policy.onnx", seen, count)


def test_a_policy_that_walks_with_an_arm_of_other_limits(tmp_path):
    trained = load_policy("panda-single")
    policy = LearnedPolicy(replace(trained.card, environment="kinreach/UR5MultiStep-v0"), trained.network)
    export_onnx(policy, tmp_path / "policy.onnx", observations=11)
    assert_equal(policy, tmp_path / "policy.onnx", np.random.default_rng(0).uniform(-1.0, 1.0, (OBSERVATIONS, 11)))


@pytest.mark.parametrize("activation", ACTIVATIONS)
@pytest.mark.parametrize("output", ["linear", "tanh"])
def test_every_activation_with_bounds_and_more_observations_than_are_used(activation, output, tmp_path):
    rng = np.random.default_rng(1)
    layers = [(rng.normal(size=(8, 15)), rng.normal(size=8)), (rng.normal(size=(2, 8)), rng.normal(size=2))]
    network = Network(
        mean=rng.normal(size=4),
        scale=rng.uniform(0.5, 2.0, size=4),
        waves=np.array([1.5]),
        layers=layers,
        activation=activation,
        output=output,
        gain=np.array([3.0, 0.5]),
        shift=np.array([0.1, -0.2]),
        low=np.array([-2.0, -0.25]),
        high=np.array([1.0, 0.25]),
        differences=rng.normal(0.0, 2.0, (3, 4)),
    )
    card = replace(load_policy("ranked-single").card, environment="own/Task-v0", meaning="action")
    policy = LearnedPolicy(card, network)
    export_onnx(policy, tmp_path / "policy.onnx", observations=6)
    assert_equal(policy, tmp_path / "policy.onnx", rng.normal(size=(OBSERVATIONS, 6)))
    with pytest.raises(InputError, match="does not take observations of 3 numbers"):
        export_onnx(policy, tmp_path / "policy.onnx", observations=3)


def test_the_command_writes_a_model_with_its_card(tmp_path, capsys):
    path = tmp_path / "new" / "policy.onnx"
    command = ["evaluate", "ranked-single", "--goals", "3", "--backend", "kinematic", "--export", str(path)]
    assert main(command) == 0
    assert f"\nONNX model: {path}\n" in capsys.readouterr().out
    model = onnx.load(path)
    (entry,) = [entry for entry in model.metadata_props if entry.key == "kinreach"]
    card = json.loads(entry.value)
    assert (card["environment"], card["meaning"]) == ("kinreach/UR5SingleStep-v0", "posture")
    assert card["results"]["kinreach evaluate ranked-single --goals 3 --backend kinematic"]["goals"] == 3
    assert model.graph.input[0].type.tensor_type.shape.dim[1].dim_value == 13
    assert main(["evaluate", "ranked-single", "ranked-multi", "--goals", "1", "--export", str(path)]) == 2
    assert "--export is for one policy, got 2" in capsys.readouterr().err


def test_a_policy_that_steers(tmp_path):
    """At rest and turning; targets are at their bounds, and between them."""
    policy, world, rng = steering_policy(), episodes(20), np.random.default_rng(2)
    seen = np.empty((OBSERVATIONS, policy.inputs))
    for rows in seen.reshape(-1, 20, policy.inputs):
        rows[:] = world.observe()
        world.step(rng.uniform(-1.0, 1.0, (20, 6)))
    assert np.abs(seen[:, moving.RATES]).max() > 2.0
    ends = np.isin(np.pi * policy.act(seen), policy.network.steering.high)
    assert 0.01 < ends.mean() < 0.9
    export_onnx(policy, tmp_path / "policy.onnx")
    assert_equal(policy, tmp_path / "policy.onnx", seen)


def inputs(name, path):
    """How many inputs the model has that the command writes."""
    assert main(["evaluate", name, "--goals", "1", "--export", str(path)]) == 0
    return len(onnx.load(path).graph.input)


def test_the_command_knows_what_a_policy_observes(tmp_path):
    assert inputs("gradient-moving", tmp_path / "policy.onnx") == 1


@pytest.mark.slow
def test_the_command_knows_what_a_policy_sees(tmp_path, needs_gl):
    assert inputs("pixels-single", tmp_path / "policy.onnx") == 2


def test_without_the_package_one_line_says_what_to_install(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "onnx", None)
    assert main(["evaluate", "ranked-single", "--goals", "1", "--export", str(tmp_path / "policy.onnx")]) == 2
    errors = capsys.readouterr().err
    assert "pip install 'kinreach[onnx]'" in errors
    assert errors.count("\n") == 1
