"""Workers of a Dask cluster: reached, found to have our versions, given tasks."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Collection, Mapping
from typing import Any

from skinmap.errors import MissingLibraryError, UnreachableError, VersionMismatchError
from skinmap.parallel.pool import WorkersLostError

CONNECT_SECONDS = 5.0  # a scheduler that does not answer by then is not there
WORKER_SECONDS = 5.0  # for the first worker to appear at a scheduler that has none
ABSENT_SECONDS = 60.0  # without any worker, or without the scheduler, before a sweep is given up
LOOK_SECONDS = 2.0  # between looks at who is there while nothing gets done
# What decides about bits and about whether a task can be read; Python by its minor version.
LIBRARIES = ("skinmap", "numpy", "scipy", "scikit-learn", "libigl", "cloudpickle")
LARGE = "distributed.admin.large-graph-warning-threshold"
_numbers = itertools.count()


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
        from distributed.scheduler import KilledWorker

        try:
            return future.result()
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


def connect(address: str) -> Any:
    """A client of the Dask scheduler at an address.

    Raises
    ------
    UnreachableError, MissingLibraryError
    """
    try:
        from distributed import Client
    except ImportError:
        raise MissingLibraryError(
            "the backend dask needs dask and distributed: install skinmap[dask]"
        ) from None
    import warnings

    try:
        with warnings.catch_warnings():
            # Versions are compared below, and a difference is more than a warning.
            warnings.filterwarnings("ignore", "Mismatched versions found")
            return Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
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
