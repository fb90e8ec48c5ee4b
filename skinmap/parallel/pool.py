"""What runs tasks elsewhere: processes of this machine or a Dask cluster have this in common."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any, Protocol

from skinmap.errors import UnreachableError


class WorkersLostError(UnreachableError):
    """A worker died with tasks under way; they may be given to others."""


class Pool(Protocol):
    """Workers that take tasks and give futures.

    Attributes
    ----------
    size : int
        Tasks that run at a time.
    where : str
        For messages.
    """

    size: int
    where: str

    def submit(self, call: Callable[[Any], Any], task: Any) -> Any:
        """A future of one task."""

    def wait(self, futures: Collection[Any]) -> list[Any]:
        """Those that are done, at least one."""

    def result(self, future: Any) -> Any:
        """What a task gave, or raises what it raised; WorkersLostError where its worker died."""

    def drop(self, futures: Collection[Any]) -> None:
        """Give up tasks, those under way too."""
