"""The queue between two threads: bounded by size; waiting threads are told of the end."""

from __future__ import annotations

import threading
from collections import deque
from typing import Generic, TypeVar

Item = TypeVar("Item")


class QueueEnded(EOFError):  # noqa: N818 - no error: one side has finished
    """Nothing more will come."""


class BoundedQueue(Generic[Item]):
    """Items with their sizes, from one thread to another.

    Parameters
    ----------
    most : int
        Sum of the sizes that may wait; a single item may be larger.

    Attributes
    ----------
    size : int
        Of what waits, and of what was taken last and may still be in use.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._items: deque[tuple[Item, int]] = deque()
        self._held = 0
        self.size = 0
        self._end: Exception | None = None
        self._changed = threading.Condition()

    def put(self, item: Item, size: int = 1, *, patience: float | None = None) -> bool:
        """Add an item as soon as there is room; False where none came within `patience` [s].

        Raises
        ------
        Exception
            What the queue was ended with.
        """
        with self._changed:
            room = self._changed.wait_for(
                lambda: (
                    not size  # what weighs nothing always has room
                    or self.size + size <= self._most
                    or not self._items
                    or self._end is not None
                ),
                patience,
            )
            if self._end is not None:
                raise self._end
            if room:
                self._add(item, size)
            return room

    def push(self, item: Item, size: int) -> list[Item]:
        """Add an item at once; the oldest ones make room for it and are returned."""
        with self._changed:
            self._add(item, size)
            gone = []
            while self.size > self._most and len(self._items) > 1:
                oldest, its_size = self._items.popleft()
                self.size -= its_size
                gone.append(oldest)
            return gone

    def take(self, timeout: float | None) -> Item | None:
        """The oldest item; it counts as waiting until the next is asked for.

        Returns
        -------
        Item or None
            None where nothing came within `timeout` [s].

        Raises
        ------
        Exception
            What the queue was ended with, once it is empty.
        """
        with self._changed:
            self._release()
            if not self._wait(timeout):
                return None
            item, self._held = self._items.popleft()
            return item

    def wait(self, timeout: float | None) -> bool:
        """Whether an item is there within `timeout` [s]; raises as `take`, and takes nothing."""
        with self._changed:
            self._release()
            return self._wait(timeout)

    def take_all(self, timeout: float | None) -> list[Item]:
        """All that waits; nothing where nothing came within `timeout` [s]; raises as `take`."""
        with self._changed:
            if not self._wait(timeout):
                return []
            taken = [item for item, _ in self._items]
            self._items.clear()
            self.size = 0
            return taken

    def end(self, why: Exception, *, at_once: bool = False) -> None:
        """End the queue; with `at_once` what waits is dropped.

        `why` is raised to whoever puts from now on, and to whoever takes when it is empty.
        """
        with self._changed:
            self._end = self._end or why
            if at_once:
                self._items.clear()
                self.size, self._held = 0, 0
                self._end = why
            self._changed.notify_all()

    def _add(self, item: Item, size: int) -> None:
        self._items.append((item, size))
        self.size += size
        self._changed.notify_all()

    def _release(self) -> None:
        self.size -= self._held
        self._held = 0
        self._changed.notify_all()

    def _wait(self, timeout: float | None) -> bool:
        self._changed.wait_for(lambda: self._items or self._end is not None, timeout)
        if not self._items and self._end is not None:
            raise self._end
        return bool(self._items)
