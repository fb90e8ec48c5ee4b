"""`skinmap view --web`: a session's source in pages, until Ctrl-C."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

from viewer.interaction.view_file import SavedView
from viewer.playing.player import Player
from viewer.results import ViewPage
from viewer.view_options import Look, Session, check_view, drawn_links, new_layers
from viewer.web.guard import LOOPBACK
from viewer.web.server import WebServer, serve


def serve_web(
    session: Session,
    look: Look,
    *,
    host: str,
    port: int,
    seconds: float | None,
    token: str | None = None,
) -> ViewPage:
    """Serve the scene to a browser until it is interrupted, or for so many seconds.

    Raises
    ------
    UnreachableError
        The port is in use, or the address is not this machine's.
    SkinMismatchError
        A view of another robot.
    SkinError
        What the source failed with, after the end: its last picture stays until then.
    """
    import click

    def tell(line: str) -> None:
        click.echo(line, err=True)

    with served(session, look, tell, host=host, port=port, token=token) as (server, player):
        tell(server.url)
        with contextlib.suppress(KeyboardInterrupt):
            wait(player, math.inf if seconds is None else seconds, tell)
        address = server.url
    if player.error is not None:
        raise player.error
    return ViewPage(robot=session.robot.name, parts=list(session.parts), address=address)


@contextlib.contextmanager
def served(
    session: Session,
    look: Look,
    tell: Callable[[str], None],
    *,
    host: str = LOOPBACK,
    port: int = 0,
    token: str | None = None,
) -> Iterator[tuple[WebServer, Player]]:
    """The server and the player of a session's source, both ended with the context.

    Parameters
    ----------
    session : Session
    look : Look
    tell : callable
        Told in a line what goes wrong beside.
    host, port, token
        As for `viewer.web.server.serve`.
    """
    view = first_view(session, look)
    loop = session.live()
    waits = not loop.live  # for the first page
    with Player(loop, paused=waits) as player:
        player.speed = session.speed
        with serve(
            session.robot,
            session.skins,
            player,
            host=host,
            port=port,
            token=token,
            waits=waits,
            layers=new_layers(session, look),
            size=look.size,
            layer=look.layer or "pressure",
            style=look.style or "surface",
            angles=look.angles or None,
            links=drawn_links(session, look),
            view=view,
            counts=loop.totals,
        ) as server:
            yield server, player


def first_view(session: Session, look: Look) -> SavedView | None:
    """The saved view that pages begin with; layer and style that were asked for stand."""
    if look.view is None:
        return None
    check_view(look.view, session.robot)
    return replace(
        look.view, layer=look.layer or look.view.layer, style=look.style or look.view.style
    )


def wait(player: Player, seconds: float, tell: Callable[[str], None]) -> None:
    """Wait so long, or until an interrupt; a source that failed or ended stays in view."""
    end = time.monotonic() + seconds
    told = False
    while (left := end - time.monotonic()) > 0:
        if player.error is not None and not told:
            told = True
            why = " ".join(str(player.error).split())
            tell(f"the source failed: {why}; the page stays until Ctrl-C")
        player.wait(player.number, min(left, 1.0))
