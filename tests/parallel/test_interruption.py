"""Ctrl-C or a kill in mid-sweep: what is done is kept, and no process stays behind."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parent))
from sweep_work import Draw, draw, same

from skinmap.parallel import Workers, open_workers, run_tasks

DEADLINE = 120.0  # seconds until a process that was killed must be gone
SWEEP = """
import sys
from pathlib import Path
sys.path[:0] = [sys.argv[1]]
from sweep_work import Draw, draw
from skinmap.interrupts import interruptible
from skinmap.parallel import run_tasks
from skinmap.parallel import Workers, open_workers
caught = Path(sys.argv[2])
tasks = [Draw(number, caught=caught if number == 3 else None) for number in range(8)]
with interruptible():
    with open_workers(Workers(jobs=2), resume=Path(sys.argv[3]), sweep="draws") as workers:
        run_tasks(draw, tasks, workers=workers, progress=lambda _: print("done", flush=True))
"""


@pytest.mark.parametrize(
    ("kind", "said_last"),
    [
        (signal.SIGINT, "KeyboardInterrupt"),
        (signal.SIGTERM, "skinmap.interrupts.TerminatedError"),
        (signal.SIGKILL, ""),  # no word can be said, but its workers notice
    ],
)
def test_an_interrupted_sweep_can_be_resumed_and_leaves_no_process(tmp_path, kind, said_last):
    caught, kept = tmp_path / "caught", tmp_path / "kept"
    os.mkfifo(caught)
    words = [sys.executable, "-c", SWEEP, str(Path(__file__).parent), str(caught), str(kept)]
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as running:
        assert running.stdout is not None
        for _ in range(2):
            assert running.stdout.readline() == "done\n"
        worker = int(caught.read_text())  # it stays in the fourth task until it is killed
        handle = os.pidfd_open(worker)
        if kind == signal.SIGINT:
            os.killpg(running.pid, kind)  # what a terminal sends
        else:
            running.send_signal(kind)  # what a person, a service or the system sends
        _, said = running.communicate(timeout=DEADLINE)
    assert running.returncode != 0
    assert said_last in said
    gone, _, _ = select.select([handle], [], [], DEADLINE)  # readable when the process has ended
    os.close(handle)
    assert gone

    caught.with_suffix(".taken").touch()  # nobody is caught any more
    tasks = [Draw(number, caught=caught if number == 3 else None) for number in range(8)]
    with open_workers(Workers(), resume=kept, sweep="draws") as workers:
        assert workers.kept is not None
        assert 2 <= len(workers.kept) < 8
        found = run_tasks(draw, tasks, workers=workers)
        assert workers.kept.recalled >= 2
    assert same(found, run_tasks(draw, [Draw(number) for number in range(8)]))
