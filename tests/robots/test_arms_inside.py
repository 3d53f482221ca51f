"""How arms are registered, in their parts."""

from __future__ import annotations

from dataclasses import replace

import pytest

from kinreach.errors import InputError
from kinreach.robots import (
    _registry,
    arm_names,
    get_arm,
    register_arm,
)


def test_an_arm_that_is_registered_is_found_by_its_name(monkeypatch):
    """Again and again, but no other one under the same name."""
    monkeypatch.setattr(_registry, "_ARMS", dict(_registry._ARMS))
    mine = replace(get_arm("ur5-thesis"), name="my-arm")
    assert register_arm(mine) is register_arm(mine) is mine
    assert get_arm("My-Arm") is mine
    assert "my-arm" in arm_names()
    for other in (replace(mine), replace(mine, title="other")):
        with pytest.raises(InputError, match="an arm named 'my-arm' is registered already"):
            register_arm(other)
    assert get_arm("my-arm") is mine
