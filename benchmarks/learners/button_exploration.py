"""PPO that begins with an imitation of the analytic controller, in the world of the course report.

`button-report-demonstrated-frames` observes the last four steps and goes on by the report's rewards,
`button-report-demonstrated-press` by rewards of which a press is worth more than waiting. In
`button-report-demonstrated` the controls are observed, in `button-report-demonstrated-19` the 19 numbers alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from benchmarks.learners.button import (
    button_report_both,
    button_report_controls,
    button_report_frames,
    button_report_press,
)
from kinreach.baselines import Algorithm, Recipe, SB3VecEnv, register_algorithm, register_recipe
from kinreach.baselines._adaptive_ppo import AdaptivePPO
from kinreach.baselines._algorithms import adaptive_arguments
from kinreach.baselines._button_controller import ButtonController
from kinreach.envs._button.button_task import OBSERVATIONS
from kinreach.envs._button.episodes import ButtonEpisodes

#: Adam's, of the imitation.
IMITATION_RATE = 2e-3

Array = np.ndarray[Any, Any]
#: From observations and the numbers of their rows to a loss of each.
Loss = Callable[..., torch.Tensor]


class DemonstratedPPO(AdaptivePPO):
    """Imitate the analytic controller before training: its answers to what the policy itself comes to see (DAgger).

    Args:
        controller: Answers.
        world: The episodes of the batch; the controller always sees their controls.
        rounds: Of acting and imitating; in the first half more and more actions are the policy's, then all.
        length: Steps of a round.
        **kwargs: Of `AdaptivePPO`.
    """

    def __init__(
        self,
        *args: Any,
        controller: ButtonController,
        world: ButtonEpisodes,
        rounds: int,
        length: int,
        **kwargs: Any,
    ) -> None:
        self.controller, self.world, self.rounds, self.length = controller, world, rounds, length
        super().__init__(*args, **kwargs)

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "controller", "world"]

    def collect_rollouts(self, *args: Any, **kwargs: Any) -> bool:
        """Imitate first, once; then act."""
        if self.num_timesteps == 0:
            self._imitate()
        return super().collect_rollouts(*args, **kwargs)

    def _imitate(self) -> None:
        """Fit the actor to all answers after every round, then the critic to the last round's returns."""
        optimizer = torch.optim.Adam(self.policy.parameters())
        generator = np.random.default_rng(self.seed)
        seen, wanted = [], []
        for turn in range(self.rounds):
            own = min(2.0 * turn / self.rounds, 1.0)
            observations, answers, returns = self._round(own, generator)
            seen.append(observations)
            wanted.append(answers)
            x, y = torch.as_tensor(np.concatenate(seen)), torch.as_tensor(np.concatenate(wanted))
            rate = IMITATION_RATE * (1.0 - turn / self.rounds)
            self._fit(optimizer, rate, x, lambda some, rows, y=y: -self._log_prob(some, y[rows]))
        x, y = torch.as_tensor(observations), torch.as_tensor(returns[:, None])
        self._fit(optimizer, rate, x, lambda some, rows: (self.policy.predict_values(some) - y[rows]).square())

    def _round(self, own: float, generator: np.random.Generator) -> tuple[Array, Array, Array]:
        """Act, with a share of actions that are the policy's; return observations, answers and discounted returns."""
        env: Any = self.get_env()
        seen, wanted, rewards, ends = [], [], [], []
        for _ in range(self.length):
            seen_by_all = np.asarray(self._last_obs, dtype=np.float64)[:, :OBSERVATIONS]
            answers = self.controller.actions(np.hstack([seen_by_all, self.world._control]))
            seen.append(self._last_obs)
            wanted.append(answers)
            actions, _ = self.policy.predict(self._last_obs, deterministic=own == 1.0)
            mine = generator.random(len(answers)) < own
            self._last_obs, reward, done, _ = env.step(np.where(mine, actions, answers))
            self._last_episode_starts = done
            self.controller.restart(np.flatnonzero(done))
            rewards.append(reward)
            ends.append(done)
        returns = np.array(rewards)
        for t in reversed(range(len(returns) - 1)):
            returns[t] += self.gamma * returns[t + 1] * ~ends[t]
        return np.concatenate(seen), np.concatenate(wanted), returns.ravel()

    def _log_prob(self, observations: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        return self.policy.get_distribution(observations).log_prob(actions)

    def _fit(self, optimizer: torch.optim.Optimizer, rate: float, x: torch.Tensor, loss: Loss) -> None:
        """Go down the gradient of the mean loss, five times through all rows."""
        optimizer.param_groups[0]["lr"] = rate
        for _ in range(5):
            for rows in torch.randperm(len(x)).split(1024):
                optimizer.zero_grad()
                loss(x[rows], rows).mean().backward()
                optimizer.step()


def demonstrated_arguments(recipe: Recipe, env: SB3VecEnv, planned: int) -> dict[str, Any]:
    """Return the arguments of adaptive PPO, the episodes that it acts in, and the controller that is imitated."""
    return adaptive_arguments(recipe, env, planned) | {
        "world": env.get_attr("unwrapped")[0].episodes,
        "controller": ButtonController(recipe.options["actuation"], count=recipe.num_envs),
    }


def _recipe(
    name: str, summary: str, algorithm: str, steps: int, *, base: Recipe = button_report_controls, **settings: Any
) -> Recipe:
    settings = {**base.settings, **settings}
    return register_recipe(
        replace(base, name=name, summary=summary, algorithm=algorithm, steps=steps, settings=settings)
    )


register_algorithm(Algorithm("DemonstratedPPO", DemonstratedPPO, arguments=demonstrated_arguments))
#: Of PPO after an imitation: small steps, and no bonus for randomness.
_CAREFUL = {
    "ent_coef": 0.0,
    "clip_range": 0.2,
    "target_kl": 0.03,
    "adaptive": {"first": 3e-4, "target_kl": 0.02, "factor": 1.3, "decay": 1.0},
}
_IMITATION = {"rounds": 8, "length": 400}

button_report_imitated = _recipe(
    "button-report-imitated",
    "A policy of the last four steps that imitates the analytic controller, and one update that hardly changes it.",
    "DemonstratedPPO",
    6_400,
    base=button_report_frames,
    **_CAREFUL | _IMITATION | {"adaptive": {"first": 1e-6, "target_kl": 0.02, "factor": 1.0}},
)
button_report_demonstrated = _recipe(
    "button-report-demonstrated",
    "As `button-report-controls`, from a policy that imitates the analytic controller.",
    "DemonstratedPPO",
    200_000,
    **_CAREFUL | _IMITATION,
)
button_report_demonstrated_19 = _recipe(
    "button-report-demonstrated-19",
    "As `button-report-demonstrated`, with the report's own 19 observations: the controls are not among them.",
    "DemonstratedPPO",
    200_000,
    base=button_report_both,
    **_CAREFUL | _IMITATION,
)
button_report_demonstrated_frames = _recipe(
    "button-report-demonstrated-frames",
    "As `button-report-demonstrated-19`, with the last four observations side by side.",
    "DemonstratedPPO",
    200_000,
    base=button_report_frames,
    **_CAREFUL | _IMITATION,
)
button_report_demonstrated_press = _recipe(
    "button-report-demonstrated-press",
    "The same, with rewards of which waiting near the target is worth less than a press.",
    "DemonstratedPPO",
    200_000,
    base=button_report_press,
    **_CAREFUL | _IMITATION,
)
