"""Tianshou: PPO by its high-level interface, trained and tested in vectors of environments."""

from statistics import mean
from tempfile import TemporaryDirectory

import gymnasium as gym
from tianshou.highlevel.config import OnPolicyTrainingConfig
from tianshou.highlevel.env import EnvFactoryRegistered, VectorEnvType
from tianshou.highlevel.experiment import ExperimentConfig, PPOExperimentBuilder
from tianshou.highlevel.params.algorithm_params import PPOParams

ID = "kinreach:kinreach/UR5SingleStepKinematic-v0"


def chance(episodes: int) -> float:
    """Mean reward of random actions."""
    env = gym.make(ID)
    env.action_space.seed(0)
    seeds = range(episodes)
    return mean(env.step((env.reset(seed=seed), env.action_space.sample())[1])[1] for seed in seeds)


if __name__ == "__main__":
    environments = EnvFactoryRegistered(task=ID, venv_type=VectorEnvType.DUMMY)
    training = OnPolicyTrainingConfig(
        max_epochs=2,
        epoch_num_steps=1024,
        collection_step_num_env_steps=512,
        num_training_envs=4,
        num_test_envs=2,
        test_step_num_episodes=50,
        batch_size=128,
        update_step_num_repetitions=10,
        buffer_size=512,
    )
    with TemporaryDirectory() as folder:
        experiment = (
            PPOExperimentBuilder(environments, ExperimentConfig(persistence_base_dir=folder, watch=False), training)
            .with_ppo_params(PPOParams(gamma=0.0, lr=1e-3))
            .with_actor_factory_default((64, 64), continuous_unbounded=True)
            .with_critic_factory_default((64, 64))
            .build()
        )
        found = experiment.run(run_name="ppo").trainer_result
    before = chance(200)
    assert found is not None
    assert found.best_reward > before
    print(
        f"{found.train_step} steps: mean reward of random actions {before:.0f}, of the policy {found.best_reward:.0f}"
    )
