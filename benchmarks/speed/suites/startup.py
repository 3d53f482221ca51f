"""Time to import, memory after it, and one decision of a policy."""

from __future__ import annotations

from functools import partial

import gymnasium as gym
import numpy as np

from benchmarks.speed.child import ChildRun, peak_memory, run_child
from benchmarks.speed.measure import LAP, Contender, EachContender, interleaved, interleaved_each
from benchmarks.speed.sections import Cell, Options, Progress, Section, Target
from benchmarks.speed.tables import samples, short_of_cores, slow, time_row
from kinreach.baselines._policies import load_policy

AGAIN = "python -m benchmarks.speed --suite startup"
#: Fresh processes of each kind, at least, but with `--quick`.
STARTS = 10
PYTHON = "pass"
OURS, KINEMATICS = "import kinreach", "import kinreach.kinematics"
PROGRAMS = (
    PYTHON,
    "import numpy",
    "import gymnasium",
    OURS,
    KINEMATICS,
    "import kinreach.envs",
    "from kinreach.baselines import load_policy; load_policy('ranked-single')",
)
#: Longest starts [s], and longest decision [us].
LONGEST = {OURS: 0.3, KINEMATICS: 0.8}
DECISION_US = 50.0
SINGLE = "ranked-single"
POLICIES = (SINGLE, "ranked-multi", "button")
#: Observations that a policy decides on in a round.
OBSERVATIONS = 500

IMPORTS_TEXT = """\
Each start is a fresh process, from its creation to its end, the interpreter included; files come from the system's
cache, bytecode is compiled beforehand. Starts take turns. Memory is the most that a process held.

`import kinreach` and `import kinreach.envs` load neither numpy nor Gymnasium: names are imported on first use.
`import kinreach.kinematics` loads numpy and Pinocchio with coal, shared libraries, and no Gymnasium."""

DECISION_TEXT = """\
One observation in, one action out (`load_policy(name).act`), call by call. The networks are small and in numpy. The
last column is the time of an observation among {observations} that are decided on in one call: arithmetic. What a
single one takes beyond it is the overhead of the interpreter and of some twenty calls of numpy."""


def run(options: Options, progress: Progress) -> list[Section]:
    """Measure (`benchmarks.speed.suites.Run`)."""
    return [_imports(options, progress), _decisions(options, progress)]


def _imports(options: Options, progress: Progress) -> Section:
    starts: dict[str, list[ChildRun]] = {code: [] for code in PROGRAMS}

    def start(code: str) -> None:
        starts[code].append(run_child(["-c", code]))

    contenders = [Contender(f"`{code}`", partial(start, code), 1) for code in PROGRAMS]
    rounds = options.rounds if options.quick else max(options.rounds, STARTS)
    timings = interleaved(contenders, rounds, on_round=lambda done, of: progress("starts", done, of))
    bare = timings[f"`{PYTHON}`"]
    rows: list[list[Cell]] = []
    for code in PROGRAMS:
        seconds = timings[f"`{code}`"]
        beyond = float(1e3 * np.median(seconds - bare))
        worked = [run.processor for run in starts[code][-len(seconds) :]]
        milliseconds = (float(1e3 * value) for value in (np.median(seconds), slow(seconds), np.median(worked)))
        rows.append([f"`{code}`", *milliseconds, beyond, peak_memory(code)])
    return Section(
        title="Imports",
        text=IMPORTS_TEXT,
        columns=(
            "`python -c`",
            "wall, median [ms]",
            "worst round [ms]",
            "processor [ms]",
            "beyond a bare Python [ms]",
            "memory [MB]",
        ),
        rows=rows,
        again=AGAIN,
        targets=[
            Target(
                f"`{code}`",
                bound,
                "at most",
                float(np.median(timings[f"`{code}`"])),
                "s",
                _busy(starts[code]) or f"a bare Python alone took {np.median(bare):.2g} s of it",
            )
            for code, bound in LONGEST.items()
        ],
        samples=samples(timings),
    )


def _busy(starts: list[ChildRun]) -> str:
    share = float(np.median([run.processor / run.wall for run in starts]))
    return "" if share > 0.9 else f"of the time of a start the processor worked on it {100 * share:.0f} %: it was busy"


def _decisions(options: Options, progress: Progress) -> Section:
    contenders, batches = [], []
    for name in POLICIES:
        policy = load_policy(name)
        batch = gym.make_vec(policy.card.environment, num_envs=OBSERVATIONS, vectorization_mode="vector_entry_point")
        observations, _ = batch.reset(seed=options.seed)
        batch.close()
        contenders.append(EachContender(name, policy.act, list(np.array(observations))))
        batches.append(Contender(name, partial(policy.act, np.array(observations)), OBSERVATIONS))
    timings = interleaved_each(
        contenders, options.rounds, on_round=lambda done, rounds: progress("decisions", done, rounds)
    )
    among = interleaved(
        batches, options.rounds, lap=LAP, on_round=lambda done, rounds: progress("decisions in batches", done, rounds)
    )
    rows = [[*time_row(name, timings, 1e-6), float(1e6 * np.median(among[name]))] for name in timings]
    return Section(
        title="One decision of a policy",
        text=DECISION_TEXT.format(observations=OBSERVATIONS),
        columns=("policy", "median [us]", "p95 [us]", "cores", f"in a batch of {OBSERVATIONS} [us]"),
        rows=rows,
        again=AGAIN,
        targets=[
            Target(
                f"`load_policy({SINGLE!r}).act`, one observation",
                DECISION_US,
                "at most",
                float(1e6 * np.median(timings[SINGLE])),
                "us",
                short_of_cores(timings, SINGLE, 1),
            )
        ],
        samples=samples(timings),
    )
