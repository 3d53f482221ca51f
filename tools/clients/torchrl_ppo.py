"""TorchRL: its check of specifications, a vector of processes, and PPO on a native batch."""

import gymnasium as gym
import torch
from tensordict.nn import NormalParamExtractor, TensorDictModule
from torch import nn
from torchrl.envs import ExplorationType, GymEnv, GymWrapper, check_env_specs, set_exploration_type
from torchrl.modules import ProbabilisticActor, TanhNormal, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

ID = "kinreach:kinreach/UR5SingleStepKinematic-v0"
OTHERS = {
    "kinreach:kinreach/UR5MultiStepKinematic-v0": {},
    "kinreach:kinreach/ButtonPress-v0": {"info": "numbers"},
    "kinreach:kinreach/Reach-v0": {"info": "numbers"},
}
COUNT, STEPS, UPDATES = 256, 2, 20

if __name__ == "__main__":
    torch.manual_seed(0)
    for name, options in {ID: {}, **OTHERS}.items():
        check_env_specs(GymEnv(name, **options))
    processes = GymEnv(ID, num_envs=2)
    assert processes.rollout(3, break_when_any_done=False).shape == (2, 3)
    processes.close()

    env = GymWrapper(gym.make_vec(ID, num_envs=COUNT, autoreset_mode="Disabled"))
    net = nn.Sequential(nn.Linear(13, 64), nn.Tanh(), nn.Linear(64, 12), NormalParamExtractor())
    actor = ProbabilisticActor(
        TensorDictModule(net, in_keys=["observation"], out_keys=["loc", "scale"]),
        spec=env.action_spec,
        in_keys=["loc", "scale"],
        distribution_class=TanhNormal,
        return_log_prob=True,
    )
    critic = ValueOperator(nn.Sequential(nn.Linear(13, 64), nn.Tanh(), nn.Linear(64, 1)))
    advantage, loss = (
        GAE(gamma=0.0, lmbda=0.0, value_network=critic),
        ClipPPOLoss(actor, critic, normalize_advantage=True),
    )
    optimizer = torch.optim.Adam(loss.parameters(), lr=1e-3)
    rewards = []
    for _ in range(UPDATES):
        with torch.no_grad(), set_exploration_type(ExplorationType.RANDOM):
            batch = advantage(env.rollout(STEPS, actor, break_when_any_done=False))
        rewards.append(batch["next", "reward"].mean().item())
        for _ in range(8):
            losses = loss(batch.reshape(-1))
            optimizer.zero_grad()
            sum(value for key, value in losses.items() if key.startswith("loss_")).backward()
            optimizer.step()
    env.close()
    assert sum(rewards[-3:]) > sum(rewards[:3]), rewards
    print(f"{UPDATES * COUNT * STEPS} steps of a native batch: mean reward {rewards[0]:.0f} -> {rewards[-1]:.0f}")
