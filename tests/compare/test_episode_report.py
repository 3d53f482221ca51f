"""What is reported of episodes: numbers, table and figures from episodes whose numbers are known."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from kinreach.compare.button.contest import ButtonContest
from kinreach.compare.button.figures import draw_episodes, draw_pressed
from kinreach.compare.button.summary import summarise
from kinreach.compare.tables import TABLE_WIDTH
from kinreach.compare.trials import EpisodeTrial
from kinreach.statistics import wilson_interval

Make = Callable[..., list[EpisodeTrial]]

UNPRESSED = {"reached": False, "status": "not pressed", "move_s": None, "distance": 0.7, "steps": 100}


@pytest.fixture
def trials(make_episodes: Make) -> list[EpisodeTrial]:
    """Ten of a good method, eight of which are pressed; and ten of chance, none of which is."""
    good = [replace(trial, steps=20 + trial.goal, move_s=0.8 + 0.04 * trial.goal) for trial in make_episodes(10)]
    good[8:] = [replace(trial, wrong_presses=5, **UNPRESSED) for trial in good[8:]]
    return [*good, *make_episodes(10, method="random", wrong_presses=50, energy=7000.0, reward=-130.0, **UNPRESSED)]


@pytest.fixture
def results(trials: list[EpisodeTrial]) -> dict[str, Any]:
    names = {"analytic": "controller", "random": "chance"}
    settings = {
        "task": "button", "goals": 10, "seed": 0, "command": "python -m kinreach.compare --task button",
        "episode": {"max_steps": 100, "actuation": "tuned"}, "terms": {"reached": "pressed"},
    }  # fmt: skip
    return {
        "methods": [summarise(name, kind, [t for t in trials if t.method == name]) for name, kind in names.items()],
        "settings": settings,
    }


def test_the_numbers_by_hand(results: dict[str, Any]) -> None:
    good, chance = results["methods"]
    assert (good["name"], good["kind"], good["goals"]) == ("analytic", "controller", 10)
    assert good["pressed"] == good["reached"] == 0.8
    assert good["pressed_ci"] == good["reached_ci"] == list(wilson_interval(8, 10))
    assert good["success_at_mm"] == {"50": 0.8, "20": 0.0, "10": 0.0, "5": 0.0, "2": 0.0, "1": 0.0, "0.5": 0.0}
    assert good["outcomes"] == {"pressed": 8, "not pressed": 2}
    assert good["steps"]["mean"] == pytest.approx((sum(range(20, 28)) + 200) / 10)
    assert good["steps"]["median"] == 24.5
    assert good["wrong_presses"] == {"median": 0.0, "p95": 5.0, "mean": 1.0}
    assert good["move_s"]["median"] == pytest.approx(0.94)  # of those that were pressed
    assert good["energy"]["mean"] == pytest.approx(900.0)
    assert good["solve_ms"]["median"] == pytest.approx(4.0)
    assert good["decision_ms"]["median"] == pytest.approx(np.median([4.0 / n for n in (*range(20, 28), 100, 100)]))
    assert good["impossible"] == chance["impossible"] == 0.0
    assert chance["move_s"] == chance["move_s_ci"] == {"median": None, "p95": None}
    assert chance["reward_mean"] == -130.0


def test_intervals_hold_their_estimates(results: dict[str, Any]) -> None:
    checked = 0
    for key in ("steps", "wrong_presses"):
        for name, value in results["methods"][0][key].items():
            low, high = results["methods"][0][f"{key}_ci"][name]
            assert low <= value <= high
            assert low < high
            checked += 1
    assert checked == 6


def test_a_press_that_diverged_nearby_is_no_success(make_episodes: Make) -> None:
    lost = make_episodes(3, impossible=True, reached=False, status="diverged", distance=0.001, move_s=None)
    summary = summarise("random", "chance", lost)
    assert set(summary["success_at_mm"].values()) == {0.0}
    assert summary["impossible"] == 1.0


def _lines(results: dict[str, Any], width: int) -> list[str]:
    console = Console(width=width, file=io.StringIO(), highlight=False)
    (table,) = ButtonContest.tables(results, title="a title")
    console.print(table)
    return [line.rstrip() for line in console.file.getvalue().splitlines()]  # type: ignore[attr-defined]


def test_the_table_has_every_number_and_fits(results: dict[str, Any]) -> None:
    lines = _lines(results, TABLE_WIDTH)
    assert max(map(len, lines)) <= TABLE_WIDTH
    assert lines == _lines(results, 400)
    rows = [" ".join(line.split()) for line in lines[-2:]]
    assert rows == [
        "analytic 80.0 [49.0, 94.3] 24 / 100 0.94 1.00 900 0.16 / 0.20 85.0",
        "random 0.0 [0.0, 27.8] 100 / 100 - 50.0 7000 0.040 / 0.040 -130",
    ]
    wide = [method | {"name": "thesis-ppo-of-somebody", "pressed_ci": [1.0, 1.0]} for method in results["methods"]]
    assert max(map(len, _lines(results | {"methods": wide}, 400))) <= TABLE_WIDTH + 8


def test_notes_say_how_long_episodes_are_and_fit(results: dict[str, Any]) -> None:
    notes = ButtonContest.notes(results)
    assert max(map(len, notes)) <= TABLE_WIDTH
    said = " ".join(notes)
    assert all(part in said for part in ("10 goals, seed 0", "at most 100 steps", "actuation tuned", "d < 50 mm"))
    assert "diverged" not in said
    results["methods"][1]["outcomes"] = {"not pressed": 7, "diverged": 3}
    assert ButtonContest.notes(results)[0] == "The simulation diverged for random: 3 episodes."


def test_curves_rise_at_the_steps_of_the_presses(trials: list[EpisodeTrial], results: dict[str, Any]) -> None:
    (axes,) = draw_pressed(trials, results).axes
    good, chance = (line for line in axes.lines if len(line.get_xdata()) > 1)
    assert list(good.get_xdata()) == [0, *range(20, 28), 100]
    assert list(good.get_ydata()) == pytest.approx([0, 10, 20, 30, 40, 50, 60, 70, 80, 80])
    assert (list(chance.get_xdata()), list(chance.get_ydata())) == ([0, 100], [0, 0])
    assert {text.get_text() for text in axes.texts} >= {"analytic", "random"}
    assert axes.get_xlabel() == "steps of the episode, 40 ms each"


def test_every_episode_is_a_dot_in_each_of_the_four(trials: list[EpisodeTrial], results: dict[str, Any]) -> None:
    panels = draw_episodes(trials, results).axes
    assert len(panels) == 4
    for axes in panels:
        assert [len(dots.get_offsets()) for dots in axes.collections] == [10, 10]
        low, high = axes.get_xlim()
        for dots in axes.collections:
            x = dots.get_offsets()[:, 0]
            assert low <= x.min() <= x.max() <= high
    said = {text.get_text() for axes in panels for text in axes.texts}
    assert {"median 0 · p95 5", "median 50 · p95 50", "median 7000 · p95 7000"} <= said


@pytest.mark.parametrize("reached", [True, False])
def test_an_end_is_shown_as_the_episode_left_it(make_episodes: Make, results: dict[str, Any], reached: bool) -> None:
    stage = ButtonContest.stage(results)
    (trial,) = make_episodes(1, wrong_presses=2, **({} if reached else UNPRESSED))
    assert stage.show(trial) == [f"{trial.status} after {trial.steps} steps", "wrong presses: 2"]
    assert stage.data.qpos == pytest.approx(trial.q)
    places = {
        name: stage.data.mocap_pos[stage.model.body(name).mocapid[0]]
        for name in ("ball", "button", "button_pressed", "button_idle")
    }
    shown = {name for name, place in places.items() if tuple(place) == (trial.x, trial.y, trial.z)}
    assert shown == {"ball", "button", "button_pressed" if reached else "button_idle"}
