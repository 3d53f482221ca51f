"""The server behind the page: one for all tabs, on this machine only."""

from __future__ import annotations

import contextlib
import http
import io
import logging
import re
import threading
import warnings
from collections.abc import Iterator
from html import escape
from pathlib import Path
from typing import Any

from kinreach.errors import InstallationError, OutputError
from kinreach.view._page import Page
from kinreach.view._setup import Setup

#: The address of the server; only this machine can connect.
HOST = "127.0.0.1"
#: Styles and scripts for the head of viser's page.
HEAD = Path(__file__).with_name("head.html")
#: Names of this machine in addresses of the page.
OWN_NAMES = (HOST, "localhost", "[::1]")
#: Held while viser starts a server.
_STARTING = threading.Lock()
#: Warning of viser if a tab is closed during drawing, which is not a fault.
CLOSED = r"Queued a \w+ on a closed connection"


def is_own_host(headers: Any) -> bool:
    """Check that a request names this machine, against DNS rebinding."""
    return _own_host(headers) is not None


def is_own_origin(headers: Any) -> bool:
    """Check that a request comes from a page of this server, at the same port."""
    host, origins = _own_host(headers), headers.get_all("Origin")
    return host is not None and len(origins) == 1 and origins[0] in [f"http://{name}{host[1]}" for name in OWN_NAMES]


def _own_host(headers: Any) -> re.Match[str] | None:
    """The header `Host` if it is this machine's; the port, which may be forwarded, is its group 1."""
    hosts = headers.get_all("Host")
    names = "|".join(map(re.escape, OWN_NAMES))
    return re.fullmatch(rf"(?:{names})((?::\d+)?)", hosts[0]) if len(hosts) == 1 else None


@contextlib.contextmanager
def _guarding(title: str) -> Iterator[threading.Event]:
    """Let websocket servers that start here answer only their own page; the event is set when one starts.

    The page gets its own title and head, and data that is not a message does not end the connection. viser has no
    options for this, but it calls `serve` of websockets, which has.
    """
    from viser._messages import Message
    from websockets.asyncio import server

    head = HEAD.read_text(encoding="utf-8")

    serve, guarded = server.serve, threading.Event()

    def guarded_serve(handler: Any, *arguments: Any, process_request: Any, **options: Any) -> Any:
        async def decoding(connection: Any) -> None:
            receive = connection.recv

            async def recv() -> bytes:
                while True:
                    received: bytes = await receive()
                    with contextlib.suppress(Exception):
                        Message.deserialize(received)
                        return received

            connection.recv = recv
            await handler(connection)

        def checking(connection: Any, request: Any) -> Any:
            if not is_own_host(request.headers):
                return connection.respond(http.HTTPStatus.FORBIDDEN, "This is not a name of the page.\n")
            if "Accept-Encoding" in request.headers:
                del request.headers["Accept-Encoding"]  # what is not compressed can be changed
            response = process_request(connection, request)
            if response is not None:
                response.headers["Content-Security-Policy"] = "frame-ancestors 'none'"
                if response.headers.get("Content-Type", "").startswith("text/html"):
                    response.body = _dressed(response.body.decode(), title, head).encode()
                    del response.headers["Content-Length"]
                    response.headers["Content-Length"] = str(len(response.body))
            elif not is_own_origin(request.headers):  # without a response the connection is opened
                return connection.respond(http.HTTPStatus.FORBIDDEN, "Only the page itself may connect.\n")
            return response

        guarded.set()
        return serve(decoding, *arguments, process_request=checking, **options)

    with _STARTING:
        server.serve = guarded_serve  # type: ignore[assignment, misc]
        try:
            yield guarded
        finally:
            server.serve = serve  # type: ignore[misc]


def _dressed(page: str, title: str, head: str) -> str:
    """Return viser's page with a title and more in its head."""
    named = re.sub("<title>.*?</title>", lambda _: f"<title>{escape(title)}</title>", page, count=1)
    return named.replace("</title>", f"</title>\n{head}", 1)


class Server:
    """Serve a page to every tab that connects.

    Args:
        port: To listen on; if it is taken, the next free one.

    Attributes:
        pages: Of the open tabs, by viser's number of the client.
    """

    def __init__(self, setup: Setup, *, port: int = 8080) -> None:
        try:
            import viser
        except ImportError as error:
            raise InstallationError(f"{error}; the page needs: pip install 'kinreach[view]'") from error
        setup.figure  # noqa: B018  (read before the first tab asks)
        self._setup = setup
        self.pages: dict[int, Page] = {}
        self._closed: set[int] = set()
        self._lock = threading.Lock()
        warnings.filterwarnings("ignore", message=CLOSED)
        logging.getLogger("websockets.server").setLevel(logging.CRITICAL)  # browsers open connections in advance
        try:
            with (
                contextlib.redirect_stdout(io.StringIO()),
                _guarding(setup.title) as guarded,
            ):  # viser prints where it listens
                self._viser = viser.ViserServer(host=HOST, port=port, label=setup.arm.title, verbose=False)
        except OSError as error:
            raise OutputError(f"no port can be listened to from {port} on: {error}") from error

        if not guarded.is_set():
            self.stop()
            raise InstallationError(
                f"viser {viser.__version__} would answer other sites, too; the page needs viser 1.1"
            )
        shared = self._viser._websock_server  # all tabs': a page has none, and viser's own open a tunnel for everybody
        for kind in list(shared._incoming_handlers):
            shared.unregister_handler(kind)
        self._viser.on_client_connect(self._opened)
        self._viser.on_client_disconnect(self._left)

    @property
    def address(self) -> str:
        return f"http://{HOST}:{self._viser.get_port()}"

    def stop(self) -> None:
        for number in list(self.pages):
            self.pages.pop(number).close()
        with contextlib.redirect_stdout(io.StringIO()):
            self._viser.stop()

    def _opened(self, client: Any) -> None:
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
