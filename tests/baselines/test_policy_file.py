"""Policy files: what is written is read, and nothing else is taken for a policy."""

import itertools
import json
import pickle
import zipfile
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from safetensors.numpy import save_file

from kinreach._registration import MULTI, MULTI_KINEMATIC, SINGLE, SPACE
from kinreach.baselines import load_policy
from kinreach.baselines._policy_file import ACTIVATIONS, OUTPUTS, Network, PolicyCard, read_policy, save_policy
from kinreach.baselines.inside import LearnedPolicy, pretrained_names
from kinreach.envs._reach.env import ReachEnv
from kinreach.errors import InputError, OutputError, UnknownNameError

CARD = PolicyCard(
    SINGLE, "posture", "silu", "linear", "RankedPPO", {"name": "ranked-single"}, 3, 1000, {"reached": 1.0}
)


def network(seed=0, inputs=6, hidden=(8, 8), outputs=6, waves=(0.5, 2.0), differences=0):
    rng = np.random.default_rng(seed)
    sizes = [inputs * (1 + 2 * len(waves)) + differences, *hidden, outputs]
    layers = [(rng.normal(size=(b, a)), rng.normal(size=b)) for a, b in itertools.pairwise(sizes)]
    vectors = rng.normal(size=inputs), rng.uniform(0.5, 2, inputs), np.array(waves)
    made = Network(*vectors, layers, "silu", "linear", rng.normal(size=outputs), rng.normal(size=outputs))
    return replace(made, differences=rng.normal(0.0, 2.0, (differences, inputs)) if differences else None)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "policy.safetensors"
    save_policy(path, CARD, network())
    return path


def tensors_and_header(net):
    names = ("mean", "scale", "waves", "gain", "shift")
    tensors = {name: np.array(getattr(net, name)) for name in names}
    for index, (weight, bias) in enumerate(net.layers):
        tensors |= {f"layer{index}.weight": weight, f"layer{index}.bias": bias}
    card = {"format": 1, **{field: getattr(CARD, field) for field in CARD.__dataclass_fields__}}
    return tensors, card


def test_round_trip(tmp_path):
    covered = 0
    for seed in range(30):
        rng = np.random.default_rng(seed)
        made = network(seed, waves=tuple(rng.uniform(0.1, 3, rng.integers(0, 3))), differences=seed % 3)
        made = replace(made, activation=str(rng.choice(list(ACTIVATIONS))), output=str(rng.choice(list(OUTPUTS))))
        card = replace(CARD, activation=made.activation, output=made.output, seed=seed, goal_seeds={"training": [seed]})
        save_policy(tmp_path / "p.safetensors", card, made)
        read_card, read = read_policy(tmp_path / "p.safetensors")
        assert read_card == card
        x = rng.normal(size=(20, 13))
        np.testing.assert_array_equal(read(x), made(x))
        np.testing.assert_allclose(read(x[0]), made(x)[0], rtol=1e-12, atol=1e-12)
        covered += len(x)
    assert covered == 600


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("spoilt", [[0], [5], [1, 3], range(6)])
def test_an_answer_with_any_number_that_is_none_is_refused(spoilt):
    """Of finite weights that are too large; without a warning of NumPy's."""
    made, gain = network(), np.ones(6)
    x = np.random.default_rng(1).normal(size=(4, 6))
    assert np.isfinite(LearnedPolicy(CARD, replace(made, gain=gain)).act(x)).all()
    gain[list(spoilt)] = 1e308
    policy = LearnedPolicy(CARD, replace(made, gain=gain, shift=1e308 * (gain > 1.0)))
    for ask in (policy.act, policy.posture):
        for observation in (x, x[0]):
            with pytest.raises(InputError, match="answers with NaN or infinity"):
                ask(100.0 * np.sign(observation))


def test_every_truncation_is_refused(file):
    whole = file.read_bytes()
    cuts = np.unique(np.linspace(0, len(whole) - 1, 50).astype(int))
    assert len(cuts) == 50
    for cut in cuts:
        file.write_bytes(whole[:cut])
        with pytest.raises(InputError, match="is not a policy"):
            read_policy(file)


def test_flipped_bits_are_refused_or_change_numbers_only(file):
    whole = file.read_bytes()
    rng = np.random.default_rng(0)
    refused = 0
    for _ in range(100):
        damaged = bytearray(whole)
        damaged[rng.integers(len(whole))] ^= 1 << rng.integers(8)
        file.write_bytes(bytes(damaged))
        try:
            action = LearnedPolicy(*read_policy(file)).act(np.zeros(13))
        except InputError:
            refused += 1
        else:
            assert action.shape == (6,)
            assert np.isfinite(action).all()
    assert 10 < refused < 100


class Bomb:
    def __reduce__(self):
        return (print, ("executed",))


def test_files_of_other_kinds_are_refused_and_nothing_runs(tmp_path, capsys):
    path = tmp_path / "p.safetensors"
    contents = [b"", b"{}", pickle.dumps(Bomb()), b"\xff" * 64, (2**63).to_bytes(8, "little") + b"{}"]
    for content in contents:
        path.write_bytes(content)
        with pytest.raises(InputError, match="is not a policy"):
            read_policy(path)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("data.pkl", pickle.dumps(Bomb()))
    with pytest.raises(InputError):
        read_policy(path)
    path.write_bytes(b"\0" * (17 << 20))
    with pytest.raises(InputError, match="larger than 16 MiB"):
        read_policy(path)
    for other in (tmp_path, tmp_path / "missing.safetensors"):
        with pytest.raises(InputError):
            read_policy(other)
    assert "executed" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mean": np.full(6, np.nan)}, "mean must be finite"),
        ({"mean": np.zeros(6, dtype=np.int64)}, "floating-point"),
        ({"scale": np.zeros(6)}, "scale must be positive"),
        ({"scale": np.ones(5)}, "the same length"),
        ({"gain": np.ones(5)}, "6 numbers"),
        ({"layer1.weight": np.ones((8, 9))}, "layer 1 must take 8"),
        ({"layer9.weight": np.ones((8, 8))}, "tensors must be"),
        ({"mean": np.zeros((2, 3))}, "one dimension"),
        ({"low": np.zeros(6)}, "both be there"),
        ({"steering.low": np.zeros(6)}, r"the tensors of steering\.\* must be fits, low, high, got \['steering.low'\]"),
        ({"low": np.zeros(6), "high": np.zeros(6)}, "low below high"),
    ],
)
def test_tensors_that_do_not_fit_are_refused(tmp_path, change, message):
    tensors, card = tensors_and_header(network())
    save_file(tensors | change, tmp_path / "p.safetensors", metadata={"kinreach": json.dumps(card)})
    with pytest.raises(InputError, match=message):
        read_policy(tmp_path / "p.safetensors")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": 2}, "format is not 1"),
        ({"seed": "3"}, "seed must be of type int"),
        ({"recipe": []}, "recipe must be of type dict"),
        ({"meaning": "magic"}, "meaning must be one of action"),
        ({"activation": "__import__"}, "activation must be one of"),
        ({"more": 1}, "must have the fields"),
        ({"goal_seeds": [1]}, "goal_seeds must be of type dict"),
    ],
)
def test_cards_that_do_not_fit_are_refused(tmp_path, change, message):
    tensors, card = tensors_and_header(network())
    save_file(tensors, tmp_path / "p.safetensors", metadata={"kinreach": json.dumps(card | change)})
    with pytest.raises(InputError, match=message):
        read_policy(tmp_path / "p.safetensors")


def test_options_of_a_card_may_be_anything(tmp_path):
    tensors, card = tensors_and_header(network())
    for options in ([1], "steps", 3, None, {"arm": 3}):
        recipe = {"name": "mine", "options": options}
        save_file(tensors, tmp_path / "p.safetensors", metadata={"kinreach": json.dumps(card | {"recipe": recipe})})
        policy = load_policy(tmp_path / "p.safetensors")
        assert not policy.stepwise
        assert policy.needed_options == {}


@pytest.mark.parametrize("steps", ["single", "multi"])
@pytest.mark.parametrize(("arm", "name"), [("panda", "panda-single"), ("ur5-thesis", "ranked-single")])
def test_a_posture_is_what_the_environment_makes_of_it(arm, name, steps):
    trained = load_policy(name)
    environment = {"single": SINGLE, "multi": MULTI}[steps]
    policy = LearnedPolicy(replace(trained.card, environment=environment), trained.network)
    env = gym.make(environment, arm=arm, backend="kinematic", disable_env_checker=True)
    at_once: ReachEnv = gym.make(SINGLE, arm=arm, backend="kinematic", disable_env_checker=True).unwrapped
    postures = 0
    for seed in range(4):
        observation, _ = env.reset(seed=seed)
        posture, over = at_once.posture_for(trained.act(observation)), False
        np.testing.assert_allclose(policy.posture(observation), posture, atol=1e-12)
        while not over:
            observation, _, terminated, truncated, info = env.step(policy.act(observation))
            over = terminated or truncated
        assert not info["impossible"]
        np.testing.assert_allclose(info["q"], posture, atol=1e-6)
        postures += 1
    assert postures == 4


def test_a_posture_takes_an_arm_with_as_many_joints():
    card = replace(CARD, environment=MULTI, recipe={"name": "mine", "options": {"arm": "panda"}})
    with pytest.raises(InputError, match="a posture of the arm 'panda' has 7 numbers, got 6"):
        LearnedPolicy(card, network()).act(np.zeros(13))
    with pytest.raises(InputError, match=r"an observation must have at least 6 numbers, got shape \(5,\)"):
        LearnedPolicy(CARD, network()).posture(np.zeros(5))
    with pytest.raises(InputError, match=r"the output of .* means action, not a posture"):
        LearnedPolicy(replace(CARD, meaning="action"), network()).posture(np.zeros(13))
    card = replace(CARD, recipe={"name": "mine", "options": {"arm": "nobody's"}})
    with pytest.raises(UnknownNameError, match="nobody's"):
        LearnedPolicy(card, network()).posture(np.zeros(13))


def test_environments_of_others_are_walked_in_where_the_recipe_says_so():
    walked = {
        ("my/MultiStepX-v0", 1): False, ("my/Own-v0", 16): True, (MULTI, 16): True, (MULTI_KINEMATIC, 16): True,
        (SINGLE, 1): False,
    }  # fmt: skip
    for (environment, walk), expected in walked.items():
        card = replace(CARD, environment=environment, recipe={"name": "mine", "walk": walk})
        assert LearnedPolicy(card, network()).stepwise == expected
        assert not LearnedPolicy(replace(card, meaning="action"), network()).stepwise
    for environment, expected in ((SPACE, True), ("my/Own-v0", False)):
        card = replace(CARD, environment=environment, recipe={"name": "mine", "options": {"steps": "multi"}})
        assert LearnedPolicy(card, network()).stepwise == expected


def test_cards_of_before_there_were_seeds_of_goals_are_read(tmp_path):
    tensors, card = tensors_and_header(network())
    path, lacking = tmp_path / "p.safetensors", 0
    for name in CARD.__dataclass_fields__:
        older = {field: value for field, value in card.items() if field != name}
        save_file(tensors, path, metadata={"kinreach": json.dumps(older)})
        if name == "goal_seeds":
            assert read_policy(path)[0] == replace(CARD, goal_seeds={})
        else:
            with pytest.raises(InputError, match="must have the fields"):
                read_policy(path)
            lacking += 1
    assert lacking == 10


@pytest.mark.parametrize("text", ["", "{", "[]", "null", "[" * 100_000, '{"format": 1, "steps": NaN}'])
def test_headers_that_are_no_card_are_refused(tmp_path, text):
    tensors, _ = tensors_and_header(network())
    save_file(tensors, tmp_path / "p.safetensors", metadata={"kinreach": text})
    said = "its format is not 1" if text in ("[]", "null") else "its header has no JSON entry 'kinreach'"
    with pytest.raises(InputError, match=f"is not a policy: {said}"):
        read_policy(tmp_path / "p.safetensors")


def test_a_policy_for_another_environment_is_refused(file):
    with pytest.raises(InputError, match="is for kinreach/UR5SingleStep-v0, not for kinreach/UR5MultiStep-v0"):
        load_policy(file, environment="kinreach/UR5MultiStep-v0")
    with pytest.raises(UnknownNameError, match="ranked-single"):
        load_policy("no-such-policy")


def test_the_spaces_of_an_environment_decide_what_fits():
    vector, six = spaces.Box(-1, 1, (13,)), spaces.Box(-1, 1, (6,))
    policy = LearnedPolicy(CARD, network(inputs=13))
    policy.check_spaces(vector, six)
    chooser = LearnedPolicy(replace(CARD, meaning="preferences", environment="CartPole-v1"), network(inputs=4))
    chooser.check_spaces(spaces.Box(-1, 1, (4,)), spaces.Discrete(6))
    wrong = [
        (policy, spaces.Box(-1, 1, (12,)), six, "at least 13"),
        (policy, spaces.Dict({"a": vector}), six, "at least 13"),
        (policy, vector, spaces.Box(-1, 1, (5,)), "6 numbers"),
        (policy, vector, spaces.Discrete(6), "6 numbers"),
        (chooser, vector, six, "one of 6"),
        (chooser, vector, spaces.Discrete(7), "one of 6"),
    ]
    for given, observations, actions, message in wrong:
        with pytest.raises(InputError, match=message):
            given.check_spaces(observations, actions)


def test_actions_are_clipped_to_the_bounds_in_the_file(tmp_path):
    made = replace(network(), low=np.full(6, -2.0), high=np.full(6, 0.5))
    save_policy(tmp_path / "p.safetensors", replace(CARD, meaning="action"), made)
    policy = load_policy(tmp_path / "p.safetensors")
    x = np.random.default_rng(0).normal(size=(500, 13))
    np.testing.assert_array_equal(policy.act(x), np.clip(made(x), -2.0, 0.5))
    assert policy.act(x).min() == -2.0 < policy.act(x).max() == 0.5


def test_a_policy_is_written_whole_or_not_at_all(file, monkeypatch):
    before = file.read_bytes()
    monkeypatch.setattr("os.replace", lambda *a: (_ for _ in ()).throw(OSError("disk full")))
    with pytest.raises(OutputError, match="disk full"):
        save_policy(file, CARD, network(1))
    assert file.read_bytes() == before
    assert [path.name for path in file.parent.iterdir()] == [file.name]


def test_policies_of_the_package_are_small_and_fit(tmp_path):
    names = pretrained_names()
    assert {"ranked-single", "ranked-multi", "ppo-single", "ppo-multi", "thesis-ppo-single"} <= set(names)
    for name in names:
        policy = load_policy(name)
        save_policy(tmp_path / name, policy.card, policy.network)
        assert (tmp_path / name).stat().st_size < 1_000_000
