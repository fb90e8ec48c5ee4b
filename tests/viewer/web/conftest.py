"""A page of the iCub's chest and left upper arm, served on a free port."""

from __future__ import annotations

import http.client
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from skinmap.live.contacts.named_touch import Moment, NamedTouch
from viewer import Layers, Player
from viewer.web.guard import LIVE
from viewer.web.server import WebServer, serve

PARTS = ("torso", "left_arm")
LINKS = ("chest", "l_upper_arm")
LABEL = "caress"


@pytest.fixture(scope="package")
def moments(icub) -> list[Moment]:
    """A second at rest, then a touch in the middle of the chest."""
    skins = {part: icub.skin(part) for part in PARTS}
    rest = {part: np.zeros(len(skin)) for part, skin in skins.items()}
    chest = skins["torso"]
    middle = int(np.argmin(np.linalg.norm(chest.positions - chest.positions.mean(axis=0), axis=1)))
    gap = np.linalg.norm(chest.positions - chest.positions[middle], axis=1)
    pressed = {**rest, "torso": np.where(gap < 0.02, 200.0, 0.0)}
    touch = NamedTouch(
        "torso", np.flatnonzero(gap < 0.02), chest.positions[middle], LABEL, 0.9, identity=1
    )
    return [Moment(0.0, rest), Moment(1.0, pressed, (touch,))]


@pytest.fixture(scope="package")
def start(icub, prepared, moments, opengl) -> Iterator[Callable[..., WebServer]]:
    """Starts servers of paused players, each ended with the tests."""
    made: list[tuple[WebServer, Player]] = []

    def begin(*, moments: list[Moment] = moments, **options) -> WebServer:
        skins = {part: prepared(part) for part in PARTS}
        player = Player(list(moments), paused=True)
        layers = Layers(skins)
        server = serve(icub, skins, player, port=0, links=LINKS, layers=layers, **options)
        made.append((server, player))
        return server

    yield begin
    for server, player in made:
        server.stop()
        player.close()


@pytest.fixture(scope="package")
def server(start) -> WebServer:
    return start()


@pytest.fixture
def get(server) -> Callable[..., tuple[int, bytes, dict[str, str]]]:
    """Asks the server for a path as it stands, with headers; status, content and headers."""

    def ask(path: str, **headers: str) -> tuple[int, bytes, dict[str, str]]:
        connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
        try:
            connection.putrequest("GET", path, skip_host="Host" in headers)
            for name, value in headers.items():
                connection.putheader(name, value)
            connection.endheaders()
            answer = connection.getresponse()
            return answer.status, answer.read(), dict(answer.getheaders())
        finally:
            connection.close()

    return ask


@pytest.fixture
def live(server) -> Callable[..., object]:
    """Opens WebSockets to the server; the page's own Origin and token unless others are given."""
    from websockets.sync.client import connect

    def open_socket(**options):
        at = f"127.0.0.1:{options.pop('port', server.port)}"
        path = options.pop("path", f"/{server.guard.token}/{LIVE}")
        options.setdefault("origin", f"http://{at}")
        return connect(f"ws://{at}{path}", open_timeout=10, close_timeout=5, **options)

    return open_socket
