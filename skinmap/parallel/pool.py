"""What runs tasks elsewhere: processes of this machine or a Dask cluster have this in common."""

from __future__ import annotations

import itertools
import os
import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TypeAlias

from skinmap.errors import UnreachableError, VersionMismatchError
from skinmap.imports import import_optional

# One thread in the numeric libraries of each process: the processes share the cores already, and
# sums keep their order.
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


LOOK = 0.5  # seconds between a worker's looks after the process that started it
CONNECT_SECONDS = 5.0  # a scheduler that does not answer by then is not there
WORKER_SECONDS = 5.0  # for the first worker to appear at a scheduler that has none
ABSENT_SECONDS = 60.0  # without any worker, or without the scheduler, before a sweep is given up
LOOK_SECONDS = 2.0  # between looks at who is there while nothing gets done
# What decides about bits and about whether a task can be read; Python by its minor version.
LIBRARIES = ("skinmap", "numpy", "scipy", "scikit-learn", "libigl", "cloudpickle")
LARGE = "distributed.admin.large-graph-warning-threshold"
_numbers = itertools.count()


class WorkersLostError(UnreachableError):
    """A worker died with tasks under way; they may be given to others."""


class LocalPool:
    """So many processes, started with the first task."""

    where = "on this machine"

    def __init__(self, size: int) -> None:
        self.size = size
        self._executor: Any = None

    def submit(self, call: Callable[[Any], Any], task: Any) -> Any:
        """A future of one task."""
        from loky import get_reusable_executor

        if self._executor is None:
            self._executor = get_reusable_executor(
                max_workers=self.size,
                reuse=True,
                env=dict.fromkeys(THREADS, "1"),
                initializer=end_with,
                initargs=(os.getpid(),),
            )
        with _killed_processes():
            return self._executor.submit(call, task)

    def wait(self, futures: Collection[Any]) -> list[Any]:
        """Those that are done, at least one."""
        from concurrent.futures import FIRST_COMPLETED, wait

        done, _ = wait(futures, return_when=FIRST_COMPLETED)
        return list(done)

    def result(self, future: Any) -> Any:
        """What a task gave, or raises what it raised; WorkersLostError where its process died."""
        with _killed_processes():
            return future.result()

    def drop(self, futures: Collection[Any]) -> None:
        """Give up tasks, those under way too."""
        if futures:
            self.close()

    def close(self) -> None:
        """End the processes; otherwise the next pool of this program goes on with them."""
        if self._executor is not None:
            self._executor.shutdown(wait=True, kill_workers=True)
            self._executor = None


@contextmanager
def _killed_processes() -> Iterator[None]:
    """Raise WorkersLostError where loky reports processes that were killed."""
    from loky.process_executor import TerminatedWorkerError

    try:  # a task that cannot be read there breaks the pool too, and is no death
        yield
    except TerminatedWorkerError as error:
        raise WorkersLostError("a process was killed") from error


def end_with(parent: int) -> None:
    """Let this worker end soon after its parent does, even one that was killed without a word."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(LOOK)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


class ClusterPool:
    """The workers of the Dask scheduler at an address.

    Parameters
    ----------
    address : str
        tcp://host:port.

    Raises
    ------
    UnreachableError
        No scheduler answers, or it has no worker.
    VersionMismatchError
        Scheduler or workers run other versions than this process.
    MissingLibraryError
        Dask is not installed.
    """

    def __init__(self, address: str) -> None:
        self.where = f"at {address!r}"
        self._client = connect(address)
        try:
            self.size = self._count()
            check_versions(self._client.get_versions(packages=list(LIBRARIES)))
        except BaseException:
            self._client.close()
            raise

    def submit(self, call: Callable[[Any], Any], task: Any) -> Any:
        """A future of one task."""
        import dask

        # Keys of our own: Dask would read through the whole task to make one. Skins are a few
        # megabytes, about which it need not warn.
        with dask.config.set({LARGE: "1 GB"}):
            key = f"skinmap-{id(self):x}-{next(_numbers)}"
            return self._client.submit(call, task, key=key, pure=False)

    def wait(self, futures: Collection[Any]) -> list[Any]:
        """Those that are done, at least one."""
        from distributed import wait
        from distributed.client import FuturesCancelledError

        since = time.monotonic()
        while True:
            try:
                with self._client.as_current():  # it is nobody's default
                    wait(list(futures), timeout=LOOK_SECONDS, return_when="FIRST_COMPLETED")
            except FuturesCancelledError as error:
                raise WorkersLostError(f"the scheduler {self.where} lost tasks") from error
            except TimeoutError:
                if self._present():
                    since = time.monotonic()
                elif time.monotonic() - since > ABSENT_SECONDS:
                    raise UnreachableError(
                        f"no worker {self.where} for {ABSENT_SECONDS:.0f} s"
                    ) from None
                continue
            return [future for future in futures if future.status != "pending"]

    def result(self, future: Any) -> Any:
        """What a task gave, or raises what it raised; WorkersLostError where its worker died."""
        from concurrent.futures import CancelledError

        from distributed.client import FutureCancelledError
        from distributed.comm.core import CommClosedError
        from distributed.scheduler import KilledWorker

        try:
            return future.result()
        except CommClosedError as error:  # the scheduler has gone while the result was fetched
            raise WorkersLostError(f"the scheduler {self.where} lost tasks") from error
        except (KilledWorker, FutureCancelledError, CancelledError) as error:
            raise WorkersLostError("workers died with a task") from error

    def drop(self, futures: Collection[Any]) -> None:
        """Give up tasks; one under way ends on its worker and its result is thrown away."""
        if futures and self._client.status == "running":
            self._client.cancel(list(futures), force=True)

    def close(self) -> None:
        """Leave the cluster."""
        self._client.close()

    def _count(self) -> int:
        """Threads of all workers."""
        deadline = time.monotonic() + WORKER_SECONDS
        while not (threads := self._client.nthreads()):
            left = deadline - time.monotonic()
            if left <= 0.0:
                raise UnreachableError(
                    f"the Dask scheduler {self.where} has no worker; start some with `dask worker`"
                )
            try:
                self._client.wait_for_workers(1, timeout=left)
            except TimeoutError:
                continue
        return sum(threads.values())

    def _present(self) -> bool:
        """Whether the scheduler answers and has a worker."""
        if self._client.status != "running":
            return False
        try:
            return bool(self._client.nthreads())
        except (OSError, TimeoutError):
            return False


Pool: TypeAlias = LocalPool | ClusterPool  # each has a size, and where it is for messages


def connect(address: str) -> Any:
    """A client of the Dask scheduler at an address.

    Raises
    ------
    UnreachableError, MissingLibraryError
    """
    need = "a Dask scheduler needs dask and distributed: install skinmap[dask]"
    distributed = import_optional("distributed", need)
    import warnings

    try:
        with warnings.catch_warnings():
            # Versions are compared below, and a difference is more than a warning.
            warnings.filterwarnings("ignore", "Mismatched versions found")
            return distributed.Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError, TypeError, ImportError) as error:
        raise UnreachableError(
            f"no Dask scheduler answers at {address!r} ({type(error).__name__}); "
            "expected an address like tcp://host:8786"
        ) from None


def check_versions(versions: Mapping[str, Any]) -> None:
    """Compare what `Client.get_versions` says of the workers with this process.

    Raises
    ------
    VersionMismatchError
        The first difference, by name and with both versions.
    """
    ours = versions["client"]["packages"]
    for address, told in versions["workers"].items():
        theirs = told["packages"]
        for name in ("python", *LIBRARIES):
            here, there = _version(name, ours), _version(name, theirs)
            if here != there:
                raise VersionMismatchError(
                    f"the worker {address} has {name} {there or '(none)'}, this process has "
                    f"{here}: results could differ; install the same version there"
                )


def _version(name: str, packages: Mapping[str, Any]) -> str:
    found = str(packages.get(name) or "")
    return ".".join(found.split(".")[:2]) if name == "python" else found
