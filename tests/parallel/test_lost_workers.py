"""Workers that are killed in mid-sweep: their tasks go to others, and no bit changes."""

from __future__ import annotations

import os
import signal
import sys
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from skinmap.errors import SkinWarning, UnreachableError
from skinmap.parallel import Workers, run_tasks

sys.path.append(str(Path(__file__).parent))  # worker processes get it with the rest of the path
import sweep_work
from sweep_work import Draw, draw, same

TASKS = [Draw(number) for number in range(8)]


@pytest.fixture(scope="module")
def serial():
    return run_tasks(draw, TASKS)


@pytest.fixture(scope="module")
def cluster():
    """Two worker processes on this machine, for itself alone."""
    distributed = pytest.importorskip("distributed", reason="the extra dask is not installed")
    with distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=True,
        dashboard_address="127.0.0.1:0",
        host="127.0.0.1",
        silence_logs=50,  # a killed worker is what is tested, and no news
    ) as made:
        yield made


def kill_who_takes_it(caught: Path) -> threading.Thread:
    """A thread that kills the process that the task in the FIFO says it runs in."""
    os.mkfifo(caught)
    killed: list[int] = []

    def kill() -> None:
        with caught.open() as fifo:  # returns when the task runs
            killed.append(int(fifo.read()))
        os.kill(killed[0], signal.SIGKILL)

    thread = threading.Thread(target=kill, daemon=True)
    thread.killed = killed  # type: ignore[attr-defined]
    thread.start()
    return thread


def with_one_caught(caught: Path) -> list[Draw]:
    return [replace(task, caught=caught if task.number == 3 else None) for task in TASKS]


def test_a_killed_worker_of_a_cluster_changes_nothing(cluster, serial, tmp_path):
    thread = kill_who_takes_it(tmp_path / "caught")
    workers = Workers(jobs=cluster.scheduler_address)
    found = run_tasks(draw, with_one_caught(tmp_path / "caught"), workers=workers)
    thread.join(60.0)
    assert thread.killed
    assert same(found, serial)


def test_a_killed_local_process_changes_nothing(serial, tmp_path):
    thread = kill_who_takes_it(tmp_path / "caught")
    with pytest.warns(SkinWarning, match=r"on this machine died .* given to others"):
        found = run_tasks(draw, with_one_caught(tmp_path / "caught"), workers=Workers(jobs=2))
    thread.join(60.0)
    assert thread.killed
    assert same(found, serial)


@pytest.mark.filterwarnings("ignore:workers on this machine died")
def test_a_task_that_kills_whoever_takes_it_ends_in_a_line(monkeypatch):
    monkeypatch.setattr("skinmap.parallel.run.LOSSES", 1)
    with pytest.raises(UnreachableError, match=r"died 2 times .* fewer --jobs may help"):
        run_tasks(sweep_work.kill_own_process, range(3), workers=Workers(jobs=2))


def test_an_error_in_a_worker_is_the_error_of_the_task():
    from skinmap.errors import UnknownNameError

    with pytest.raises(UnknownNameError, match="no number 'four'; the numbers are: three, five"):
        run_tasks(sweep_work.fail_at_four, range(9), workers=Workers(jobs=2))
