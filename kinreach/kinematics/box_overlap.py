"""Whether boxes overlap, by separating axes (Gottschalk, Lin and Manocha, OBBTree, 1996)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Single = NDArray[np.float32]

#: x, y, z and once more x, y: so the next and the last but one axis are slices.
WRAPPED = [0, 1, 2, 0, 1]
THIS, NEXT, LAST = slice(0, 3), slice(1, 4), slice(2, 5)
#: Two edges that are parallel separate nothing; this keeps rounding from saying they do [m].
PARALLEL = 1e-6


def overlap(axes: Single, half: Single, radius: Single, offset: Single, box_half: Single) -> NDArray[np.bool_]:
    """Which rounded boxes overlap a box that lies along the coordinate axes.

    Exact where the radius is 0.

    Args:
        axes: Axes of the rounded boxes, shape (3, 3, m): axis, coordinate, box.
        half: Their half edges along them, without the rounding [m], shape (3, m).
        radius: Their rounding [m], shape (m,).
        offset: Their centres from the centre of the other box [m], shape (3, m).
        box_half: Half edges of the other boxes [m], shape (3, m).
    """
    size = np.abs(axes)
    met: NDArray[np.bool_] = (np.abs(offset) <= box_half + radius + (half[:, None] * size).sum(axis=0)).all(axis=0)
    met &= (np.abs((axes * offset).sum(axis=1)) <= half + radius + (size * box_half).sum(axis=1)).all(axis=0)
    close = np.flatnonzero(met)  # no face separates these
    met[close] = _edges_meet(*(array.take(close, axis=-1) for array in (axes, half, radius, offset, box_half)))
    return met


def _edges_meet(axes: Single, half: Single, radius: Single, offset: Single, box_half: Single) -> NDArray[np.bool_]:
    """Whether no cross product of one's own axes with the coordinate axes separates the boxes."""
    size = np.abs(axes)
    spread = radius * np.sqrt(np.maximum(1.0 - axes * axes, 0.0))
    axes, size = axes[:, WRAPPED], size[WRAPPED][:, WRAPPED]
    half, offset, box_half = half[WRAPPED, None], offset[WRAPPED], box_half[WRAPPED]
    spread += box_half[NEXT] * size[THIS, LAST]
    spread += box_half[LAST] * size[THIS, NEXT]
    spread += half[NEXT] * size[LAST, THIS]
    spread += half[LAST] * size[NEXT, THIS]
    apart = np.abs(offset[LAST] * axes[:, NEXT] - offset[NEXT] * axes[:, LAST]) > spread + PARALLEL
    met: NDArray[np.bool_] = ~apart.any(axis=(0, 1))
    return met
