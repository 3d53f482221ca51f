"""Build the environments and the model of a recipe, and check before the training that the model can be exported."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any

from stable_baselines3.common.base_class import BaseAlgorithm

from kinreach._checks import check_known
from kinreach._objects import load_object, place_of
from kinreach.baselines._algorithms import ALGORITHMS, Algorithm
from kinreach.baselines._batch import make_batch
from kinreach.baselines._learning_curve import LearningCurve
from kinreach.baselines._policies import LearnedPolicy
from kinreach.baselines._policy_file import Network
from kinreach.baselines._ranked_ppo import AdaptiveRate
from kinreach.baselines._recipes import Recipe
from kinreach.baselines._rewards import training_reward
from kinreach.baselines._sb3_export import check_export, check_trainable, set_actor
from kinreach.baselines._vec_envs import SB3VecEnv
from kinreach.errors import InputError, KinreachError


@dataclass(frozen=True, eq=False)
class Trainee:
    """A model with its environments; `curve` is the batch beneath them, which records the learning curve."""

    model: BaseAlgorithm
    env: SB3VecEnv
    curve: LearningCurve
    algorithm: Algorithm

    @property
    def network(self) -> Network:
        """The actor without noise, in the package's form."""
        return self.algorithm.exporter(self.model)


def build(recipe: Recipe, seed: int, *, steps: int, start: LearnedPolicy | None = None) -> Trainee:
    """Make a model and its environments.

    Args:
        recipe: What to train.
        seed: Of the networks.
        steps: Planned actions, to which schedules refer.
        start: Policy with whose weights the actor begins.
    """
    check_known("algorithm", recipe.algorithm, ALGORITHMS)
    algorithm = ALGORITHMS[recipe.algorithm]
    reward = training_reward(recipe.reward)
    recipe = replace(recipe, settings={**algorithm.defaults, **recipe.settings})
    recipe = recipe if start is None else replace(recipe, settings=_late(recipe.settings))
    make = load_object("algorithm", algorithm.model) if isinstance(algorithm.model, str) else algorithm.model
    with ExitStack() as opened:
        batch = make_batch(recipe.environment, recipe.num_envs, recipe.options)
        opened.callback(batch.close)
        check_trainable(batch.single_observation_space, batch.single_action_space)
        curve = LearningCurve(batch, window=recipe.window, trace_after=recipe.trace_after)
        try:
            env = algorithm.vec_env(curve, recipe, reward)
            opened.callback(env.close)
            arguments = algorithm.arguments(recipe, env, steps)
            model = make(env=env, seed=seed, device="cpu", verbose=0, **arguments)
        except KinreachError:
            raise
        except KeyError as error:
            raise InputError(f"{recipe.algorithm} needs the setting {error}, which {recipe.name} lacks") from error
        except Exception as error:  # of the algorithm, about its settings or the spaces
            raise InputError(f"{recipe.algorithm} does not take the settings of {recipe.name}: {error}") from error
        trainee = Trainee(model, env, curve, algorithm)
        check_export(model, _exported(trainee), algorithm.name, seen=env.seen)
        if start is not None:
            _begin_with(trainee, start, recipe)
        opened.pop_all()  # the trainee's to close
    return trainee


def _late(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings with schedules as late in a training; noise and steps of its beginning undo what a policy knows.

    The adaptive rate begins at its lowest, and grows as long as updates change the actor little.
    """
    changed = dict(settings)
    if exploration := settings.get("exploration"):
        changed["exploration"] = {**exploration, "first": exploration["last"]}
    if adaptive := settings.get("adaptive"):
        changed["adaptive"] = {**adaptive, "first": adaptive.get("lowest", AdaptiveRate.lowest)}
    return changed


def _begin_with(trainee: Trainee, start: LearnedPolicy, recipe: Recipe) -> None:
    model: Any = trainee.model
    try:
        for policy in (model.policy, getattr(model, "average", None)):
            if policy is not None:
                set_actor(model, policy, start.network)
        check_export(model, trainee.network, trainee.algorithm.name, seen=trainee.env.seen)
    except InputError as error:
        raise InputError(f"{start.name} cannot begin the training of {recipe.name}: {error}") from None


def _exported(trainee: Trainee) -> Network:
    """Return the actor; refuse what is no model, and exporters that fail."""
    model, name = trainee.model, trainee.algorithm.name
    if not isinstance(model, BaseAlgorithm):
        raise InputError(
            f"{name} must be a subclass of stable-baselines3's OnPolicyAlgorithm or OffPolicyAlgorithm, got a "
            f"{type(model).__name__}"
        )
    try:
        return trainee.network
    except KinreachError:
        raise
    except Exception as why:  # of the exporter
        raise InputError(f"the exporter of {name} fails: {type(why).__name__}: {why}{place_of(why)}") from why
