"""What runs tasks elsewhere: processes of this machine or a Dask cluster have this in common."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Collection
from typing import Any, Protocol

from skinmap.errors import UnreachableError

# One thread in the numeric libraries of each process: the processes share the cores already, and
# sums keep their order.
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


LOOK = 0.5  # seconds between a worker's looks after the process that started it


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


class LocalPool:
    """So many processes, started with the first task.

    Parameters
    ----------
    size : int
    """

    where = "on this machine"

    def __init__(self, size: int) -> None:
        self.size = size
        self._executor: Any = None

    def submit(self, call: Callable[[Any], Any], task: Any) -> Any:
        """A future of one task."""
        from loky import get_reusable_executor
        from loky.process_executor import TerminatedWorkerError

        if self._executor is None:
            self._executor = get_reusable_executor(
                max_workers=self.size,
                reuse=True,
                env=dict.fromkeys(THREADS, "1"),
                initializer=end_with,
                initargs=(os.getpid(),),
            )
        try:
            return self._executor.submit(call, task)
        except TerminatedWorkerError as error:
            raise WorkersLostError("a process was killed") from error

    def wait(self, futures: Collection[Any]) -> list[Any]:
        """Those that are done, at least one."""
        from concurrent.futures import FIRST_COMPLETED, wait

        done, _ = wait(futures, return_when=FIRST_COMPLETED)
        return list(done)

    def result(self, future: Any) -> Any:
        """What a task gave, or raises what it raised; WorkersLostError where its process died."""
        from loky.process_executor import TerminatedWorkerError

        try:  # a task that cannot be read there breaks the pool too, and is no death
            return future.result()
        except TerminatedWorkerError as error:
            raise WorkersLostError("a process was killed") from error

    def drop(self, futures: Collection[Any]) -> None:
        """Give up tasks, those under way too."""
        if futures:
            self.close()

    def close(self) -> None:
        """End the processes; otherwise the next pool of this program goes on with them."""
        if self._executor is not None:
            self._executor.shutdown(wait=True, kill_workers=True)
            self._executor = None


def end_with(parent: int) -> None:
    """Let this worker end soon after its parent does, even one that was killed without a word."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(LOOK)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
