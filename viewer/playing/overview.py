"""The whole of a recording on the time line from the start, found beside what is played."""

from __future__ import annotations

import logging
import math
import threading
from contextlib import closing

from skinmap.errors import SkinError
from skinmap.live.sources.source import Seekable
from skinmap.live.touched_taxels import LEARN, touch_stretches
from viewer.playing.player import Player
from viewer.view_options import Session

REST = 2e-3  # between two blocks of samples: pictures and names come first [s]
logger = logging.getLogger(__name__)


def fill_overview(session: Session, player: Player) -> threading.Thread | None:
    """Find when a recording is touched, in a thread of its own; None for what is none.

    It ends with the recording, or when the player is closed.
    """
    if session.simulated or not session.repeats:
        return None
    thread = threading.Thread(target=_fill, args=(session, player), name="overview", daemon=True)
    thread.start()
    return thread


def _fill(session: Session, player: Player) -> None:
    pause = threading.Event()
    try:
        source = session.open(hurry=True)
        if not isinstance(source, Seekable) or not math.isfinite(source.duration):
            source.close()
            return
        with closing(session.touch_loop(source, None)) as loop:
            with closing(session.open(hurry=True)) as ahead:
                loop.learn_rest(ahead, LEARN)
            for stretches in touch_stretches(loop):
                if player.closed:
                    return
                if stretches:
                    player.fill(stretches)
                pause.wait(REST)
    except (SkinError, OSError) as error:  # the player, which reads the same, tells it
        logger.info("no overview: %s", error)
