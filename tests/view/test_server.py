"""Who may connect to the page's server, over a real socket, and what nobody may ask of it."""

import contextlib
import re
import socket
from types import SimpleNamespace
from urllib.error import HTTPError
from urllib.request import urlopen

import pytest

pytest.importorskip("viser")

import viser
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from benchmarks.studies.tab import Tab, wait_for
from kinreach.errors import InstallationError
from kinreach.view import _server
from kinreach.view._cli import setup_of
from kinreach.view._server import Server

SHARING = ("ShareUrlRequest", "ShareUrlDisconnect")


@pytest.fixture(scope="module")
def own():
    """A server of an arm that is drawn simply."""
    serving = Server(setup_of("arm3", simple=True), port=8480)
    yield serving
    serving.stop()


def knock(server, host, **headers):
    """Ask to connect as a browser does that found the server by the name of a host."""
    there = socket.create_connection(server.address.removeprefix("http://").split(":"), timeout=30)
    with contextlib.closing(there):
        protocols = [f"viser-v{viser.__version__}"]
        with connect(f"ws://{host}/", sock=there, subprotocols=protocols, additional_headers=headers) as answered:
            return answered.response.status_code


@pytest.mark.parametrize("name", ["127.0.0.1", "localhost", "[::1]"])
@pytest.mark.parametrize("forwarded", [False, True])
def test_the_page_itself_may_connect(own, name, forwarded):
    port = 9000 if forwarded else own.address.rpartition(":")[2]
    assert knock(own, f"{name}:{port}", Origin=f"http://{name}:{port}") == 101
    assert knock(own, name, Origin=f"http://{name}") == 101


@pytest.mark.parametrize(
    ("host", "headers"),
    [
        ("127.0.0.1:{port}", {}),
        ("127.0.0.1:{port}", {"Origin": "null"}),
        ("127.0.0.1:{port}", {"Origin": ""}),
        ("127.0.0.1:{port}", {"Origin": "https://example.org"}),
        ("127.0.0.1:{port}", {"Origin": "http://example.org:{port}"}),
        ("127.0.0.1:{port}", {"Origin": "http://127.0.0.1.example.org:{port}"}),
        ("127.0.0.1:{port}", {"Origin": "http://127.0.0.1:{port}.example.org"}),
        ("127.0.0.1:{port}", {"Origin": "http://127.0.0.1:{port}/"}),
        ("127.0.0.1:{port}", {"Origin": "http://127.0.0.1:3000"}),
        ("127.0.0.1:{port}", {"Origin": "http://127.0.0.1"}),
        ("127.0.0.1:{port}", {"Origin": "https://127.0.0.1:{port}"}),
        ("127.0.0.1:{port}", {"Origin": "http://127.0.0.1:{port}", "origin": "https://example.org"}),
        ("127.0.0.1:{port}", {"Origin": "http://127.0.0.1:{port}", "Host": "example.org"}),
        ("example.org:{port}", {"Origin": "http://example.org:{port}"}),
        ("example.org:{port}", {"Origin": "http://127.0.0.1:{port}"}),
        ("127.0.0.1.example.org:{port}", {"Origin": "http://127.0.0.1.example.org:{port}"}),
        ("127x0x0x1:{port}", {"Origin": "http://127x0x0x1:{port}"}),
    ],
)
def test_nobody_else_may_connect(own, host, headers, capfd):
    """Refused at the handshake: pages of other sites, programs without an origin, and names that lead here."""
    port = own.address.rpartition(":")[2]
    with pytest.raises(InvalidStatus, match="403"):
        knock(own, host.format(port=port), **{name: value.format(port=port) for name, value in headers.items()})
    assert not own.pages
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(("host", "status"), [("{host}", 200), ("example.org", 403)])
def test_files_are_for_this_machines_names(own, host, status):
    with socket.create_connection(own.address.removeprefix("http://").split(":"), timeout=30) as there:
        named = host.format(host=own.address.removeprefix("http://"))
        there.sendall(f"GET / HTTP/1.1\r\nHost: {named}\r\n\r\n".encode())
        assert there.recv(64).startswith(f"HTTP/1.1 {status} ".encode())


def test_no_tab_opens_a_tunnel(own, monkeypatch):
    """viser's messages that would share the page with the world have no handler."""
    asked = []
    for name in ("request_share_url", "disconnect_share_url"):
        monkeypatch.setattr(viser.ViserServer, name, lambda *_, **__: asked.append("tunnel"))
    with Tab(own) as tab:
        for kind in SHARING:
            tab.send({"type": kind})
        panel = tab.page.target
        for _ in range(3):
            panel.draw_s = 0.0
            tab.drag("/target/goal", panel.T[:3, 3] + 0.01)
            wait_for(lambda: panel.draw_s)
        assert not asked


def test_a_server_that_cannot_be_guarded_is_not_started(monkeypatch):
    stopped = []

    class Otherwise:
        def __init__(self, **options):
            pass

        def stop(self):
            stopped.append(self)

    monkeypatch.setattr("viser.ViserServer", Otherwise)
    with pytest.raises(InstallationError, match="would answer other sites"):
        Server(setup_of("arm3", simple=True), port=8490)
    assert len(stopped) == 1


@pytest.mark.parametrize("sent", [b"", b"\xc1", b"\x80", "text", b"\x81\xa4type\xa4Nope", b"\xff" * 4096])
def test_what_is_no_message_is_left_out(own, sent, capfd):
    """The tab that sent it goes on, and all others do."""
    with Tab(own) as tab:
        panel = tab.page.target
        tab.send(sent)
        tab.drag("/target/goal", panel.T[:3, 3] + 0.01)
        wait_for(lambda: panel.draw_s)
        assert not tab.disconnected
    assert capfd.readouterr() == ("", "")


def test_a_connection_without_a_request_is_not_reported(own, capfd):
    """Browsers open some in advance."""
    port = int(own.address.rpartition(":")[2])
    socket.create_connection(("127.0.0.1", port)).close()
    urlopen(own.address).close()
    assert capfd.readouterr().err == ""


def test_the_page_has_its_own_title_and_no_frame_around_it(own):
    with urlopen(own.address) as answer:
        assert answer.headers["Content-Security-Policy"] == "frame-ancestors 'none'"
        page = answer.read().decode()
    assert re.findall("<title>(.*?)</title>", page) == ["kinreach – arm3"]
    assert page.count("data-press") > 0
    with pytest.raises(HTTPError) as missing:
        urlopen(f"{own.address}/nothing.html")
    with missing.value as refusal:
        assert refusal.headers["Content-Security-Policy"] == "frame-ancestors 'none'"


def test_a_tab_that_is_left_is_closed_once_before_it_is_drawn_too(own, monkeypatch):
    closed, numbers = [], range(1000, 1006)
    monkeypatch.setattr(
        _server, "Page", lambda client, _: SimpleNamespace(close=lambda: closed.append(client.client_id))
    )
    for number in numbers:
        client, happens = SimpleNamespace(client_id=number), [own._opened, own._left]
        for each in happens[:: -1 if number % 2 else 1]:
            each(client)
    assert closed == [*numbers]
    assert not own.pages
