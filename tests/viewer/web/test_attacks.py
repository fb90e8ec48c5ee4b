"""Connections that mean harm: half a request, no end of headers, frames that are none, too many."""

from __future__ import annotations

import base64
import contextlib
import os
import socket
import struct
import threading

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

import viewer.web.server
from viewer.web.guard import LIVE
from viewer.web.server import CLIENTS

REFUSALS = {b"400", b"403", b"405", b"414", b"431", b"501", b"505"}
DEADLINE = 30.0  # [s]; only a fault takes as long


@pytest.fixture(scope="module")
def hasty(start):
    """A server that waits half a second for a request."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(viewer.web.server, "OPENING", 0.5)
        return start()


@pytest.fixture
def raw(hasty):
    """Opens plain sockets to the server, all closed with the test."""
    made: list[socket.socket] = []

    def open_socket(words: bytes = b"", port: int = hasty.port) -> socket.socket:
        one = socket.create_connection(("127.0.0.1", port), timeout=DEADLINE)
        made.append(one)
        one.sendall(words)
        return one

    yield open_socket
    for one in made:
        one.close()


def ended(one: socket.socket) -> bytes:
    """All that comes until the other side closes."""
    got = b""
    with contextlib.suppress(ConnectionResetError):
        while piece := one.recv(65536):
            got += piece
    return got


def upgrade(server) -> bytes:
    key = base64.b64encode(os.urandom(16)).decode()
    host = f"127.0.0.1:{server.port}"
    return (
        f"GET /{server.guard.token}/{LIVE} HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\n"
        f"Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: {key}\r\n"
        "Sec-WebSocket-Version: 13\r\n\r\n"
    ).encode()


def page_of(server):
    """A page of a server, as a browser opens it."""
    host = f"127.0.0.1:{server.port}"
    return connect(f"ws://{host}/{server.guard.token}/{LIVE}", origin=f"http://{host}")


def test_half_a_request_holds_nobody_up_and_ends_by_itself(hasty, raw):
    held = [raw(words) for words in (b"", b"G", b"GET / HTTP/1.1\r\nHost: x") * 20]
    with page_of(hasty) as page:
        assert "hello" in page.recv(timeout=DEADLINE)
    for one in held:
        ended(one)
    assert hasty.connections <= 1


def test_connections_are_bounded_before_they_have_said_anything(start, raw, monkeypatch):
    monkeypatch.setattr(viewer.web.server, "OPEN", 5)
    server = start()
    held = [raw(port=server.port) for _ in range(5)]
    assert ended(raw(port=server.port)) == b""
    held[0].close()
    for _ in range(100):  # until the server has seen that one is gone
        answer = ended(raw(b"GET / HTTP/1.1\r\nHost: x\r\n\r\n", server.port))
        if answer:
            break
    assert answer.startswith(b"HTTP/1.1 403")


@pytest.mark.parametrize(
    "words",
    [
        b"GET / HTTP/1.1\r\nHost: " + b"x" * 2_000_000,
        b"GET /" + b"a" * 2_000_000 + b" HTTP/1.1\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + b"A: b\r\n" * 100_000 + b"\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(600),  # who speaks TLS
        b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 99999999999\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\nfffffffff\r\n",
        b"\0" * 20_000,
    ],
    ids=["host", "path", "headers", "tls", "post", "chunked", "zeros"],
)
def test_requests_that_are_none_are_ended_and_others_answered(hasty, raw, words):
    one = raw()
    with contextlib.suppress(ConnectionResetError, BrokenPipeError):
        one.sendall(words)
    answer = ended(one)
    assert answer == b"" or answer.split()[1] in REFUSALS
    assert len(answer) < 1000
    with page_of(hasty) as page:
        assert "hello" in page.recv(timeout=DEADLINE)


def frame(head: int, length: int, body: bytes = b"", *, masked: bool = True) -> bytes:
    """A frame that claims a length, whatever its body has."""
    mark = 0x80 * masked
    size = (
        bytes([mark | length]) if length < 126 else bytes([mark | 127]) + struct.pack(">Q", length)
    )
    return bytes([head]) + size + bytes(4) * masked + body


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (frame(0x81, 2**62), 1009),
        (frame(0x81, 2**63 + 1), 1009),
        (frame(0x81, 5, b"hello", masked=False), 1002),
        (frame(0x83, 1, b"x"), 1002),  # a kind that does not exist
        (frame(0xF1, 1, b"x"), 1002),  # reserved bits
        (frame(0x80, 1, b"x"), 1002),  # goes on where nothing began
        (frame(0x09, 0), 1002),  # a ping in pieces
        (frame(0x81, 2, b"\xff\xfe"), 1007),  # no text
        (frame(0x01, 4000, b"a" * 4000) + frame(0x80, 4000, b"a" * 4000), 1009),  # in two pieces
    ],
)
def test_frames_that_are_none_end_their_page_and_no_other(hasty, raw, words, code):
    one = raw(upgrade(hasty))
    assert one.recv(12) == b"HTTP/1.1 101"
    one.sendall(words)
    answer = ended(one)
    assert struct.pack(">H", code) in answer[-130:]
    with page_of(hasty) as page:
        assert "hello" in page.recv(timeout=DEADLINE)


def test_many_pages_at_once_are_as_many_as_are_allowed(start):
    server = start()
    together, served, refused = threading.Barrier(24), [], []

    def visit() -> None:
        together.wait(DEADLINE)
        try:
            page = pages.enter_context(page_of(server))
            page.recv(timeout=DEADLINE)
            served.append(page)
        except (InvalidStatus, ConnectionClosed) as error:
            refused.append(error)

    with contextlib.ExitStack() as pages:
        visitors = [threading.Thread(target=visit) for _ in range(24)]
        for one in visitors:
            one.start()
        for one in visitors:
            one.join()
        assert len(served) == CLIENTS
        assert len(refused) == 24 - CLIENTS
        assert len(server.hub.clients) == CLIENTS
