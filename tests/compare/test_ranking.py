"""Who is best is said by paired tests on the same goals, as scipy has them, and only where it matters."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binomtest

from kinreach._statistics import paired_p, wilson_interval
from kinreach.compare._ranking import MIN_GOALS, PARTS, RESOLVED_MM, RESOLVED_TIME, Ranking, p_text, part_of
from kinreach.compare._runner import prepare, results_of
from kinreach.compare._task import get_task

CASES = 200


def ranking(*methods, ranked=("distance_mm", "decision_ms", "solve_ms"), task="arm3"):
    """Of made-up methods: name, whether each goal is reached, distances [m] and times [s] of each goal."""
    trials = [
        {
            "goal": [0.1, 0.0, 0.0], "q": [0.1], "impossible": False, "status": "completed", "impossible_reason": "",
            "move_s": 1.0, "steps": 1, "reward": 0.0, "return": 0.0, "is_success": bool(reached), "goal_index": goal,
            "method": name, "reached": bool(reached), "distance": float(distance), "solve_s": float(time),
        }
        for name, *columns in methods
        for goal, (reached, distance, time) in enumerate(zip(*np.broadcast_arrays(*columns), strict=True))
    ]  # fmt: skip
    own = replace(get_task(task), ranked=ranked)
    known = dict.fromkeys((name for name, *_ in methods), next(iter(own.methods.values())))
    goals = len(trials) // len(methods)
    comparison = prepare(
        own, known, goals=goals, seed=0, arm=None, observation=None, options=None, command=""
    )  # fmt: skip
    return Ranking(own, results_of(comparison, trials), trials)


def test_p_values_are_those_of_scipy():
    """McNemar's exact test is the binomial test of what only one of two reached; and symmetric."""
    cases = 0
    for seed in range(CASES):
        rng = np.random.default_rng(seed)
        better, worse = (int(count) for count in rng.integers(0, 40, 2))
        if better + worse:
            assert paired_p(better, worse) == binomtest(better, better + worse).pvalue
        assert paired_p(better, worse) == pytest.approx(paired_p(worse, better))
        cases += 1
    assert cases == CASES
    assert paired_p(0, 0) == 1.0
    assert paired_p(8, 1) == pytest.approx(20 / 512)  # p 0.04, where Wilson's intervals of 15 and 8 of 30 overlap


@pytest.mark.slow
def test_goals_reached_are_told_apart_by_what_only_one_reached():
    apart = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        shares = rng.uniform(0.2, 0.9, 3)
        reached = rng.random((3, 60)) < shares[:, None]
        reached[1] = np.where(rng.random(60) < 0.8, reached[0], reached[1])  # as goals are hard for all
        found = ranking(*((f"m{i}", row, 1e-3, 1e-3) for i, row in enumerate(reached)))
        best = max(range(3), key=lambda i: reached[i].sum())
        for name, test in found.reached.items():
            mine, other = reached[int(name[1])], reached[int(test.best[1])]
            only, others = int((mine & ~other).sum()), int((~mine & other).sum())
            assert (test.better, test.worse) == (only, others)
            assert test.p == (binomtest(only, only + others).pvalue if only + others else 1.0)
            assert test.same == (test.p >= 0.05 and mine.any())
            apart += not test.same
        assert reached[best].sum() == reached[int(next(iter(found.reached))[1])].sum()
        assert {entry["name"] for entry in found.reaching} == {n for n, test in found.reached.items() if test.same}
    assert apart > 5


def test_eight_goals_to_one_separate_two_methods_whose_intervals_overlap():
    a, b = np.arange(30) < 15, (np.arange(30) >= 8) & (np.arange(30) < 16)
    (low, _), (_, high) = wilson_interval(15, 30), wilson_interval(8, 30)
    assert low < high
    found = ranking(("a", a, 1e-3, 1e-3), ("b", b, 1e-3, 1e-3))
    assert found.finding() == [
        "a reaches 50.0 % of 30 goals.",
        "Not ranked, because fewer goals are reached: b (26.7 %, p = 0.039).",
    ]
    assert found.reached["b"].words(reached=True) == "reached only here: 1, only by a: 8; McNemar's exact p = 0.039"


@pytest.mark.slow
def test_distances_are_told_apart_by_the_sign_test_and_by_what_is_resolved():
    """Among methods that reach as many goals as any; as scipy's binomial test of signs, ties left out."""
    apart = close = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        shift = rng.choice([1e-6, 2e-5, 5e-5, 1e-4])
        first = rng.uniform(1e-5, 5e-4, 40)
        second = first + shift * (rng.random(40) < rng.uniform(0.3, 1.0)) * rng.choice([-1, 1, 1, 1], 40)
        found = ranking(("a", True, first, 1e-3), ("b", True, np.abs(second), 1e-3))
        tests = found.measured("distance_mm")
        values = {"a": 1e3 * first, "b": 1e3 * np.abs(second)}
        best, other = tests
        assert np.median(values[best]) <= np.median(values[other])
        better, worse = (values[other] < values[best]).sum(), (values[other] > values[best]).sum()
        assert tests[other][1:3] == (better, worse)
        assert tests[other].p == (binomtest(better, better + worse).pvalue if better + worse else 1.0)
        resolved = np.median(values[other]) - np.median(values[best]) >= RESOLVED_MM
        assert tests[other].same == (tests[other].p >= 0.05 or not resolved)
        apart += not tests[other].same
        close += tests[other].same and tests[other].p < 0.05
    assert apart > 2
    assert close > 2  # a micrometre makes no winner, however sure its sign is


def test_the_finding_names_no_winner_among_equals():
    near = np.full(20, 37e-6)
    far = ranking(("a", True, near, 1e-3), ("b", True, near + 6e-6, 1.05e-3), ("c", True, near + 1e-3, 4e-3))
    assert far.finding() == [
        "All 3 methods reach every one of 20 goals.",
        "a and b come nearest, indistinguishable: 0.037 to 0.043 mm in the median.",
        "a and b decide fastest, indistinguishable: 1.00 to 1.05 ms in the median.",
    ]
    assert far.measured("solve_ms")["b"].p < 0.05
    assert RESOLVED_TIME > 0.05
    only = ranking(("a", True, near, 1e-3), ("c", True, near + 1e-3, 4e-3))
    assert only.finding()[1:] == [
        "a comes nearest: 0.037 mm in the median.",
        "a decides fastest: 1.00 ms in the median.",
    ]
    words = only.measured("distance_mm")["c"].words(reached=False)
    assert words == "smaller than a's on 0 goals, larger on 20; sign test p < 0.001"


def test_only_methods_that_reach_are_ranked_and_only_by_what_the_task_counts():
    bad = np.arange(40) < 18
    found = ranking(("good", bad > -1, 5e-3, 1e-3), ("almost", np.arange(40) > 0, 6e-3, 1e-3), ("bad", bad, 1e-6, 1e-6))
    said = found.finding()
    assert said[0] == "good reaches every one of 40 goals; almost (97.5 %, p = 1) is indistinguishable."
    assert said[1] == "good comes nearest: 5.00 mm in the median."
    assert said[-1] == "Not ranked, because fewer goals are reached: bad (45.0 %, p < 0.001)."
    assert found.best("distance_mm") == ["good"]
    near = np.full(9, 1e-3)
    pressed = ranking(("a", True, near, 1e-3), ("b", True, 40 * near, 1e-3), ranked=())
    assert pressed.finding() == ["Both methods reach every one of 9 goals."]
    assert pressed.measured("distance_mm") == {}
    assert get_task("button").ranked == ("decision_ms",)  # any press within 50 mm counts


def test_no_test_can_tell_methods_apart_by_fewer_goals():
    assert paired_p(MIN_GOALS, 0) < 0.05 < paired_p(MIN_GOALS - 1, 0)


def test_of_one_goal_there_are_no_percentages():
    found = ranking(("a", [True], 1e-3, 1e-3), ("b", [False], 1e-3, 1e-3))
    assert found.finding()[:2] == ["a reaches the goal.", "b reaches fewer."]
    column = next(column for column in found.task.columns if column.key == "reached")
    assert [column.text(entry, "interval") for entry in found.results["methods"]] == ["yes", "no"]
    assert "%" not in column.text({**found.results["methods"][0], "goals": 9}, "interval", count=1)


def test_no_method_that_reaches_is_a_sentence():
    assert ranking(("a", np.zeros(9), 1.0, 1.0), ("b", np.zeros(9), 1.0, 1.0)).finding() == [
        "No method reaches any of 9 goals."
    ]
    one = ranking(("a", [True, True, True], 1.0, 1.0), ("b", [False, False, False], 1.0, 1.0))
    assert one.finding()[1:] == ["b reaches fewer.", "It takes 6 goals or more to tell methods apart."]
    found = ranking(("a", True, 1.0, [1.0, 2.0]))
    unknown = replace(found, results={**found.results, "methods": [{"name": "a", "reached": None}]})
    assert unknown.finding() == []


def test_methods_are_grouped():
    entries = [
        {"name": "thesis-ppo-single", "kind": "policy"}, {"name": "random", "kind": "chance"},
        {"name": "ppo", "kind": "policy"}, {"name": "lm", "kind": "solver"},
        {"name": "hybrid", "kind": "seeded solver"},
    ]  # fmt: skip
    ordered = [entry["name"] for entry in sorted(entries, key=part_of)]
    assert ordered == ["lm", "hybrid", "ppo", "thesis-ppo-single", "random"]
    assert {PARTS[part_of(entry)] for entry in entries} == set(PARTS)


def test_p_values_are_short():
    assert [p_text(p) for p in (1.0, 0.0391, 0.001, 2e-5)] == ["p = 1", "p = 0.039", "p = 0.001", "p < 0.001"]
