"""Prints settings of `ppo-single` that Optuna finds on validation goals.

    python examples/17_search.py

The budget is tiny: four trainings of a hundredth of the recipe's steps. Bad ones end
early, by the reward in the learning curve. The study is a file: the script goes on
where it was ended, and searches side by side if it is started more than once. Needs
the extra `train`, and `pip install optuna`.
"""

from dataclasses import replace
from pathlib import Path

import optuna

import kinreach  # noqa: F401  (registers the environments)
from kinreach.baselines import VALIDATION, evaluate, get_recipe, train

RECIPE, STEPS, TRIALS = get_recipe("ppo-single"), 20_480, 4


def objective(trial: optuna.Trial) -> float:
    """The median distance from 200 validation goals [mm] after a training."""
    rate = trial.suggest_float("rate", 1e-4, 1e-2, log=True)
    epochs = trial.suggest_int("n_epochs", 2, 8)
    adaptive = {**RECIPE.settings["adaptive"], "first": rate}
    recipe = replace(
        RECIPE,
        num_envs=512,
        settings={**RECIPE.settings, "n_epochs": epochs, "adaptive": adaptive},
        window=2048,
    )

    def watch(done: int, planned: int, row: dict[str, float | None]) -> None:
        trial.report(row["reward"], done)
        if trial.should_prune():
            raise optuna.TrialPruned

    folder = f"results/search/trial-{trial.number}"
    run = train(recipe, folder, steps=STEPS, fresh=True, progress=watch)
    found = evaluate(run.policy, goals=200, seed=VALIDATION, options=recipe.judged_in)
    return found.summary()["distance_mm"]["median"]


Path("results").mkdir(exist_ok=True)
optuna.logging.set_verbosity(optuna.logging.WARNING)
study = optuna.create_study(
    study_name="ppo-single",
    storage="sqlite:///results/search.db",
    load_if_exists=True,
    sampler=optuna.samplers.TPESampler(seed=0),
    pruner=optuna.pruners.MedianPruner(n_startup_trials=2),
)
study.optimize(objective, n_trials=TRIALS)
states = [trial.state.name for trial in study.trials]
print(f"{states.count('COMPLETE')} finished, {states.count('PRUNED')} ended early")
best = study.best_params
print(f"{study.best_value:.0f} mm: rate {best['rate']:.1e}, {best['n_epochs']} epochs")
