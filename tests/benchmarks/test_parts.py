"""Studies made of parts: their order is that of the parts, whichever is done first and wherever."""

from argparse import Namespace
from contextlib import contextmanager

import pytest

from benchmarks.studies import parts
from benchmarks.studies.parts import each
from kinreach.errors import InputError


def squared(number, more):
    return number**2 + more


PARTS = [(number, 1) for number in range(7)]


def test_here_one_comes_after_the_other():
    assert list(each(Namespace(engine="serial", address=None), squared, PARTS)) == [squared(*part) for part in PARTS]


def test_values_wait_for_those_before_them(monkeypatch):
    class Backwards:
        """An engine whose last job is done first."""

        def split(self, parts, least):
            return [parts[first : first + 2] for first in range(0, len(parts), 2)]

        def map(self, function, jobs):
            for number in reversed(range(len(jobs))):
                for value in function(jobs[number]):
                    yield number, value

    monkeypatch.setattr(parts, "open_engine", contextmanager(lambda name, address: iter([Backwards()])))
    assert list(each(Namespace(engine="any", address=None), squared, PARTS)) == [squared(*part) for part in PARTS]


def test_an_address_needs_an_engine():
    with pytest.raises(InputError, match="an address is that of a Ray cluster"):
        list(each(Namespace(engine="serial", address="h:1"), squared, PARTS))
