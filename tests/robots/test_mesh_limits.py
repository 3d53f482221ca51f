"""How large meshes may be."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from kinreach.errors import InputError
from kinreach.robots._meshes import _collision_mesh
from kinreach.robots.inside import collision_mesh

DAE = trimesh.creation.box((0.2, 0.1, 0.06)).export(file_type="dae")


@pytest.mark.parametrize(
    ("limit", "enough", "less"), [("MAX_FACES", 24, 23), ("MAX_PLACED", 2, 1), ("MAX_COORDINATE", 0.2001, 0.1999)]
)
def test_meshes_are_as_large_as_they_may_be(tmp_path, monkeypatch, limit, enough, less):
    """Two boxes of twelve triangles at ±0.1 m, one of them in a node within the node of the other."""
    text = DAE.decode()
    geometry = text[text.index("<instance_geometry") : text.index("</instance_geometry>")] + "</instance_geometry>"
    inner = f"<node><translate>-0.2 0 0</translate>{geometry}</node>"
    (tmp_path / "two.dae").write_text(text.replace(geometry, f"<translate>0.1 0 0</translate>{geometry}{inner}"))
    for bound, good in ((enough, True), (less, False)):
        monkeypatch.setattr(f"kinreach.robots._meshes.{limit}", bound)
        _collision_mesh.cache_clear()
        if good:
            mesh = collision_mesh("package://two.dae", str(tmp_path), np.ones(3))
            np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), (0.4, 0.1, 0.06), atol=1e-6)
        else:
            with pytest.raises(InputError, match=r"more than|farther than"):
                collision_mesh("package://two.dae", str(tmp_path), np.ones(3))
