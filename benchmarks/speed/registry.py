"""The suites by name. To add one, add a line here and a module with a function `run` (`benchmarks.speed.suite.Suite`)."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

from benchmarks.speed.suite import Suite
from kinreach.checks import check_known
from kinreach.errors import InputError


@dataclass(frozen=True)
class Entry:
    """Where a suite is: a module of `benchmarks.speed.suites`, loaded when it runs, and one line of help."""

    module: str
    summary: str


SUITES = {
    "ik-single": Entry("ik_single", "inverse kinematics of one pose: all branches, and one posture near a seed"),
    "ik-edge-cases": Entry("ik_edge_cases", "singular poses: how often an analytic solver comes back empty or wrong"),
    "ik-batch": Entry("ik_batch", "inverse kinematics of 100 000 poses"),
    "fk-batch": Entry("fk_batch", "forward kinematics of 100 000 postures"),
    "env": Entry("env", "steps and resets of the environments"),
    "train": Entry("train", "training steps per second"),
    "compare": Entry("compare", "the comparison from its command line, and what its methods take to decide"),
    "startup": Entry("startup", "time and memory of imports, and one decision of a policy"),
    "growth": Entry("growth", "cost against batch size, environments and cores"),
}


def load_suite(name: str) -> Suite:
    """The module of a suite.

    Raises:
        UnknownNameError: There is no suite of this name.
    """
    check_known("suite", name, SUITES)
    return cast(Suite, importlib.import_module(f"benchmarks.speed.suites.{SUITES[name].module}"))


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
