"""The registry of the algorithms that a recipe can be trained with, and how a recipe's settings become theirs.

An algorithm from outside is one entry, for example of sb3-contrib:

    register_algorithm(Algorithm("TQC", "sb3_contrib:TQC"))
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import VectorEnv
from numpy.typing import ArrayLike
from stable_baselines3 import PPO
from stable_baselines3.common.base_class import BaseAlgorithm

from kinreach._checks import STEP_LIMIT, check_count, check_known, shown
from kinreach._objects import load_object, place_of
from kinreach._registration import LIFT, MOVING, SPACE
from kinreach.baselines._adaptive_ppo import AdaptivePPO, LateCollisionsPPO
from kinreach.baselines._batch import first_observations
from kinreach.baselines._descent import AnalyticGradient, MovingGradient, RandomArmGradient
from kinreach.baselines._episode_gradient import EpisodeGradient
from kinreach.baselines._imitation import AnsweredVecEnv, Imitation
from kinreach.baselines._looks import Looks, LooksVecEnv
from kinreach.baselines._networks import (
    ACTIVATIONS,
    LookFeatures,
    ObservationFeatures,
    PosturePolicy,
    SteeringFeatures,
    SteeringPolicy,
)
from kinreach.baselines._policy_file import Network
from kinreach.baselines._ppo2 import PPO2
from kinreach.baselines._ranked_ppo import AdaptiveRate, Exploration, RankedPPO, TriesVecEnv
from kinreach.baselines._recipes import Recipe
from kinreach.baselines._rewards import TrainingReward
from kinreach.baselines._sb3_export import actor_network, averaged_actor
from kinreach.baselines._steering import PLACES as MIN_SIGHTS
from kinreach.baselines._vec_envs import SB3VecEnv
from kinreach.envs.inside import ButtonOptions, SpaceTask, button_task, lift_task, moving, reach_task
from kinreach.errors import InputError, KinreachError
from kinreach.robots import THESIS_ARM, ArmDescription, get_arm

#: Features of networks by name: those that scale observations, and all.
SCALED = ("scaled", "waves", "goal waves", "button", "sights", "arms", "grasps", "objects")
FEATURES = ("raw", *SCALED, "steering", "looks")
#: Angular frequencies of the waves of normalised observations.
WAVES = (0.5, 1.0, 2.0)
#: Opening that a grasp begins with, as an action: 20 mm.
FIRST_OPENING = -0.75


def mlp_arguments(recipe: Recipe, env: SB3VecEnv, planned: int) -> dict[str, Any]:
    """Keyword arguments of a model with `MlpPolicy`, or one that steers, from the settings and networks of a recipe.

    In the settings, `adam` are keyword arguments of the optimiser, and `policy_kwargs` are added to those of the
    networks.
    """
    networks, settings = recipe.networks, dict(recipe.settings)
    check_known("activation", networks.activation, ACTIVATIONS)
    check_known("features", networks.features, FEATURES)
    policy: dict[str, Any] = {"net_arch": list(networks.hidden), "activation_fn": ACTIVATIONS[networks.activation]}
    if networks.features == "looks":
        looks = getattr(env, "looks", None)
        if looks is None:
            raise InputError(f"{recipe.algorithm} does not learn from looks; ranked PPO does")
        policy |= {"features_extractor_class": LookFeatures, "features_extractor_kwargs": {"looks": looks}}
    elif networks.features == "steering":
        policy |= _steering(recipe, settings)
    elif networks.features in SCALED:
        policy |= {"features_extractor_class": ObservationFeatures, "features_extractor_kwargs": _features(recipe)}
    if "adam" in settings:
        policy["optimizer_kwargs"] = dict(settings.pop("adam"))
    kind = SteeringPolicy if networks.features == "steering" else "MlpPolicy"
    return {"policy": kind, **settings, "policy_kwargs": policy | settings.get("policy_kwargs", {})}


def ppo_arguments(recipe: Recipe, env: SB3VecEnv, planned: int) -> dict[str, Any]:
    """Return the arguments of PPO: `minibatches` give the batch size, and the actor may have a `PostureHead`."""
    _check_counts(recipe, "n_steps", "n_epochs", "batch_size")
    arguments = mlp_arguments(recipe, env, planned)
    networks, policy = recipe.networks, arguments["policy_kwargs"]
    if networks.std != 1.0:
        policy["log_std_init"] = math.log(networks.std)
    if networks.posture:
        arm = _arm(recipe)
        gain, shift = (1.0 / reach_task.action_range(arm)[0]).tolist(), _action_to(arm, arm.home)
        if recipe.environment == LIFT:
            gain, shift = [*gain, max(gain)], [*shift, FIRST_OPENING]
        arguments["policy"] = PosturePolicy
        policy["head"] = {"gain": gain, "shift": shift}
    if "minibatches" in arguments:
        _check_counts(recipe, "minibatches", most=recipe.num_envs * arguments["n_steps"])
        arguments["batch_size"] = recipe.num_envs * arguments["n_steps"] // arguments.pop("minibatches")
    return arguments


def ppo2_arguments(recipe: Recipe, env: SB3VecEnv, planned: int) -> dict[str, Any]:
    """Return the arguments of PPO; `gain` is the actor's unit as an action: 1/π for radians if 1 means π."""
    arguments = ppo_arguments(recipe, env, planned)
    size = (env.action_space.shape or (0,))[0]
    arguments["policy_kwargs"]["head"] = {"gain": size * [arguments.pop("gain")], "shift": size * [0.0]}
    return {**arguments, "policy": PosturePolicy}


def adaptive_arguments(recipe: Recipe, env: SB3VecEnv, planned: int) -> dict[str, Any]:
    """Return the arguments of PPO, with `Exploration` (in radians for outputs that are postures) and `AdaptiveRate`."""
    arguments = ppo_arguments(recipe, env, planned) | {"planned_steps": planned}
    arguments["adaptive"] = AdaptiveRate(**arguments["adaptive"])
    if arguments["exploration"] is not None:
        schedule = Exploration(**arguments["exploration"])
        posture = recipe.networks.posture
        arguments["exploration"] = (
            schedule.scaled(1.0 / reach_task.action_range(_arm(recipe))[0].max()) if posture else schedule
        )
    return arguments


def actor_arguments(recipe: Recipe, env: SB3VecEnv, planned: int) -> dict[str, Any]:
    """Return the arguments of adaptive PPO, without a critic."""
    arguments = adaptive_arguments(recipe, env, planned)
    arguments["policy_kwargs"]["net_arch"] = {"pi": list(recipe.networks.hidden), "vf": []}
    return arguments


def ranked_arguments(recipe: Recipe, env: SB3VecEnv, planned: int) -> dict[str, Any]:
    arguments = actor_arguments(recipe, env, planned)
    arguments.pop("looks", None)
    return arguments


def analytic_arguments(recipe: Recipe, env: SB3VecEnv, planned: int) -> dict[str, Any]:
    """Return the arguments of an actor, and the task; `around` is the posture [rad] that outputs are changes of."""
    if recipe.environment != SPACE or not recipe.networks.posture:
        raise InputError(f"analytic gradients are for postures in {SPACE}, not for {recipe.environment}")
    arguments = actor_arguments(recipe, env, planned) | {"task": SpaceTask.of(recipe.options)}
    del arguments["tries"]  # of the environments
    if "around" in arguments:
        arguments["policy_kwargs"]["head"]["shift"] = _action_to(_arm(recipe), arguments.pop("around"))
    return arguments


def simulator_arguments(recipe: Recipe, env: SB3VecEnv, planned: int) -> dict[str, Any]:
    return actor_arguments(recipe, env, planned) | _simulation(env)


def episode_arguments(recipe: Recipe, env: SB3VecEnv, planned: int) -> dict[str, Any]:
    """Return the arguments of an actor that steers."""
    if recipe.networks.features != "steering":
        raise InputError(
            f"gradients of whole episodes are for the features 'steering', not {recipe.networks.features!r}"
        )
    _check_counts(recipe, "balls")
    return simulator_arguments(recipe, env, planned)


def imitation_arguments(recipe: Recipe, env: SB3VecEnv, planned: int) -> dict[str, Any]:
    """Return the arguments of an actor; `expert` is an argument of the environments."""
    arguments = actor_arguments(recipe, env, planned)
    _check_counts(recipe, "updates")
    _check_counts(recipe, "memory", least=recipe.num_envs * arguments["n_steps"])  # the answers of a round
    del arguments["expert"]
    return arguments


def late_collisions_arguments(recipe: Recipe, env: SB3VecEnv, planned: int) -> dict[str, Any]:
    return adaptive_arguments(recipe, env, planned) | _simulation(env)


def _check_counts(recipe: Recipe, *names: str, least: int = 1, most: int | None = None) -> None:
    """Check settings of a recipe that are counts, where it has them."""
    for name in names:
        if name in recipe.settings:
            check_count(f"{name} of {recipe.name}", recipe.settings[name], least=least, most=most)


def _simulation(env: SB3VecEnv) -> dict[str, Any]:
    return {"world": env.get_attr("unwrapped", 0)[0].episodes}


def _steering(recipe: Recipe, settings: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments of a policy that steers; its settings `low` and `high` are bounds of the targets [rad]."""
    if recipe.environment != MOVING or recipe.options.get("sights", 1) < MIN_SIGHTS:
        raise InputError(f"features 'steering' are for {MOVING} with {MIN_SIGHTS} sights or more")
    for name in ("hidden", "dropped"):
        if gaps := recipe.options.get(name):
            raise InputError(
                f"features 'steering' take a sight in every frame: {name} must be 0, got {shown(gaps)}; the features "
                "'sights' can be trained with it"
            )
    seen = {name: settings.pop(name) for name in ("low", "high")}
    seen |= {"sights": recipe.options["sights"], "delay": recipe.options.get("delay", moving.DELAY)}
    return {"features_extractor_class": SteeringFeatures, "features_extractor_kwargs": seen}


def _features(recipe: Recipe) -> dict[str, Any]:
    """Return the constants of the normalisation, and the waves.

    They are mean and spread of first observations, unless there are constants for the task; those of the button task
    begin upright and almost at rest. What does not vary is only shifted.
    """
    kind = recipe.networks.features
    if kind == "button":
        options = ButtonOptions(**{name: recipe.options[name] for name in recipe.options if name != STEP_LIMIT})
        # cosines and sines, two positions [m], joint velocities [rad/s], difference of the positions [m], push state
        scale: tuple[float, ...] = (*(1.0,) * 6, *(2 / 3,) * 6, *(2.5,) * 3, *(0.5,) * 3, 1.0)
        frame = (*scale, *(button_task.CONTROL_LIMIT,) * button_task.JOINTS * options.controls)
        return {"mean": [0.0] * len(frame) * options.frames, "scale": frame * options.frames}
    home = _arm(recipe).home
    if kind == "sights":
        # a ball [m], the age of its sight [s], joint angles [rad] and speeds [rad/s]; of earlier sights the way to the
        # last [m], which is the longer the earlier they are
        mean: tuple[float, ...] = (0.475, 0.0, -0.175, 0.05, *home, *(0.0,) * 6)
        scale = (0.09, 0.17, 1.0, 0.05, *(0.5,) * 6, *(1.0,) * 6)
        earlier = [0.01 * k for k in range(1, recipe.options["sights"]) for _ in range(3)]
        return {"mean": [*mean, *(0.0 for _ in earlier)], "scale": [*scale, *earlier], "waves": WAVES}
    if kind == "arms":
        # a ball [m], two errors beside it [m], moves, looks, and of three coordinates the mean error [m] and its slopes
        mean = (0.475, 0.0, -0.175, *(0.0,) * 6, 1.0, 20.0, *(0.0,) * 9)
        scale = (0.1, 0.18, 0.006, *(5e-3,) * 6, 1.0, 20.0, *(5e-3, 7e-4, 7e-4) * 3)
        return {"mean": mean, "scale": scale, "waves": WAVES}
    if kind == "grasps":
        # an object [m], the angle of its faces [rad], its size [m] and shape, joint angles [rad], the opening [m], and
        # from the tip to the object [m]
        mean = (0.475, 0.0, -0.175, 0.0, 0.025, 0.0, 0.0, 0.0, *home, 0.05, *(0.0,) * 3)
        scale = (0.1, 0.18, 0.05, 0.5, 0.01, 1.0, 1.0, 1.0, *(0.5,) * 6, 0.02, *(0.05,) * 3)
        return {"mean": mean, "scale": scale}
    if kind == "objects":
        # joint angles [rad], the opening, tip and object [m], the object's rotation, the goal [m]; and from the tip to
        # the object and on to the goal, on a scale of decimetres and of centimetres
        middle, reach, turned = (0.475, 0.0, -0.2), (0.1, 0.15, 0.1), (0.0,) * 6
        mean = (*home, 0.05, *middle, *middle, *turned, *middle)
        scale = (*(0.3,) * len(home), 0.025, *reach, *reach, *(0.7,) * 6, *reach)
        tip, thing, goal = (np.eye(len(mean))[-first:][:3] for first in (15, 12, 3))
        ways = np.vstack([thing - tip, goal - thing])
        return {"mean": mean, "scale": scale, "differences": np.vstack([10.0 * ways, 100.0 * ways]).tolist()}
    observations = first_observations(recipe.environment, recipe.options, seed=1)
    if kind == "goal waves":
        observations = observations[:, _fixed(recipe)]
    spread = observations.std(axis=0)
    spread = np.where(spread < 1e-6, 1.0, spread)
    waves = WAVES if "waves" in kind else ()
    return {"mean": observations.mean(axis=0).tolist(), "scale": spread.tolist(), "waves": waves}


def step_by_step(batch: VectorEnv[Any, Any, Any], recipe: Recipe, reward: TrainingReward) -> SB3VecEnv:
    return SB3VecEnv(batch, reward=reward)


def step_by_step_to_the_end(batch: VectorEnv[Any, Any, Any], recipe: Recipe, reward: TrainingReward) -> SB3VecEnv:
    """Return a batch in which a step limit terminates an episode, as in PPO2."""
    return SB3VecEnv(batch, reward=reward, bootstrap=False)


def answered(
    batch: VectorEnv[Any, Any, Any],
    recipe: Recipe,
    reward: TrainingReward,
    make: type[AnsweredVecEnv] = AnsweredVecEnv,
) -> AnsweredVecEnv:
    """Return a batch in which the setting `expert` answers: `module:Class`, made of one such environment."""
    name, actions = recipe.settings["expert"], batch.single_action_space
    if not isinstance(actions, Box):
        raise InputError(f"{recipe.algorithm} needs actions that are vectors, got {actions} of {recipe.environment}")
    kind: Any = load_object("expert", name)
    of_batches = ("threads", "device")
    options = {key: value for key, value in recipe.options.items() if key not in of_batches}
    if options.get("backend") == "warp":
        del options["backend"]
    env = gym.make(recipe.environment, **options)
    try:
        return make(batch, expert=_expert(name, kind, env), expert_env=env, reward=reward)
    except BaseException:
        env.close()
        raise


def _expert(name: str, kind: Callable[..., Any], env: gym.Env[Any, Any]) -> Any:
    """Make an expert of an environment."""
    try:
        expert = kind(env)
    except KinreachError:
        raise
    except Exception as why:  # of the user's class
        raise InputError(
            f"the expert {name} cannot be made of an environment: {type(why).__name__}: {why}{place_of(why)}"
        ) from why
    if not callable(getattr(expert, "act", None)):
        raise InputError(f"the expert {name} has no method act(rows), got {shown(expert)}")
    return expert


def in_tries(batch: VectorEnv[Any, Any, Any], recipe: Recipe, reward: TrainingReward) -> SB3VecEnv:
    """Return a batch in which several postures are tried for each goal, drawn up to `recipe.beyond` around the area.

    With the features `"looks"`, the setting of that name is the number of looks in a segment of the training.
    """
    _check_counts(recipe, "tries", "looks")
    task = getattr(batch.unwrapped, "task", None)
    if not isinstance(task, reach_task.ReachTask | lift_task.LiftTask):
        raise InputError(
            f"ranked PPO tries postures in an environment for reaching or for grasping, not in {recipe.environment}"
        )
    if isinstance(task, reach_task.ReachTask) and task.options.goal_in != reach_task.CAMERA:
        raise InputError(f"{recipe.algorithm} takes goals in metres, not goal_in={task.options.goal_in!r}")
    tries: dict[str, Any] = {
        "tries": recipe.settings["tries"],
        "draw": partial(task.training_starts, beyond=recipe.beyond),
        "steps": recipe.walk,
        "reward": reward,
        "blur": recipe.blur,
        "layout": task.layout,
        "arm": task.arm,
    }
    if recipe.networks.features == "looks" and isinstance(task, reach_task.ReachTask):
        return LooksVecEnv(batch, looks=Looks(task, recipe.settings["looks"]), **tries)
    return TriesVecEnv(batch, **tries)


def _fixed(recipe: Recipe) -> slice:
    """Return the part of observations that is constant during an episode."""
    if recipe.environment == LIFT:
        return slice(0, lift_task.KIND_END)
    return reach_task.layout_of(_arm(recipe), directed=recipe.environment == SPACE).fixed


def _arm(recipe: Recipe) -> ArmDescription:
    return get_arm(recipe.options.get("arm", THESIS_ARM))


def _action_to(arm: ArmDescription, q: ArrayLike) -> list[float]:
    """Return the action that means a posture [rad], shape (n,)."""
    half, middle = reach_task.action_range(arm)
    return ((np.asarray(q) - middle) / half).tolist()


@dataclass(frozen=True)
class Algorithm:
    """An algorithm of a recipe.

    Attributes:
        name: As in recipes.
        model: A subclass of stable-baselines3's `OnPolicyAlgorithm` or `OffPolicyAlgorithm`, or its name,
            `module:Class`.
        exporter: Returns the deterministic actor of a model as a `Network`. It is called before the training, too.
        arguments: Returns keyword arguments of the class, from the recipe, the environments and the planned actions.
        vec_env: Returns the environments of a model, from a native batch, the recipe and the training reward.
        defaults: Settings that the recipe may override.
    """

    name: str
    model: str | Callable[..., BaseAlgorithm]
    exporter: Callable[[BaseAlgorithm], Network] = actor_network
    arguments: Callable[[Recipe, SB3VecEnv, int], dict[str, Any]] = mlp_arguments
    vec_env: Callable[[VectorEnv[Any, Any, Any], Recipe, TrainingReward], SB3VecEnv] = step_by_step
    defaults: Mapping[str, Any] = field(default_factory=dict)


#: Algorithms by name.
ALGORITHMS: dict[str, Algorithm] = {}


def register_algorithm(algorithm: Algorithm) -> Algorithm:
    """Make an algorithm known to recipes.

    Raises:
        InputError: It is not an algorithm, or another one has its name.
    """
    given: Any = algorithm
    if not isinstance(given, Algorithm):
        raise InputError(f"an algorithm must be an Algorithm, got {shown(given)}")
    if ALGORITHMS.setdefault(algorithm.name, algorithm) != algorithm:
        raise InputError(f"there is an algorithm {algorithm.name!r} already")
    return algorithm


register_algorithm(Algorithm("PPO", PPO, arguments=ppo_arguments))
register_algorithm(Algorithm("PPO2", PPO2, arguments=ppo2_arguments, vec_env=step_by_step_to_the_end))
register_algorithm(Algorithm("AdaptivePPO", AdaptivePPO, arguments=adaptive_arguments))
register_algorithm(Algorithm("LateCollisionsPPO", LateCollisionsPPO, arguments=late_collisions_arguments))
register_algorithm(Algorithm("RankedPPO", RankedPPO, arguments=ranked_arguments, vec_env=in_tries))
register_algorithm(Algorithm("AnalyticGradient", AnalyticGradient, arguments=analytic_arguments, vec_env=in_tries))
register_algorithm(Algorithm("MovingGradient", MovingGradient, arguments=simulator_arguments))
register_algorithm(Algorithm("EpisodeGradient", EpisodeGradient, exporter=averaged_actor, arguments=episode_arguments))
register_algorithm(
    Algorithm("Imitation", Imitation, exporter=averaged_actor, arguments=imitation_arguments, vec_env=answered)
)
register_algorithm(Algorithm("RandomArmGradient", RandomArmGradient, arguments=simulator_arguments))
