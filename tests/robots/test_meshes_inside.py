"""Meshes of arms, in their parts."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from kinreach.errors import InputError
from kinreach.robots import _meshes
from tests.robots.test_meshes import BOX


def test_a_triangle_of_a_vertex_that_is_not_there_is_refused():
    """Whatever the reader makes of such a file; the first and the last vertex may be used."""
    count = len(BOX.vertices)
    for faces, good in (
        ([[0, 1, 2]], True),
        ([[0, 1, count - 1]], True),
        ([[0, 1, count]], False),
        ([[-1, 0, 1]], False),
    ):
        part = SimpleNamespace(vertices=BOX.vertices, faces=np.array(faces))
        if good:
            _meshes._check_part("'a'", part, np.eye(4), np.ones(3))
        else:
            with pytest.raises(InputError, match=r"^the mesh 'a' has a triangle of a vertex that it does not have$"):
                _meshes._check_part("'a'", part, np.eye(4), np.ones(3))
