"""A scheduler that pauses, and one that is lost and comes back: no bit changes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from skinmap.errors import UnreachableError
from skinmap.parallel import Workers, open_workers, run_tasks

sys.path.append(str(Path(__file__).parent))
from sweep_work import Held, draw_when_told, same

LOOK = 0.5  # [s]: what a sweep waits here before it looks whether anybody is there
PAUSE = 2 * LOOK
DEADLINE = 60.0  # [s]; only a fault takes as long
SCHEDULER = """
import asyncio, sys
sys.path.append(sys.argv[2])
from distributed import Scheduler
async def main():
    async with Scheduler(host="127.0.0.1", port=int(sys.argv[1]), dashboard=False) as one:
        print(one.address, flush=True)
        await one.finished()
asyncio.run(main())
"""
WORKER = """
import asyncio, sys
sys.path.append(sys.argv[2])
from distributed import Worker
async def main():
    async with Worker(sys.argv[1], nthreads=1, dashboard=False) as one:
        print("ready", flush=True)
        await one.finished()
asyncio.run(main())
"""


@contextmanager
def process(script: str, *words: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A process and the first line that it prints."""
    command = [sys.executable, "-c", script, *words]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as made:
        assert made.stdout is not None
        try:
            yield made, made.stdout.readline().strip()
        finally:
            made.send_signal(signal.SIGCONT)
            made.kill()


@contextmanager
def cluster(port: int = 0) -> Iterator[tuple[str, list[subprocess.Popen[str]]]]:
    """Address and processes of a scheduler with one worker."""
    pytest.importorskip("distributed", reason="the extra dask is not installed")
    with ExitStack() as stack:
        here = str(Path(__file__).parent)
        scheduler, address = stack.enter_context(process(SCHEDULER, str(port), here))
        worker, said = stack.enter_context(process(WORKER, address, here))
        assert said == "ready"
        yield address, [scheduler, worker]


def held(folder: Path) -> list[Held]:
    """Eight tasks, of which the fourth waits in its first run."""
    caught, go_on = folder / "caught", folder / "go_on"
    for fifo in (caught, go_on):
        os.mkfifo(fifo)
    return [Held(k, caught, go_on) if k == 3 else Held(k) for k in range(8)]


@pytest.fixture(autouse=True)
def _often(monkeypatch):
    monkeypatch.setattr("skinmap.parallel.workers.LOOK_SECONDS", LOOK)


@pytest.fixture(scope="module")
def serial():
    return run_tasks(draw_when_told, [Held(number) for number in range(8)])


def test_a_pause_of_the_network_changes_nothing(serial, tmp_path):
    tasks = held(tmp_path)
    with cluster() as (address, processes):

        def pause() -> None:
            (tmp_path / "caught").read_text()
            for one in processes:
                one.send_signal(signal.SIGSTOP)
            threading.Event().wait(PAUSE)
            for one in processes:
                one.send_signal(signal.SIGCONT)
            (tmp_path / "go_on").write_text("go on")

        thread = threading.Thread(target=pause, daemon=True)
        thread.start()
        found = run_tasks(draw_when_told, tasks, workers=Workers(jobs=address))
        thread.join(DEADLINE)
    assert same(found, serial)


@pytest.mark.filterwarnings("ignore:workers at")
def test_a_scheduler_that_is_lost_is_a_line_and_the_sweep_goes_on_with_the_next(
    serial, tmp_path, monkeypatch
):
    monkeypatch.setattr("skinmap.parallel.workers.ABSENT_SECONDS", 1.0)
    tasks, kept = held(tmp_path), tmp_path / "kept"
    with cluster() as (address, processes):

        def lose() -> None:
            (tmp_path / "caught").read_text()
            for one in processes:
                one.kill()

        thread = threading.Thread(target=lose, daemon=True)
        thread.start()
        first = Workers(jobs=address)
        with (
            open_workers(first, resume=kept, sweep="draws") as workers,
            pytest.raises(UnreachableError, match="tcp://127"),
        ):
            run_tasks(draw_when_told, tasks, workers=workers)
        thread.join(DEADLINE)
    with (
        cluster(int(address.rpartition(":")[2])) as (again, _),
        open_workers(Workers(jobs=again), resume=kept, sweep="draws") as workers,
    ):
        assert again == address
        found = run_tasks(draw_when_told, tasks, workers=workers)
        assert workers.kept is not None
        assert workers.kept.recalled >= 1
    assert same(found, serial)
