"""Flags from dataclasses of options: what becomes one, and what does not."""

from dataclasses import field, make_dataclass

import gymnasium as gym
import pytest

from kinreach._registration import SINGLE
from kinreach.compare.inside import OptionFlags
from kinreach.errors import InputError
from tests.compare.conftest import TOY, ToyEnv


@pytest.fixture
def register():
    """Register an environment with a class of options; return its id."""
    names = []

    def add(entry_point):
        names.append(f"tests/Options{len(names)}-v0")
        gym.register(names[-1], entry_point=entry_point)
        return names[-1]

    yield add
    for name in names:
        gym.registry.pop(name)


def with_options(*fields):
    return type("WithOptions", (ToyEnv,), {"Options": make_dataclass("Given", fields)})


@pytest.mark.parametrize(
    "entry_point", ["no_such_module:Env", "math:Env", ToyEnv, type("E", (ToyEnv,), {"Options": 3})]
)
def test_environments_without_a_dataclass_have_no_flags(entry_point, register):
    assert dict(OptionFlags(register(entry_point), {})) == {}


def test_unknown_environments_have_no_flags():
    for name in ("kinreach/Nope-v0", "no_such_module:kinreach/Nope-v0", TOY):
        assert dict(OptionFlags(name, {})) == {}
    assert list(OptionFlags(SINGLE, {})) == list(OptionFlags(f"kinreach:{SINGLE}", {})) != []


@pytest.mark.parametrize(("hint", "text", "value"), [
    (int, "-3", -3), (float, "1e-3", 1e-3), (str, "a b", "a b"), (bool, "True", True), (int | None, "7", 7),
    (tuple[int, ...], "1,2", (1, 2)), (list[float], "0.5", (0.5,)), (tuple[str, str], "a,b", ("a", "b")),
])  # fmt: skip
def test_values_are_parsed_by_the_type(hint, text, value, register):
    name = register(with_options(("mine", hint, field(default=None))))
    flags = OptionFlags(name, {})
    assert flags.options({"mine": text}) == {"mine": value}
    assert flags["mine"].help == ""


@pytest.mark.parametrize("hint", [object, dict[str, int], int | str, tuple[bool, ...], tuple[int, str], "list[ToyEnv]"])
def test_other_types_have_no_flag(hint, register):
    kind = with_options(("mine", hint, field(default=None)), ("other", int, 3))
    kind.Options.__module__ = __name__
    assert list(OptionFlags(register(kind), {})) == ["other"]


def test_a_type_that_is_not_defined_is_one_sentence(register):
    with pytest.raises(
        InputError, match=r"the types of Given, options of tests/Options0-v0, cannot be read: .*Nowhere"
    ):
        OptionFlags(register(with_options(("mine", "Nowhere", 3))), {})


def test_flags_of_the_command_and_hidden_ones_are_left_out(register):
    fields = [("goals", int, 3), ("mine", int, 3), ("own", int, field(default=3, metadata={"flag": None}))]
    assert list(OptionFlags(register(with_options(*fields)), {}, taken=["goals"])) == ["mine"]
