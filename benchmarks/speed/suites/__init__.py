"""The suites by name. A new one is a line in `SUITES` and a module with a function `run(options, progress)`."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from typing import cast

from benchmarks.speed.sections import Options, Progress, Section
from kinreach._checks import check_known
from kinreach.errors import InputError

#: Measures, telling now and then how far it is, and returns the sections of the report. Raises a `KinreachError` where
#: something that every row needs is missing; a missing peer is no error: it is named.
Run = Callable[[Options, Progress], list[Section]]

#: What the shares in the suites' texts are from: a run says nothing of them.
PROFILED = (
    "Profiles of 21 November 2026 (Intel Xeon Processor, 2 cores; Python 3.11.7, numpy 2.3.5, "
    "Pinocchio 3.8.0, MuJoCo 4.0.0)"
)


#: Name -> one line of help; the module has underscores for the hyphens, and is loaded when it runs.
SUITES = {
    "ik-single": "inverse kinematics of one pose: all branches, and one posture near a seed",
    "ik-edge-cases": "singular poses: how often an analytic solver comes back empty or wrong",
    "ik-batch": "inverse kinematics of 100 000 poses",
    "ik-calibrated": "inverse kinematics of a calibrated UR, one pose and 10 000",
    "ik-arms": "inverse kinematics of one pose of arms that are no URs, with six axes and seven",
    "fk-batch": "forward kinematics of 100 000 postures",
    "env": "steps and resets of the environments",
    "train": "training steps per second",
    "compare": "the comparison from its command line, and what its methods take to decide",
    "startup": "time and memory of imports, and one decision of a policy",
    "growth": "cost against batch size, environments and cores",
}


def load_suite(name: str) -> Run:
    """The function `run` of a suite."""
    return cast(Run, importlib.import_module(f"benchmarks.speed.suites.{name.replace('-', '_')}").run)


def chosen(names: str | None) -> tuple[str, ...]:
    """The suites of a comma-separated list, in the order of `SUITES`; all without one.

    Raises:
        UnknownNameError: There is no suite of this name.
        InputError: The list is empty.
    """
    if names is None:
        return tuple(SUITES)
    wanted: Sequence[str] = [name.strip() for name in names.split(",") if name.strip()]
    for name in wanted:
        check_known("suite", name, SUITES)
    if not wanted:
        raise InputError(f"no suite given; available: {', '.join(SUITES)}")
    return tuple(name for name in SUITES if name in wanted)
