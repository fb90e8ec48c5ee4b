"""Serves the scene to browsers on this machine.

with serve(robot, skins, player) as server:
    print(server.url)
    server.wait()
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import gzip
import logging
import math
import socket
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from http import HTTPStatus
from typing import Any, Self

import click
from websockets.asyncio.server import ServerConnection
from websockets.asyncio.server import serve as listen
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from skinmap.errors import SkinWarning, UnreachableError
from skinmap.skin.robot import Robot
from skinmap.touch.prepared_skin import PreparedSkin
from viewer.drawing.body.bare_body import Links
from viewer.interaction.view_file import SavedView, check_view, content_of
from viewer.layers import LEFT, RIGHT, Layers, Pair
from viewer.playing.overview import PairedPlayer, new_players
from viewer.playing.player import Player
from viewer.results import ViewPage
from viewer.view_options import Look, Session, look_beside, new_layers
from viewer.web.files import page_files, served_files
from viewer.web.guard import (
    LIVE,
    LOOPBACK,
    Guard,
    Refusal,
    check_token,
    is_loopback,
    new_token,
    page_headers,
)
from viewer.web.hub import Hub
from viewer.web.scene_data import WebScene

PORT = 8080
LARGEST = 4096  # bytes of a message from a page: it sends wishes of some words
CLIENTS = 8  # pages at once
OPEN = 256  # connections at once, of those too that have not said what they want
OPENING = 20.0  # for a request to come whole, and for its answer to be taken [s]
PIECE = 65_536  # bytes of an answer that are sent at once
PATIENCE = 5.0  # for threads to end [s]
LEVEL = 6  # of gzip: a scene of the whole iCub takes a fifth of a second
SCENE = "scene.bin"
PAIR = "pair_page"  # that frames two

logger = logging.getLogger(__name__)


def serve(
    robot: Robot,
    skins: Mapping[str, PreparedSkin],
    player: Player,
    *,
    host: str = LOOPBACK,
    port: int = PORT,
    token: str | None = None,
    clients: int = CLIENTS,
    beside: Hub | None = None,
    **shown: Any,
) -> WebServer:
    """Start to serve a robot; the player is started and stays the caller's to close.

    Parameters
    ----------
    robot : Robot
    skins : mapping of str to PreparedSkin
        Parts to show.
    player : Player
        What is played.
    host : str
        Address to listen at; anything but this machine's own is warned of on stderr.
    port : int
        0 for any that is free.
    token : str, optional
        First part of the address; random by default. With the same one and the same port a page
        that is open finds the server again after it was started anew.
    clients : int
        Pages at once.
    beside : Hub, optional
        What stands at the right of it, from `new_hub`.
    shown
        What a page shows first, as `viewer.web.server.new_hub` takes it: layers, layer, style,
        angles, links, view, size, title, waits.

    Returns
    -------
    WebServer
        Serves until `stop`, or until a `with` block of it ends; `url` is what to open.

    Raises
    ------
    UnreachableError
        The port is taken, or the address is not this machine's.
    UnknownNameError, InvalidArrayError
        A layer or link that does not exist; a token that could be guessed.

    Examples
    --------
    >>> from viewer import Player, Scene, serve
    >>> scene = Scene.load("kaspar", ["torso"])
    >>> with Player([]) as player, serve(scene.robot, scene.data.skins, player, port=0) as page:
    ...     page.url.startswith("http://127.0.0.1:")
    True
    """
    token = new_token() if token is None else check_token(token)
    listening = bind(host, port)
    try:
        hub = new_hub(robot, skins, player, **shown)
    except BaseException:
        listening.close()
        raise
    guard = Guard(host, listening.getsockname()[1], token)
    if not is_loopback(host):
        warnings.warn(
            f"{host} can be reached from other machines, and nothing is encrypted: anyone who "
            "reads the address on the network can watch and play",
            SkinWarning,
            stacklevel=2,
        )
    player.start()
    if beside is not None:
        hub.mate, beside.mate = beside, hub
    return WebServer(listening, guard, hub, clients, beside)


def new_hub(
    robot: Robot,
    skins: Mapping[str, PreparedSkin],
    player: Player,
    *,
    layers: Layers | None = None,
    layer: str = "pressure",
    style: str = "surface",
    angles: Mapping[str, float] | None = None,
    links: Links = None,
    view: SavedView | None = None,
    size: tuple[int, int] | None = None,
    title: str | None = None,
    waits: bool = False,
) -> Hub:
    """What the pages of a robot are told.

    Parameters
    ----------
    robot, skins, player
        As `serve` takes them.
    layers : Layers, optional
        With covariances and healths where there are any.
    layer, style : str
        What a page shows first.
    angles : mapping of str to float, optional
        Joint angles [rad]; the robot's natural pose by default.
    links : iterable of str, optional
        Links to draw; all that have a mesh by default.
    view : SavedView, optional
        That a page begins with.
    size : (int, int), optional
        Width and height of the robot's picture [px]; as large as the page by default.
    title : str, optional
        Heading of the page; the robot's name by default.
    waits : bool
        The player is paused until the first page comes.
    """
    layers = Layers(skins) if layers is None else layers
    layers.get(layer)
    saved = None if view is None else content_of(view)
    first = {"layer": layer, "style": style, "view": saved, "size": size, "title": title}
    scene = WebScene(robot, skins, angles=angles, links=links)
    return Hub(scene, player, layers, first, waits=waits)


def bind(host: str, port: int) -> socket.socket:
    """A socket that listens.

    Raises
    ------
    UnreachableError
        The port is taken, or the address is not this machine's.
    """
    if not 0 <= port <= 65535:
        raise UnreachableError(f"port {port} does not exist: ports are 0 to 65535")
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        return socket.create_server((host.strip("[]"), port), family=family)
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            reason = "is in use; give another: --web PORT, or --web alone for any that is free"
        else:
            reason = f"cannot be listened at: {error.strerror or error}"
        raise UnreachableError(f"port {port} of {host} {reason}") from error


class WebServer:
    """A page on a socket, with a thread of its own.

    Parameters
    ----------
    listening : socket
    guard : Guard
    hub : Hub
        What pages are told.
    clients : int
        Pages at once.
    beside : Hub, optional
        What the pages at the right of two are told.
    """

    def __init__(
        self,
        listening: socket.socket,
        guard: Guard,
        hub: Hub,
        clients: int,
        beside: Hub | None = None,
    ) -> None:
        self._socket, self.guard, self.hub, self._most = listening, guard, hub, clients
        self.connections = 0
        self._hubs = {"": hub} if beside is None else {f"{LEFT}/": hub, f"{RIGHT}/": beside}
        self._kept: dict[bytes, bytes] = {}  # what was compressed, by what it was
        for one in self._hubs.values():
            self._compressed(one.scene.packed)  # before anybody asks
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stop: asyncio.Event | None = None
        self._ready = threading.Event()
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run, name="web", daemon=True)
        self._thread.start()
        self._ready.wait(PATIENCE)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @property
    def port(self) -> int:
        """Where it listens."""
        return self.guard.port

    @property
    def url(self) -> str:
        """Address to open, with the token: keep it to yourself."""
        host = self.guard.host
        if host in ("0.0.0.0", "::"):
            host = socket.gethostname()
        if ":" in host and not host.startswith("["):
            host = f"[{host}]"
        return f"http://{host}:{self.port}/{self.guard.token}/"

    def wait(self, timeout: float | None = None) -> bool:
        """Stay until `stop` is called from elsewhere; False after `timeout` [s]."""
        return self._done.wait(timeout)

    def stop(self) -> None:
        """Close all pages' connections and the socket; may be called twice."""
        if self._loop is not None and self._stop is not None:
            with contextlib.suppress(RuntimeError):  # the loop has ended by itself
                self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(PATIENCE)
        self._socket.close()

    def _run(self) -> None:
        try:
            asyncio.run(self._main())
        except BaseException:
            logger.exception("the web server failed")
        finally:
            self._ready.set()
            self._done.set()

    async def _main(self) -> None:

        web = self

        class Counted(ServerConnection):
            """A connection that is one of not too many: each takes a file of the process."""

            def connection_made(self, transport: asyncio.BaseTransport) -> None:
                web.connections += 1
                super().connection_made(transport)
                if web.connections > OPEN:
                    self.transport.abort()

            def connection_lost(self, error: Exception | None) -> None:
                web.connections -= 1
                super().connection_lost(error)

        self._loop, self._stop = asyncio.get_running_loop(), asyncio.Event()
        quiet = logging.getLogger(f"{__name__}.connections")
        quiet.setLevel(logging.CRITICAL)  # refused and broken connections are nobody's fault here
        async with listen(
            self._handle,
            sock=self._socket,
            process_request=self._answer,
            max_size=LARGEST,
            max_queue=8,
            open_timeout=OPENING,
            create_connection=Counted,
            compression=None,
            close_timeout=1,
            server_header=None,
            logger=quiet,
        ):
            news = [asyncio.create_task(hub.watch()) for hub in self._hubs.values()]
            self._ready.set()
            await self._stop.wait()
            for task in news:
                task.cancel()
            await asyncio.gather(*news, return_exceptions=True)

    async def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Refuse, send a file, or let a WebSocket through (None)."""
        asked = self.guard.check(
            request.path,
            {name: request.headers.get_all(name) for name in ("Host", "Origin", "Upgrade")},
        )
        if isinstance(asked, Refusal):
            return _respond(connection, asked.status, f"{asked.reason}\n".encode())
        place, _, name = asked.rpartition("/")
        place = f"{place}/" if place else ""
        hub, pair = self._hubs.get(place), len(self._hubs) > 1
        if name == LIVE and hub is not None:
            if sum(len(one.clients) for one in self._hubs.values()) >= self._most:
                full = f"{self._most} pages are open already\n".encode()
                return _respond(connection, HTTPStatus.SERVICE_UNAVAILABLE, full)
            return None
        if not asked and not request.path.partition("?")[0].endswith("/"):
            where = {"Location": f"/{self.guard.token}/"}
            return _respond(connection, HTTPStatus.PERMANENT_REDIRECT, b"", more=where)
        if hub is not None and name == SCENE:
            kind, content = "application/octet-stream", hub.scene.packed
        elif pair and asked in page_files(PAIR):
            kind, content = page_files(PAIR)[asked]
        elif hub is not None and name in served_files():
            kind, content = served_files()[name]
        else:
            return _respond(connection, HTTPStatus.NOT_FOUND, b"nothing here\n")
        more = page_headers(request.headers["Host"], framed=pair) | {"Vary": "Accept-Encoding"}
        if any("gzip" in value for value in request.headers.get_all("Accept-Encoding")):
            content, more["Content-Encoding"] = self._compressed(content), "gzip"
        answer = _respond(connection, HTTPStatus.OK, content, kind, more)
        return await _in_pieces(connection, answer)

    def _compressed(self, content: bytes) -> bytes:
        if content not in self._kept:
            self._kept[content] = gzip.compress(content, LEVEL, mtime=0)
        return self._kept[content]

    def _hub_at(self, path: str) -> Hub:
        """The hub that a page's path names: of two the one behind the token."""
        place = path.split("/")[2]
        return self._hubs.get(f"{place}/", self.hub)

    async def _handle(self, connection: ServerConnection) -> None:

        try:
            assert connection.request is not None
            await self._hub_at(connection.request.path).talk(connection)
        except ConnectionClosed:
            pass  # a tab was closed
        except Exception:
            logger.exception("a page could not be served")
            raise


def _respond(
    connection: ServerConnection,
    status: HTTPStatus,
    content: bytes,
    kind: str = "text/plain; charset=utf-8",
    more: Mapping[str, str] | None = None,
) -> Response:

    headers = Headers({"X-Content-Type-Options": "nosniff"} if more is None else dict(more))
    headers["Content-Type"] = kind
    headers["Content-Length"] = str(len(content))
    headers["Connection"] = "close"
    return Response(status.value, status.phrase, headers, content)


async def _in_pieces(connection: ServerConnection, answer: Response) -> Response:
    """Send all but the last piece of an answer; who reads slowly holds one piece, not a scene."""

    class Rest(Response):
        """The last piece: head and the others are sent."""

        def serialize(self) -> bytes:
            return bytes(self.body)

    whole, last = memoryview(answer.body), max(len(answer.body) - 1, 0) // PIECE * PIECE
    if not last:
        return answer
    connection.transport.write(replace(answer, body=b"").serialize())
    for start in range(0, last, PIECE):
        if connection.transport.is_closing():
            break
        connection.transport.write(whole[start : start + PIECE])
        await connection.drain()
    return Rest(answer.status_code, answer.reason_phrase, answer.headers, bytes(whole[last:]))


def serve_web(session: Session, look: Look, *, seconds: float | None, **where: Any) -> ViewPage:
    """Serve the scene to a browser until it is interrupted, or for so many seconds.

    Parameters
    ----------
    session, look, where
        As `served` takes them.
    seconds : float or None

    Raises
    ------
    UnreachableError
        The port is in use, or the address is not this machine's.
    SkinMismatchError
        A view of another robot.
    SkinError
        What the source failed with, after the end: its last picture stays until then. What else
        failed, a plug-in for one, is raised as it is.
    """
    tell = partial(click.echo, err=True)
    with served(session, look, **where) as (server, player):
        tell(server.url)
        with contextlib.suppress(KeyboardInterrupt):
            wait(server.hub, math.inf if seconds is None else seconds, tell)
        address = server.url
    for one in (player, server.hub, player.mate, server.hub.mate):
        if one is not None and one.error is not None:
            raise one.error
    return ViewPage(robot=session.robot.name, parts=list(session.parts), address=address)


@contextlib.contextmanager
def served(
    session: Session,
    look: Look,
    *,
    host: str = LOOPBACK,
    port: int = 0,
    token: str | None = None,
    other: Session | None = None,
    later: float = 0.0,
) -> Iterator[tuple[WebServer, PairedPlayer]]:
    """The server and the player of a session's source, both ended with the context.

    Parameters
    ----------
    session : Session
    look : Look
    host, port, token
        As for `viewer.web.server.serve`.
    other : Session, optional
        What is served beside it, and played in step.
    later : float
        How much later that stands in its recording [s].
    """
    with contextlib.ExitStack() as ended:
        sessions = [session] if other is None else [session, other]
        sides, beside = [], None
        for one, player in zip(sessions, new_players(sessions, later), strict=True):
            ended.callback(player.close)
            mine = look_beside(look, session, one)
            shown: dict[str, Any] = {
                "waits": player.paused, "layers": new_layers(one, mine), "size": mine.size,
                "layer": mine.layer or "pressure", "style": mine.style or "surface",
                "angles": mine.angles or None, "links": mine.links,
                "view": first_view(one, mine),
            }  # fmt: skip
            sides.append((player, shown))
        (player, first), *others = sides
        for mate, second in others:
            Pair(first["layers"], second["layers"])
            for side, one, (_, shown) in zip((LEFT, RIGHT), sessions, sides, strict=True):
                shown["title"] = f"{side}: {one.title}"
            beside = new_hub(sessions[1].robot, sessions[1].skins, mate, **second)
            mate.start()
        page = serve(
            session.robot, session.skins, player,
            host=host, port=port, token=token, beside=beside, **first,
        )  # fmt: skip
        yield ended.enter_context(page), player


def first_view(session: Session, look: Look) -> SavedView | None:
    """The saved view that pages begin with; layer and style that were asked for stand."""
    if look.view is None:
        return None
    check_view(look.view, session.robot)
    return replace(
        look.view, layer=look.layer or look.view.layer, style=look.style or look.view.style
    )


def wait(hub: Hub, seconds: float, tell: Callable[[str], None]) -> None:
    """Wait so long, or until an interrupt; a source that failed or ended stays in view."""
    end = time.monotonic() + seconds
    told, player = False, hub.player
    while (left := end - time.monotonic()) > 0:
        if (failure := hub.failure()) is not None and not told:
            told = True
            tell(f"{failure}; the page stays until Ctrl-C")
        player.wait(player.number, min(left, 1.0))
