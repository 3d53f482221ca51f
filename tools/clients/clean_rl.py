"""CleanRL: its `ppo_continuous_action.py` as published, on the multi-step task.

The script (1.2.0) was written for Gymnasium before 1.0. The one thing that it does not know is given to it here:
`TransformObservation` asks for the space that comes out.
"""

import os
import runpy
import sys
import warnings
from pathlib import Path
from tempfile import TemporaryDirectory

import gymnasium as gym
import numpy as np
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

ID = "kinreach:kinreach/UR5MultiStepKinematic-v0"
transform = gym.wrappers.TransformObservation

if __name__ == "__main__":
    warnings.simplefilter("ignore")
    gym.wrappers.TransformObservation = lambda env, change: transform(env, change, env.observation_space)
    with TemporaryDirectory() as folder:
        os.chdir(folder)
        settings = {"env-id": ID, "total-timesteps": 2048, "num-envs": 2, "num-steps": 256, "exp-name": "ppo"}
        sys.argv = ["ppo", *(f"--{name}={value}" for name, value in settings.items())]
        runpy.run_module("cleanrl.ppo_continuous_action", run_name="__main__")
        events = EventAccumulator(str(next(Path(folder).rglob("events*")).parent))
        events.Reload()
        logged = {name: [event.value for event in events.Scalars(name)] for name in events.Tags()["scalars"]}
        os.chdir("/")
    updates = len(logged["losses/value_loss"])
    assert updates == 4
    assert all(np.isfinite(values).all() for values in logged.values())
    print(f"2048 steps, {updates} updates; explained variance {logged['losses/explained_variance'][-1]:.2f}")
