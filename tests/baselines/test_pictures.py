"""Policies that see pictures: their eyes in numpy and in torch, what they learn from, and the files they come in."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from safetensors import safe_open
from safetensors.numpy import load_file, save_file

pytest.importorskip("stable_baselines3")

import torch

from kinreach._registration import SINGLE
from kinreach.baselines import VALIDATION, evaluate, get_recipe, load_policy, train
from kinreach.baselines._batch import make_batch
from kinreach.baselines._eyes import MIDDLE
from kinreach.baselines._looks import Looks
from kinreach.baselines._models import build
from kinreach.baselines._networks import TorchEye
from kinreach.baselines._policy_file import read_policy, save_policy
from kinreach.envs._reach.reach_task import SINGLE_STEP, ReachOptions, ReachTask
from kinreach.errors import InputError

SIZE = {"width": 48, "height": 32}
PIXELS = {"backend": "kinematic", "observation": "pixels", **SIZE}


def small(**changes):
    recipe = get_recipe("pixels-single")
    settings = {**recipe.settings, "looks": 8, "tries": 4}
    options = {"backend": "kinematic", **SIZE}
    return replace(recipe, num_envs=16, steps=96, segments=3, window=16, settings=settings, options=options, **changes)


@pytest.fixture(scope="module")
def run(tmp_path_factory, needs_gl):
    return train(small(), tmp_path_factory.mktemp("pictures"), seed=3)


@pytest.mark.parametrize("shape", [(72, 128), (31, 48), (5, 6)])
def test_eyes_answer_as_torchs(shape):
    compared = 0
    for seed in range(5):
        torch.manual_seed(seed)
        eye = TorchEye()
        with torch.no_grad():
            eye.sharpness.fill_(10.0)
        pictures = np.random.default_rng(seed).integers(0, 256, (20, *shape, 3), dtype=np.uint8)
        theirs = eye(torch.from_numpy(pictures).movedim(-1, -3)).detach().numpy()
        ours = eye.exported()(pictures)
        np.testing.assert_allclose(ours, theirs, atol=2e-5)
        np.testing.assert_array_equal(eye.exported()(pictures[None, 7])[0], eye.exported()(pictures[7]))
        assert ours.std() > 0.01
        compared += ours.size
    assert compared == 5 * 20 * 32


def test_an_eye_goes_on_from_the_weights_of_an_exported_one():
    pictures = np.random.default_rng(0).integers(0, 256, (4, 31, 48, 3), dtype=np.uint8)
    torch.manual_seed(1)
    eye, other = TorchEye(), TorchEye()
    with torch.no_grad():
        eye.sharpness.fill_(7.0)
    ours = eye.exported()
    assert np.abs(ours(pictures) - other.exported()(pictures)).max() > 0.01
    other.take(ours)
    np.testing.assert_array_equal(other.exported()(pictures), ours(pictures))
    for one, same in zip(eye.parameters(), other.parameters(), strict=True):
        assert torch.equal(one, same)
        assert same.requires_grad
    with torch.no_grad():
        other.layers[0].weight.zero_()
    assert ours.layers[0][0].any()  # a copy
    with pytest.raises(ValueError, match="zip"):
        other.take(replace(ours, layers=ours.layers[:2]))


def test_eyes_find_where_something_is():
    """A kernel for red: the place is that of the only red pixel."""
    eye = TorchEye()
    with torch.no_grad():
        for layer in eye.layers:
            layer.weight.zero_()
            layer.bias.zero_()
            middle = layer.weight.shape[-1] // 2
            layer.weight[0, 0, middle, middle] = 100.0
        eye.sharpness.fill_(1e3)
    for row, column in [(0, 0), (8, 12), (28, 44), (16, 20)]:
        picture = np.zeros((32, 48, 3), dtype=np.uint8)
        picture[row, column] = (255, 0, 0)
        across, down = eye.exported()(picture)[:2]
        assert across == pytest.approx(2 * (column / 4) / 11 - 1)
        assert down == pytest.approx(2 * (row / 4) / 7 - 1)


def test_observations_of_a_training_are_the_numbers_of_its_looks(needs_gl):
    trainee = build(small(), 0, steps=96)
    space, seen = trainee.env.observation_space, np.concatenate([trainee.env.reset() for _ in range(20)])
    trainee.env.close()
    assert {*seen[:, 0]} == {*range(8)}
    assert (space.low, space.high) == (0.0, 7.0)


@pytest.mark.slow
def test_looks_are_what_the_environment_shows(needs_gl):
    task = ReachTask(ReachOptions(backend="kinematic", **SIZE), SINGLE_STEP)
    goals = task.training_starts(np.random.default_rng(0), 5, beyond=0.0)["goal"]
    looks = Looks(task, len(goals))
    looks.take(goals, np.random.default_rng(0))
    env = gym.make(SINGLE, **PIXELS)
    for number, goal in enumerate(goals):
        seen, _ = env.reset(seed=0, options={"goal": goal})
        for name, picture in looks.seen(np.array([number])).items():
            np.testing.assert_array_equal(picture[0], seen[name])
    env.close()
    assert len(np.unique(looks.pictures.reshape(5, -1), axis=0)) == 5


@pytest.mark.slow
def test_the_file_acts_as_the_model_that_was_trained(run, tmp_path):
    """In the environment itself, alone and in a batch; with a torch forward of the file's own tensors beside it."""
    batch = make_batch(SINGLE, 6, PIXELS)
    seen, _ = batch.reset(seed=0)
    actions = load_policy(run.folder / "policy.safetensors").act(seen)
    assert actions.shape == (6, 6)
    tensors = {name: torch.from_numpy(value) for name, value in load_file(run.folder / "policy.safetensors").items()}
    places = []
    for number, name in enumerate(("front", "wrist")):
        eye = TorchEye()
        eye.load_state_dict(
            {
                key.removeprefix(f"eye{number}.").replace("layer", "layers."): value
                for key, value in tensors.items()
                if key.startswith(f"eye{number}.") and not key.endswith("strides")
            }
        )
        places.append(eye(torch.from_numpy(seen[f"{name}_rgb"]).movedim(-1, -3)))
    h = torch.cat(places, dim=1)
    for index in range(2):
        h = torch.nn.functional.silu(h @ tensors[f"layer{index}.weight"].T + tensors[f"layer{index}.bias"])
    out = tensors["shift"] + tensors["gain"] * (h @ tensors["layer2.weight"].T + tensors["layer2.bias"])
    np.testing.assert_allclose(actions, out.detach().clamp(-1, 1).numpy(), atol=1e-4)
    one = {name: values[2] for name, values in seen.items()}
    np.testing.assert_allclose(run.policy.act(one), actions[2], atol=1e-12)
    batch.close()
    card, network = read_policy(run.folder / "policy.safetensors")
    save_policy(tmp_path / "again.safetensors", card, network)
    np.testing.assert_array_equal(load_policy(tmp_path / "again.safetensors").act(seen), actions)


@pytest.mark.slow
def test_evaluation_shows_it_pictures_of_its_size(run):
    found = evaluate(run.policy, goals=5, seed=VALIDATION, options={"backend": "kinematic"})
    assert len(found.trials) == 5
    assert np.isfinite(found.measures["distance"]).all()


@pytest.mark.slow
def test_the_same_seed_trains_the_same_policy(run, tmp_path):
    again = train(small(), tmp_path, seed=3)
    assert (again.folder / "policy.safetensors").read_bytes() == (run.folder / "policy.safetensors").read_bytes()
    other = train(small(), tmp_path / "other", seed=4)
    assert (other.folder / "policy.safetensors").read_bytes() != (run.folder / "policy.safetensors").read_bytes()


def test_what_does_not_fit_is_refused(run, tmp_path):
    policy = run.policy
    vector, pixels = gym.make(SINGLE, backend="kinematic"), gym.make(SINGLE, **PIXELS)
    policy.check_spaces(pixels.observation_space, pixels.action_space)
    with pytest.raises(InputError, match="takes 2 pictures"):
        policy.check_spaces(vector.observation_space, vector.action_space)
    with pytest.raises(InputError, match="with 2 pictures"):
        policy.act(np.zeros(13))
    black = np.zeros((32, 48, 3), dtype=np.uint8)
    with pytest.raises(InputError, match="front_rgb must be uint8"):
        policy.act({"front_rgb": black.astype(float), "wrist_rgb": black})
    with pytest.raises(InputError, match="does not learn from looks"):
        train(small(algorithm="AdaptivePPO"), tmp_path / "run", seed=0)
    vector.close()
    pixels.close()


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("eye0.strides", lambda value: value * 0.5, "strides"),
        ("eye1.sharpness", lambda value: value * np.nan, "finite"),
        ("eye0.layer1.weight", lambda value: value[:, :4], "must take 16 channels"),
        ("eye0.layer2.bias", lambda value: value[:4], "must take 32 channels"),
        ("eye1.layer0.weight", lambda value: value[..., :4, :4], "must take 3 channels"),
        ("eye1.strides", None, "eye"),
        ("eye0.layer0.bias", None, "tensors"),
        ("mean", lambda value: value[:4], "must have a number for each"),
        ("scale", lambda value: value[:4], "mean and scale"),
    ],
)
def test_damaged_eyes_are_refused(run, tmp_path, name, change, said):
    source = run.folder / "policy.safetensors"
    with safe_open(source, framework="numpy") as file:
        header = file.metadata()
    tensors = load_file(source)
    if change is None:
        del tensors[name]
    else:
        tensors[name] = np.ascontiguousarray(change(tensors[name]))
    save_file(tensors, tmp_path / "damaged.safetensors", metadata=header)
    with pytest.raises(InputError, match=said):
        read_policy(tmp_path / "damaged.safetensors")


def test_colours_reach_from_minus_one_to_one():
    assert (0 / MIDDLE - 1, 255 / MIDDLE - 1) == (-1.0, 1.0)
