"""A policy that steers to a rolling ball: what it sees, where its answers lead, its file, and how it is trained."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from kinreach.baselines._policy_file import Network, PolicyCard, read_policy, save_policy
from kinreach.baselines._steering import FEATURES, WINDOWS, Steering, sight_fits
from kinreach.baselines.inside import LearnedPolicy
from kinreach.envs import moving
from kinreach.errors import InputError

SIGHTS = 20
PART = 1.0 / (moving.FRAMES * moving.PARTS)
LIMITS = {"speed": 3.0, "acceleration": 10.0}
HIGH = np.array([np.pi, np.pi, 2.9, 0.0, 1.0, np.pi])


def steering_policy(seed=0, **changes):
    rng = np.random.default_rng(seed)
    sizes = [FEATURES, 16, 6]
    layers = [(rng.normal(size=(n, m)) / np.sqrt(m), rng.normal(size=n)) for m, n in pairwise(sizes)]
    network = Network(
        np.zeros(FEATURES), np.ones(FEATURES), np.zeros(0), layers, "silu", "tanh", np.ones(6), np.zeros(6),
        steering=Steering(sight_fits(SIGHTS, 0.05), -np.pi * np.ones(6), HIGH),
    )  # fmt: skip
    card = PolicyCard(
        "kinreach/Moving-v0",
        "action",
        "silu",
        "tanh",
        "EpisodeGradient",
        {"name": "x", "options": {"sights": SIGHTS}},
        0,
        1,
    )
    return LearnedPolicy(card, replace(network, **changes))


def episodes(count=12, **options):
    world = moving.MovingEpisodes(moving.MovingOptions(sights=SIGHTS, **options), count)
    for index in range(count):
        world.seed(index, np.random.default_rng(index))
    world.begin(np.arange(count))
    return world


def after_a_frame(q, v, target, limits=LIMITS):
    for _ in range(moving.PARTS):
        q, v = moving.moved(q, v, target, PART, **limits)
    return q, v


def test_shares_are_of_the_possible_motion():
    """At -1 and 1 nothing goes further in the frame, in between it goes on steadily."""
    rng = np.random.default_rng(0)
    q, v = rng.uniform(-3.0, 3.0, 1000), rng.uniform(-3.0, 3.0, 1000)
    shares = np.linspace(-1.0, 1.0, 9)
    ends = np.array([after_a_frame(q, v, moving.steered(q, v, share, **LIMITS))[0] for share in shares])
    for end, far in ((ends[0], -100.0), (ends[-1], 100.0)):
        np.testing.assert_allclose(end, after_a_frame(q, v, q + far)[0], atol=3e-3)
    assert (np.diff(ends, axis=0) > -1e-9).all()
    assert (np.diff(ends[::4], axis=0) > 1e-5).all()


@pytest.mark.parametrize("delay", [0.0, 0.05, 0.2])
def test_fits_are_least_squares_of_the_sights_since_the_ball_was_seen_to_move(delay):
    rng = np.random.default_rng(1)
    fits, taken, compared = sight_fits(SIGHTS, delay), np.maximum(np.arange(SIGHTS) / 30 - delay, 0.0), 0
    for frame in range(SIGHTS):
        place, speed, acceleration = rng.normal(size=3)
        seen = place + speed * taken[: frame + 1] + acceleration * taken[: frame + 1] ** 2 / 2
        earlier = seen[np.maximum(frame - np.arange(1, SIGHTS), 0)] - seen[-1]
        found = fits[frame] @ earlier
        moving_for = frame - int((taken == 0.0).sum()) + 2  # sights that differ
        for row, window in enumerate(WINDOWS):
            if min(window, moving_for) >= 3:
                assert found[len(WINDOWS) + row] == pytest.approx(acceleration, abs=2e-3)
                if not acceleration:
                    assert found[row] == pytest.approx(speed, abs=1e-6)
                compared += 1
        assert fits[0].any() == 0
    assert compared >= 30


def test_it_counts_the_frames_and_looks_the_same_in_a_batch_alone_and_as_a_tensor():
    torch = pytest.importorskip("torch")
    policy, world = steering_policy(), episodes(collisions=False)
    steering = policy.network.steering
    as_tensors = replace(steering, fits=torch.as_tensor(steering.fits))
    for frame in range(30):
        x = world.observe()
        seen = steering.features(x)
        count = 4 * len(WINDOWS) + 2 * 11 + 2
        np.testing.assert_allclose(seen[:, count], min(frame / 10, 1.0))
        np.testing.assert_allclose(seen[:, count + 1], min(frame / (SIGHTS - 1), 1.0))
        np.testing.assert_allclose(as_tensors.features(torch.as_tensor(x)).numpy(), seen, atol=1e-9)
        actions = policy.act(x)
        np.testing.assert_allclose(policy.act(x[3]), actions[3], atol=1e-12)
        world.step(actions)


def test_its_targets_stay_within_the_bounds():
    policy, world, beyond = steering_policy(), episodes(collisions=False), 0
    for _ in range(60):
        x = world.observe()
        share = np.random.default_rng(len(x)).uniform(-1.0, 1.0, (len(x), 6))
        beyond += (moving.steered(x[:, 4:10], x[:, 10:16], share, **LIMITS) > HIGH).sum()
        assert (np.pi * policy.network.steering.actions(x, share) <= HIGH + 1e-12).all()
        world.step((HIGH + 0.5) / np.pi * np.ones((len(x), 1)))
    assert beyond > 10


def test_its_file_gives_the_same_policy(tmp_path):
    policy, x = steering_policy(), episodes().observe()
    save_policy(tmp_path / "policy.safetensors", policy.card, policy.network)
    read = LearnedPolicy(*read_policy(tmp_path / "policy.safetensors"))
    np.testing.assert_array_equal(read.act(x), policy.act(x))
    assert read.inputs == x.shape[1] == policy.inputs
    with pytest.raises(InputError, match="at least 73 numbers"):
        read.act(x[:, :-3])


@pytest.mark.parametrize(
    ("steering", "message"),
    [
        ({"fits": np.zeros((20, 8, 18))}, "must be of 12 sights or more"),
        ({"fits": np.zeros((3, 8, 2))}, "must be of 12 sights or more"),
        ({"low": np.zeros(5)}, "must have 6 numbers"),
        ({"low": np.full(6, 4.0)}, "low below high"),
    ],
)
def test_a_damaged_file_is_refused(steering, message, tmp_path):
    policy = steering_policy()
    network = replace(policy.network, steering=replace(policy.network.steering, **steering))
    save_policy(tmp_path / "policy.safetensors", policy.card, network)
    with pytest.raises(InputError, match=message):
        read_policy(tmp_path / "policy.safetensors")


def test_as_onnx_it_answers_the_same(tmp_path):
    reason = "needs onnx and onnxruntime"
    pytest.importorskip("onnx", reason=reason)
    onnxruntime = pytest.importorskip("onnxruntime", reason=reason)
    from kinreach.baselines._onnx_export import export_onnx

    policy, world = steering_policy(), episodes(40, collisions=False)
    export_onnx(policy, tmp_path / "policy.onnx")
    session = onnxruntime.InferenceSession(str(tmp_path / "policy.onnx"), providers=["CPUExecutionProvider"])
    for _ in range(25):
        x = world.observe()
        actions = policy.act(x)
        np.testing.assert_allclose(session.run(["action"], {"observation": x})[0], actions, atol=1e-9)
        world.step(actions)
    assert np.ptp(world.q, axis=0).max() > 0.01


def ppo_recipe():
    from kinreach.baselines import get_recipe

    ppo, gradient = get_recipe("ppo-moving"), get_recipe("gradient-moving-clear")
    bounds = {name: gradient.settings[name] for name in ("low", "high")}
    return replace(
        ppo, num_envs=8, options={"sights": SIGHTS}, networks=gradient.networks, settings={**ppo.settings, **bounds}
    )


def test_ppo_explores_in_shares_of_the_possible_motion():
    """The spread of its actions is that of shares, times what a share moves; both of its ways tell the same density."""
    pytest.importorskip("stable_baselines3")
    import torch

    from kinreach.baselines._models import build

    trainee, world = build(ppo_recipe(), 0, steps=1000), episodes(40, collisions=False)
    rng = np.random.default_rng(2)
    for _ in range(15):
        world.step(rng.uniform(-1.0, 1.0, (40, 6)))
    x, policy = torch.as_tensor(world.observe(), dtype=torch.float32), trainee.model.policy
    with torch.no_grad():
        means, spread = policy.means(x), policy.features_extractor.steering.spread(x)
        drawn = torch.stack([policy(x)[0] for _ in range(400)])
        actions, values, told = policy(x)
        again, density, entropy = policy.evaluate_actions(x, actions)
    shares = ((drawn - means) / spread).numpy()
    first = trainee.model.exploration.first
    np.testing.assert_allclose(shares.std(axis=(0, 1)), first, rtol=0.03)
    assert abs(shares.mean()) < 0.02 * first
    assert spread.min() < 0.5 * spread.max()
    np.testing.assert_array_equal(again, values)
    np.testing.assert_allclose(density, told, rtol=1e-6)
    off = ((actions - means) / spread / first).numpy()
    expected = -(off**2) / 2 - np.log(first * spread.numpy()) - np.log(2 * np.pi) / 2
    np.testing.assert_allclose(told, expected.sum(axis=1), rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(entropy, (np.log(first * spread.numpy()) + 1.4189385).sum(axis=1), rtol=1e-4, atol=1e-4)
    trainee.env.close()


def test_ppo_goes_on_from_a_policy_of_the_gradient():
    pytest.importorskip("stable_baselines3")
    from kinreach.baselines import load_policy
    from kinreach.baselines._models import build

    start, world = load_policy("gradient-moving-clear"), episodes(40, collisions=False)
    trainee = build(ppo_recipe(), 0, steps=1000, start=start)
    for _ in range(10):
        x = world.observe()
        np.testing.assert_allclose(trainee.network(x), start.act(x), atol=1e-5)
        world.step(start.act(x))
    trainee.env.close()


def test_an_algorithm_from_outside_steers(monkeypatch):
    pytest.importorskip("stable_baselines3")
    from kinreach.baselines import Algorithm
    from kinreach.baselines._algorithms import ALGORITHMS
    from kinreach.baselines._models import build

    monkeypatch.setitem(ALGORITHMS, "A2C", Algorithm("A2C", "stable_baselines3:A2C"))
    recipe = ppo_recipe()
    bounds = {name: recipe.settings[name] for name in ("low", "high")}
    trainee, world = build(replace(recipe, algorithm="A2C", settings=bounds), 0, steps=1000), episodes(40)
    assert np.ptp(trainee.network(world.observe()), axis=1).min() > 0.1
    trainee.env.close()


@pytest.mark.parametrize(("algorithm", "option"), [("AdaptivePPO", "hidden"), ("EpisodeGradient", "dropped")])
def test_a_training_whose_sights_have_gaps_is_refused(algorithm, option, tmp_path):
    """And a policy may be tried there, which a published table does."""
    pytest.importorskip("stable_baselines3")
    from kinreach.baselines import evaluate, get_recipe, load_policy, train

    recipe = ppo_recipe() if algorithm == "AdaptivePPO" else get_recipe("gradient-moving-clear")
    recipe = replace(recipe, num_envs=8, options={"sights": SIGHTS, option: 0.2})
    with pytest.raises(InputError, match=rf"'steering'.* {option} must be 0, got 0\.2.*'sights'"):
        train(recipe, tmp_path, steps=8)
    options = {option: 0.2, "collisions": False}
    assert len(evaluate(load_policy("gradient-moving-clear"), goals=3, options=options).reached) == 3


def test_what_does_not_steer_is_refused():
    pytest.importorskip("stable_baselines3")
    from kinreach.baselines import get_recipe
    from kinreach.baselines._models import build

    recipe = ppo_recipe()
    with pytest.raises(InputError, match=r"are for kinreach/Moving-v0 with 12 sights or more"):
        build(replace(recipe, options={"sights": 11}), 0, steps=1000)
    with pytest.raises(InputError, match="needs the setting 'low'"):
        build(replace(recipe, settings=get_recipe("ppo-moving").settings), 0, steps=1000)
    gradient = get_recipe("gradient-moving-clear")
    with pytest.raises(InputError, match="are for the features 'steering', not 'raw'"):
        build(replace(gradient, networks=replace(gradient.networks, features="raw")), 0, steps=1000)
