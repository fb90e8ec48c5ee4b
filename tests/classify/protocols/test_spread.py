from __future__ import annotations

import json
import math
import socket
import time

import numpy as np
import pytest

from skinmap.errors import UnreachableError
from skinmap.parallel import Workers, run_tasks, task_rng, workers
from skinmap.recognition.protocols.kaspar import evaluate_kaspar
from skinmap.report.result import plain

SMALL = dict.fromkeys(("poke", "full_finger", "three_finger", "whole_hand"), 240)


def table(skin, workers):
    return evaluate_kaspar(skin, seeds=[4], samples=SMALL, percents=[20], workers=workers)


@pytest.fixture(scope="module")
def by_one(kaspar_skin):
    return table(kaspar_skin("right_hand"), Workers())


def test_tasks_come_back_in_order_whoever_ran_them():
    told: list[str] = []
    expected = [math.factorial(number) for number in range(9)]
    assert run_tasks(math.factorial, range(9), progress=told.append) == expected
    assert len(told) == 9
    assert run_tasks(math.factorial, range(9), workers=Workers(jobs=2)) == expected


def test_seeds_of_tasks_differ_and_stay():
    first = [task_rng(3, number).random() for number in range(5)]
    assert len({*first, *(task_rng(4, number).random() for number in range(5))}) == 10
    assert [task_rng(3, number).random() for number in range(5)] == first


def test_two_jobs_give_the_table_of_one(kaspar_skin, by_one):
    assert table(kaspar_skin("right_hand"), Workers(jobs=2)) == by_one


def test_a_dask_cluster_gives_the_table_of_one_job(kaspar_skin, by_one):
    distributed = pytest.importorskip("distributed", reason="the extra dask is not installed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address="127.0.0.1:0"
    ) as cluster:
        workers = Workers(jobs=cluster.scheduler_address)
        assert table(kaspar_skin("right_hand"), workers) == by_one


def test_the_table_has_every_row_once(by_one):
    keys = [(row.percent, row.folds, row.features, row.classifier) for row in by_one]
    assert len(set(keys)) == len(keys) == 10
    for row in by_one:
        assert set(row.per_class) == set(SMALL)
        assert row.mean == pytest.approx(np.mean(list(row.per_class.values())))
        assert row.samples == 4 * 48
        assert 0.25 <= row.mean <= 1.0  # four gestures: chance
    json.dumps(plain(by_one))


def test_nobody_at_the_address_is_said_within_seconds(monkeypatch):
    pytest.importorskip("distributed", reason="the extra dask is not installed")
    assert workers.CONNECT_SECONDS <= 5.0
    monkeypatch.setattr(workers, "CONNECT_SECONDS", 0.5)
    with socket.socket() as free:  # bound and not listening: connections are refused
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
        start = time.monotonic()
        with pytest.raises(UnreachableError, match=f"no Dask scheduler answers at '{address}'"):
            run_tasks(math.factorial, [1], workers=Workers(jobs=address))
        assert time.monotonic() - start < 60.0  # not a measurement: it must come to an end
    with pytest.raises(UnreachableError, match="expected an address like"):
        run_tasks(math.factorial, [1], workers=Workers(jobs="nonsense://nowhere"))
