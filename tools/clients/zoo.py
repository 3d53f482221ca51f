"""rl-zoo3: its command lines for training and for enjoying what was trained."""

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

ID = "kinreach/UR5SingleStepKinematic-v0"
SETTINGS = f"""
{ID}:
  n_timesteps: 1024
  n_envs: 2
  policy: MlpPolicy
  n_steps: 256
  gamma: 0.0
"""

if __name__ == "__main__":
    with TemporaryDirectory() as folder:
        (Path(folder) / "ppo.yml").write_text(SETTINGS, encoding="utf-8")
        common = ["--algo", "ppo", "--env", ID, "--gym-packages", "kinreach", "-f", "logs"]
        train = ["rl_zoo3.train", *common, "-conf", "ppo.yml", "--eval-freq", "256", "--eval-episodes", "5"]
        enjoy = ["rl_zoo3.enjoy", *common, "-n", "100", "--no-render"]
        for arguments in (train, enjoy):
            done = subprocess.run(
                [sys.executable, "-m", *arguments], cwd=folder, capture_output=True, text=True, check=False
            )
            assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
        models = sorted(path.name for path in Path(folder).rglob("*.zip"))
    means = [line for line in done.stdout.splitlines() if line.startswith("Mean reward")]
    assert models, done.stdout
    assert means, done.stdout
    print(f"train and enjoy, 1024 and 100 steps: {', '.join(models)}; {means[0]}")
