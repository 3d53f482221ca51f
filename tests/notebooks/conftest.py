from __future__ import annotations

from collections.abc import Callable
from io import BytesIO

import pytest
from matplotlib.figure import Figure


@pytest.fixture
def texts() -> Callable[[Figure], list[str]]:
    """Draws a figure for good, which finds what matplotlib would only warn of, and gives everything written in it."""

    def drawn(figure: Figure) -> list[str]:
        figure.savefig(BytesIO(), format="png", dpi=50)
        return [text.get_text() for text in figure.findobj(lambda artist: hasattr(artist, "get_text"))]

    return drawn
