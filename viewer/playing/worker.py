"""A thread that does the same turn over and over until it is closed."""

from __future__ import annotations

import threading
from collections.abc import Callable

PATIENCE = 3.0  # for the thread to end when it is closed [s]


class Worker:
    """One thread of a player.

    Parameters
    ----------
    turn : callable
        Done again and again; it sleeps by waiting for `wake`.
    failed : callable
        Told what a turn raised, after which there is no other.

    Attributes
    ----------
    wake : threading.Event
        Set where a turn is to end early.
    """

    def __init__(self, turn: Callable[[], None], failed: Callable[[Exception], None]) -> None:
        self.wake = threading.Event()
        self._turn, self._failed = turn, failed
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def alive(self) -> bool:
        """Whether the thread runs."""
        return self._thread is not None and self._thread.is_alive()

    def start(self) -> None:
        """Begin; more than once does no harm, and after `close` nothing begins."""
        if self._thread is None and not self._stop.is_set():
            self._thread = threading.Thread(target=self._run, name="player", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """End the thread; may be called twice."""
        self._stop.set()
        self.wake.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(PATIENCE)

    def _run(self) -> None:
        try:
            while not self._stop.is_set():
                self._turn()
        except Exception as error:  # noqa: BLE001 - told to whoever draws
            self._failed(error)
