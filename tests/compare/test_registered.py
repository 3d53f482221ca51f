"""Tasks that are registered."""

from dataclasses import replace

import pytest

from kinreach.compare import compare, register_task
from kinreach.errors import InputError


def test_a_task_from_outside_is_known_by_its_name(toy):
    register_task(toy)
    register_task(toy)  # the same again
    try:
        names = [entry["name"] for entry in compare("toy", goals=1)["methods"]]
        assert names == ["right", "near", "wild"]
        with pytest.raises(InputError, match="registered already"):
            register_task(replace(toy, title="Another"))
        with pytest.raises(InputError, match="a task must be a Task, got 'toy'"):
            register_task("toy")
    finally:
        from kinreach.compare import _task as registry

        registry._TASKS.pop("toy")
