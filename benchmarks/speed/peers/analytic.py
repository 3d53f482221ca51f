"""The analytic solvers by name."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from benchmarks.speed.peers import eaik, ssik, ur_analytic
from benchmarks.speed.peers.base import IKPeer

#: Name -> maker.
ANALYTIC: dict[str, Callable[[], IKPeer]] = {
    "EAIK": eaik.make,
    "ur-analytic-ik": ur_analytic.make,
    "ssik": ssik.make,
}
#: EAIK marks some answers as approximate; they are no solutions unless they are asked for.
APPROXIMATE = "EAIK, approximate answers too"
WITH_APPROXIMATE: dict[str, Callable[[], IKPeer]] = {
    "EAIK": eaik.make,
    APPROXIMATE: partial(eaik.make, least_squares=True),
    "ur-analytic-ik": ur_analytic.make,
    "ssik": ssik.make,
}
