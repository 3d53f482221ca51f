"""The server behind the page: one for all tabs, on this machine only."""

from __future__ import annotations

import contextlib
import io
import logging
import threading
import warnings
from typing import Any

from kinreach.errors import InstallationError, OutputError
from kinreach.view.page import Page
from kinreach.view.setup import Setup

#: The only address that is listened to: who is not on this machine cannot connect.
HOST = "127.0.0.1"
#: What viser warns of where a tab is closed while something is drawn in it, which is no fault.
CLOSED = r"Queued a \w+ on a closed connection"


def import_viser() -> Any:
    """viser, which only the page needs.

    Raises:
        InstallationError: It is missing.
    """
    try:
        import viser
    except ImportError as error:
        raise InstallationError(f"{error}; the page needs: pip install 'kinreach[view]'") from error
    return viser


class Server:
    """Serves a page to every tab that asks.

    Args:
        setup: What every tab begins with.
        port: Where to listen; if it is taken, the next that is free.

    Attributes:
        pages: Of the open tabs, by viser's number of the client.

    Raises:
        InstallationError: viser is missing.
        OutputError: There is no free port.
    """

    def __init__(self, setup: Setup, *, port: int = 8080) -> None:
        viser = import_viser()
        setup.figure  # noqa: B018  (read before the first tab asks)
        self._setup = setup
        self.pages: dict[int, Page] = {}
        self._closed: set[int] = set()
        self._lock = threading.Lock()
        warnings.filterwarnings("ignore", message=CLOSED)
        logging.getLogger("websockets.server").setLevel(logging.CRITICAL)  # browsers open connections in advance
        try:
            with contextlib.redirect_stdout(io.StringIO()):  # viser says where it listens, in its own words
                self._viser = viser.ViserServer(
                    host=HOST, port=port, label=f"kinreach: {setup.arm.name}", verbose=False
                )
        except OSError as error:
            raise OutputError(f"no port can be listened to from {port} on: {error}") from error

        self._viser.on_client_connect(self._opened)
        self._viser.on_client_disconnect(self._left)

    @property
    def address(self) -> str:
        """Where the page is."""
        return f"http://{HOST}:{self._viser.get_port()}"

    def stop(self) -> None:
        """Close all tabs' connections and stop listening."""
        for number in list(self.pages):
            self.pages.pop(number).close()
        with contextlib.redirect_stdout(io.StringIO()):
            self._viser.stop()

    def _is_own(self, client: Any) -> bool:
        """Whether a tab shows this server's page; browsers let those of other sites connect, and say who they are."""
        connection = self._viser._websock_server._live_connections.get(client.client_id)
        origin = None if connection is None else connection.request.headers.get("Origin")
        return origin in (None, self.address, self.address.replace(HOST, "localhost"))

    def _opened(self, client: Any) -> None:
        if not self._is_own(client):
            return
        page = Page(client, self._setup)
        with self._lock:
            left = client.client_id in self._closed
            self._closed.discard(client.client_id)
            if not left:
                self.pages[client.client_id] = page
        if left:
            page.close()

    def _left(self, client: Any) -> None:
        with self._lock:
            page = self.pages.pop(client.client_id, None)
            if page is None:  # closed before it was drawn
                self._closed.add(client.client_id)
        if page is not None:
            page.close()
