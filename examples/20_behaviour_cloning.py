"""Prints how often a network reaches fresh goals that learned from recorded solutions.

    python examples/20_behaviour_cloning.py

The closed form of the UR5 is recorded as a Minari dataset, as `kinreach demonstrate`
does, and a network is fitted to its actions. It is tested on goals that are not in the
dataset. Needs the extras `minari` and `train`.
"""

import os
import tempfile

import minari
import numpy as np
import torch

from kinreach.compare import demonstrate, wilson_interval

if __name__ == "__main__":
    folder = tempfile.TemporaryDirectory()
    os.environ["MINARI_DATASETS_PATH"] = folder.name  # your own stay as they are
    options = {"backend": "kinematic"}
    demonstrate(
        "ur5", "closed-form", "ur5/closed-form-v0", episodes=200, options=options
    )
    dataset = minari.load_dataset("ur5/closed-form-v0")
    episodes = [
        one for one in dataset.iterate_episodes() if one.infos["is_success"][-1]
    ]
    seen = torch.tensor(np.concatenate([one.observations[:-1] for one in episodes]))
    actions = torch.tensor(np.concatenate([one.actions for one in episodes]))

    torch.manual_seed(0)
    torch.set_num_threads(1)
    network = torch.nn.Sequential(
        torch.nn.Linear(seen.shape[1], 64),
        torch.nn.Tanh(),
        torch.nn.Linear(64, actions.shape[1]),
    ).double()
    optimizer = torch.optim.LBFGS(
        network.parameters(), max_iter=200, line_search_fn="strong_wolfe"
    )

    def loss() -> torch.Tensor:
        """Return the mean squared error, with its gradients."""
        optimizer.zero_grad()
        value = torch.nn.functional.mse_loss(network(seen), actions)
        value.backward()
        return value

    optimizer.step(loss)

    env, trials = dataset.recover_environment(), []
    for index in range(200):  # each is one action
        observation, _ = env.reset(seed=2**41 + index)
        with torch.no_grad():
            action = network(torch.as_tensor(observation)).numpy()
        trials.append(env.step(action)[-1])
    reached = sum(bool(trial["is_success"]) for trial in trials)
    low, high = wilson_interval(reached, len(trials))
    distance = 1000 * np.median([trial["distance"] for trial in trials])
    print(f"learned from {len(episodes)} episodes")
    share = f"{100 * low:.0f} to {100 * high:.0f} %"
    print(f"fresh goals reached: {reached} of {len(trials)}, {share}")
    print(f"median distance: {distance:.1f} mm")
