"""Boxes that are put elsewhere are, bit for bit, obstacles that were there from the start."""

from dataclasses import replace

import numpy as np
import pytest

from kinreach.errors import InputError
from kinreach.robots import Box, get_arm
from kinreach.sim import ArmSimulation
from kinreach.sim.inside import box_names, spare_boxes

ARM = get_arm("ur5-thesis")
COUNT = 6


def drawn(rng, count):
    """Boxes in front of the arm, on its table."""
    sizes = rng.uniform((0.05, 0.05, 0.1), (0.15, 0.3, 0.6), (count, 3))
    places = np.column_stack([rng.uniform(0.2, 0.7, count), rng.uniform(-0.4, 0.4, count), -0.2 + sizes[:, 2] / 2])
    return [
        Box(name, tuple(size.tolist()), tuple(place.tolist()))
        for name, size, place in zip(box_names(count), sizes, places, strict=True)
    ]


def among(boxes):
    cell = ARM.workcell
    return ArmSimulation(replace(ARM, workcell=replace(cell, obstacles=(*cell.obstacles, *boxes))))


@pytest.mark.slow
def test_moves_among_them_are_those_among_obstacles():
    rng, movable = np.random.default_rng(3), ArmSimulation(ARM, boxes=COUNT)
    touched = reached = blocked = 0
    for scene in range(6):
        boxes = drawn(rng, 1 + scene)
        fixed = among(boxes)
        movable.put_boxes(boxes)
        for _ in range(8):
            target = np.array(ARM.home) + rng.uniform(-0.6, 0.6, 6)
            for simulation in (movable, fixed):
                simulation.reset()
            one, other = movable.move(target, two_phase=False), fixed.move(target, two_phase=False)
            np.testing.assert_array_equal(one.q, other.q)
            assert (one.status, one.reason, one.duration, one.touches) == (
                other.status, other.reason, other.duration, other.touches,
            )  # fmt: skip
            reached += one.reached
            blocked += not one.reached
            touched += any(touch.other.startswith("box ") for touch in one.touches)
    assert touched >= 4
    assert min(reached, blocked) >= 4


def test_they_are_where_they_were_put_and_the_rest_far_below():
    rng, simulation = np.random.default_rng(0), ArmSimulation("arm3", boxes=COUNT)
    seen = 0
    for count in (COUNT, 2, 0, 4):
        boxes = drawn(rng, count)
        simulation.put_boxes(boxes)
        for name, box in zip(box_names(COUNT), [*boxes, *spare_boxes(COUNT)[count:]], strict=True):
            np.testing.assert_array_equal(simulation.T_world_frame(name)[:3, 3], box.position)
            np.testing.assert_array_equal(2 * simulation.model.geom(name).size, box.size)
            assert (box.position[2] > -1.0) == (box in boxes)
            seen += 1
    assert seen == 4 * COUNT
    with pytest.raises(InputError, match="the scene has 6 movable boxes, got 7"):
        simulation.put_boxes(drawn(rng, COUNT + 1))


def test_a_scene_without_them_has_none():
    simulation = ArmSimulation("arm3")
    simulation.put_boxes([])
    with pytest.raises(InputError, match="the scene has 0 movable boxes, got 1"):
        simulation.put_boxes(drawn(np.random.default_rng(0), 1))
    with pytest.raises(InputError, match="boxes must be at most"):
        ArmSimulation("arm3", boxes=101)
