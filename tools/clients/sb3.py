"""stable-baselines3: PPO in worker processes, its policy in kinreach's own evaluation."""

from pathlib import Path
from tempfile import TemporaryDirectory

from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import SubprocVecEnv

from kinreach.baselines import evaluate, export_policy, load_policy

ID = "kinreach:kinreach/UR5SingleStepKinematic-v0"

if __name__ == "__main__":
    env = make_vec_env(ID, 2, seed=0, vec_env_cls=SubprocVecEnv, vec_env_kwargs={"start_method": "spawn"})
    model = PPO("MlpPolicy", env, n_steps=256, batch_size=128, gamma=0.0, learning_rate=1e-3, seed=0, device="cpu")
    test = make_vec_env(ID, 1, seed=1)
    before, _ = evaluate_policy(model, test, n_eval_episodes=100)
    model.learn(2048)
    after, _ = evaluate_policy(model, test, n_eval_episodes=100)
    with TemporaryDirectory() as folder:
        file = Path(folder) / "policy.safetensors"
        export_policy(model, file, environment=ID.removeprefix("kinreach:"))
        summary = evaluate(load_policy(file), goals=20)
    env.close()
    assert after > before, (before, after)
    print(f"2048 steps in two processes: mean reward {before:.0f} -> {after:.0f}")
    print(f"its policy file in kinreach's evaluation: {len(summary.trials)} episodes")
