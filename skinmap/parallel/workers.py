"""Who runs the tasks of a sweep, and where its results are kept."""

from __future__ import annotations

import fcntl
import io
import itertools
import json
import os
import sys
import threading
import time
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, fields, is_dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from skinmap.disk_cache import Arrays, Cache
from skinmap.errors import (
    DataFormatError,
    InvalidArrayError,
    OutputError,
    UnreachableError,
    VersionMismatchError,
)
from skinmap.imports import import_optional

# One thread in the numeric libraries of each process: the processes share the cores already, and
# sums keep their order.
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


LOOK = 0.5  # seconds between a worker's looks after the process that started it
CONNECT_SECONDS = 5.0  # a scheduler that does not answer by then is not there
WORKER_SECONDS = 5.0  # for the first worker to appear at a scheduler that has none
ABSENT_SECONDS = 60.0  # without any worker, or without the scheduler, before a sweep is given up
LOOK_SECONDS = 2.0  # between looks at who is there while nothing gets done
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
            check_versions(self._client.get_versions(packages=list(COMPARED)))
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
        for name in ("python", *COMPARED):
            here, there = _version(name, ours), _version(name, theirs)
            if here != there:
                raise VersionMismatchError(
                    f"the worker {address} has {name} {there or '(none)'}, this process has "
                    f"{here}: results could differ; install the same version there"
                )


def _version(name: str, packages: Mapping[str, Any]) -> str:
    found = str(packages.get(name) or "")
    return ".".join(found.split(".")[:2]) if name == "python" else found


FORMAT = 2
MARK = "skinmap_resume"
HEAD, KIND = "sweep.json", "results"
# What decides about the bits of a result beside the task's content.
LIBRARIES = ("skinmap", "numpy", "scipy", "scikit-learn", "libigl")
# And about whether a task can be read elsewhere; there Python counts too, by its minor version.
COMPARED = (*LIBRARIES, "cloudpickle")
NO_LIMIT = 1 << 62  # results that were waited for are never dropped
KINDS = "biufcSUMm"  # of arrays: no objects, which would be pickled
TREE = "tree"
OURS = ("skinmap", "calibration", "viewer")  # packages whose dataclasses are read back


class ResumeStore:
    """Finished results on disk, found by the key of their task.

    An entry stands in the store as soon as its task is done, so that a killed run loses at most the
    tasks under way. It is found by the content of its task: another setting, seed or skin has
    another key, and nothing of another sweep is ever taken for ours.

    Parameters
    ----------
    path : Path
        A folder, made where it does not exist.
    sweep : str
        What the results are of ("evaluate kaspar").

    Raises
    ------
    DataFormatError
        Something else than such a folder, or the results of another sweep or version.
    OutputError
        A folder that cannot be written, or that another run has open.

    Notes
    -----
    Results of another version of Skinmap or of the libraries below it are refused: their bits may
    differ. Damaged entries are computed again, with a warning.
    """

    def __init__(self, path: Path, sweep: str) -> None:
        self.path, self.sweep = path, sweep
        self.recalled = 0
        self._store = Cache(path, limit=NO_LIMIT)
        try:
            self._head = self._open()
        except OutputError:
            raise
        except OSError as error:
            raise self._cannot_write(error) from None
        self._keys = {entry.path.stem for entry in self._store.entries() if entry.kind == KIND}

    def __enter__(self) -> ResumeStore:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __len__(self) -> int:
        return len(self._keys)

    def recall(self, key: str) -> Any:
        """The result under a key; KeyError where there is none or it cannot be read."""
        if key not in self._keys:
            raise KeyError(key)
        arrays = self._store.get(KIND, key)
        try:
            result = unpack(arrays or {})
        except (ValueError, LookupError, TypeError, RecursionError):
            self._keys.discard(key)
            raise KeyError(key) from None
        self.recalled += 1
        return result

    def keep(self, key: str, result: Any) -> None:
        """Write a result down, at once.

        Raises
        ------
        OutputError
            The disk is full or gone.
        """
        try:
            self._store.write(KIND, key, pack(result), packed=True)
        except OSError as error:
            raise self._cannot_write(error) from None
        self._keys.add(key)

    def close(self) -> None:
        """Let others have the folder; may be called twice."""
        self._head.close()

    def _open(self) -> io.TextIOWrapper:
        """The head, locked for this run alone; made where there is none."""
        empty = self.path.is_dir() and not any(self.path.iterdir())
        if self.path.exists() and not empty and not (self.path / HEAD).is_file():
            raise self._no_store()
        self.path.mkdir(mode=0o700, exist_ok=True)
        file = (self.path / HEAD).open("a+", encoding="utf-8", errors="replace")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            file.seek(0)
            if text := file.read():
                self._check_head(text)
            else:
                head = {MARK: FORMAT, "sweep": self.sweep, "versions": _versions()}
                file.write(json.dumps(head))
                file.flush()
        except BaseException as error:
            with suppress(OSError):  # what waits to be written cannot be
                file.close()
            if isinstance(error, BlockingIOError):
                raise OutputError(f"{str(self.path)!r} is in use by another run") from None
            raise
        return file

    def _check_head(self, text: str) -> None:
        """Refuse other folders, and results of other versions, whose bits may differ."""
        try:
            head = json.loads(text)
            versions = {**head["versions"], "format": head[MARK]}
            sweep = str(head["sweep"])
        except (ValueError, LookupError, TypeError, RecursionError):
            raise self._no_store() from None
        if sweep != self.sweep:
            raise DataFormatError(
                f"holds the results of {sweep[:100]!r}, this is {self.sweep!r}; name another "
                "folder",
                self.path,
            )
        for name, ours in {"format": FORMAT, **_versions()}.items():
            if (theirs := versions.get(name)) != ours:
                raise DataFormatError(
                    f"holds results of {name} {theirs!r} (this is {ours!r}), which may differ; "
                    "name another folder",
                    self.path,
                )

    def _no_store(self) -> DataFormatError:
        return DataFormatError(
            f"not a folder of results to resume (it lacks the mark: {HEAD} is missing or of "
            "another user); name another, or a new one",
            self.path,
        )

    def _cannot_write(self, error: OSError) -> OutputError:
        reason = error.strerror or type(error).__name__
        return OutputError(f"cannot write {str(self.path)!r}: {reason}")


def pack(value: Any) -> Arrays:
    """A result as arrays that read back to the same bits, one of which is its structure.

    Raises
    ------
    InvalidArrayError
        Something other than numbers, texts, bytes, arrays, lists, tuples, dicts, our dataclasses.
    """
    arrays: Arrays = {}
    tree = json.dumps(_plain(value, arrays), separators=(",", ":")).encode()
    return {**arrays, TREE: np.frombuffer(tree, np.uint8)}


def unpack(arrays: Arrays) -> Any:
    """What `pack` made arrays of.

    Raises
    ------
    ValueError, LookupError, TypeError, RecursionError
        Arrays that it did not make.
    """
    return _whole(json.loads(arrays[TREE].tobytes()), arrays)


def _plain(value: Any, arrays: Arrays) -> Any:
    """What JSON holds as it is; arrays by name, tuples, bytes and dicts by a tag."""
    if value is None or type(value) in (bool, int, float, str):
        return value
    if isinstance(value, bytes):
        return {"bytes": _named(np.frombuffer(value, np.uint8), arrays)}
    if isinstance(value, np.ndarray):
        return {"array": _named(value, arrays)}
    if isinstance(value, np.generic):
        return {"number": _named(np.asarray(value), arrays)}
    if type(value) is list:
        return [_plain(item, arrays) for item in value]
    if type(value) is tuple:
        return {"tuple": [_plain(item, arrays) for item in value]}
    if type(value) is dict:
        pairs = [[_plain(key, arrays), _plain(item, arrays)] for key, item in value.items()]
        return {"dict": pairs}
    if is_dataclass(value) and type(value).__module__.split(".")[0] in OURS:
        kind = f"{type(value).__module__}:{type(value).__name__}"
        return {"row": [kind, *(_plain(getattr(value, one.name), arrays) for one in fields(value))]}
    raise InvalidArrayError(f"a result holds a {type(value).__qualname__}, which cannot be kept")


def _named(array: NDArray[Any], arrays: Arrays) -> str:
    if array.dtype.kind not in KINDS:
        raise InvalidArrayError(f"a result holds an array of {array.dtype}, which cannot be kept")
    name = f"a{len(arrays)}"
    arrays[name] = array
    return name


def _whole(value: Any, arrays: Arrays) -> Any:
    if isinstance(value, list):
        return [_whole(item, arrays) for item in value]
    if not isinstance(value, dict):
        return value
    ((tag, held),) = value.items()
    if tag == "tuple":
        return tuple(_whole(item, arrays) for item in held)
    if tag == "dict":
        return {_whole(key, arrays): _whole(item, arrays) for key, item in held}
    if tag == "row":
        module, _, name = held[0].partition(":")
        kind = getattr(sys.modules.get(module), name, None)  # of what the task itself imported
        if module.split(".")[0] not in OURS or not (isinstance(kind, type) and is_dataclass(kind)):
            raise ValueError(f"{held[0]} is not a dataclass of ours")
        values = [_whole(item, arrays) for item in held[1:]]
        return kind(**dict(zip((one.name for one in fields(kind)), values, strict=True)))
    array = arrays[held]
    return {"array": array, "number": array[()], "bytes": array.tobytes()}[tag]


def _versions() -> dict[str, str]:
    return {name: version(name) for name in LIBRARIES}


@dataclass(frozen=True, slots=True)
class Workers:
    """Who runs the tasks.

    Attributes
    ----------
    jobs : int or str
        Processes of this machine, of which 1 runs everything in this one; or the address of a Dask
        scheduler ("tcp://host:8786").
    kept : ResumeStore or None
        Where finished results are kept and found again.
    pool : Pool or None
        The workers themselves where they were reached already (`open_workers`).
    """

    jobs: int | str = 1
    kept: ResumeStore | None = None
    pool: Pool | None = None

    def __post_init__(self) -> None:
        if isinstance(self.jobs, int) and self.jobs < 1:
            raise InvalidArrayError(f"at least 1 job, got {self.jobs}")


ONE = Workers()


@contextmanager
def open_workers(
    workers: Workers, *, resume: Path | None = None, sweep: str = ""
) -> Iterator[Workers]:
    """The workers, reached once for several calls of `run_tasks`, before anything is computed.

    Parameters
    ----------
    workers : Workers
    resume : Path, optional
        Folder of the results that are finished.
    sweep : str
        What they are results of ("evaluate kaspar"); a folder of another sweep is refused.

    Raises
    ------
    UnreachableError, MissingLibraryError, VersionMismatchError
        See `run_tasks`.
    DataFormatError, OutputError
        See `ResumeStore`.

    Yields
    ------
    Workers

    Examples
    --------
    >>> import math
    >>> from skinmap.parallel import Workers, open_workers, run_tasks
    >>> with open_workers(Workers(jobs=1)) as workers:
    ...     run_tasks(math.factorial, [3, 4], workers=workers)
    [6, 24]
    """
    with opened_pool(workers) as pool:
        if resume is None:
            yield replace(workers, pool=pool)
            return
        with ResumeStore(resume, sweep) as kept:
            yield replace(workers, pool=pool, kept=kept)


@contextmanager
def opened_pool(workers: Workers) -> Iterator[Pool | None]:
    """The pool of some workers, None for this process; one that is open already stays so."""
    if workers.pool is not None:
        yield workers.pool
    elif isinstance(workers.jobs, str):
        with closing(ClusterPool(workers.jobs)) as pool:
            yield pool
    elif workers.jobs > 1:
        yield LocalPool(workers.jobs)
    else:
        yield None
