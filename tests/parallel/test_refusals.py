"""Clusters that cannot be used: nobody there, no workers, other versions, no Dask."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import pytest
from click.testing import CliRunner

from skinmap.cli.main import cli, main
from skinmap.errors import MissingLibraryError, UnreachableError, VersionMismatchError
from skinmap.parallel import Workers, run_tasks
from skinmap.parallel.workers import COMPARED, ClusterPool, check_versions

OURS = dict.fromkeys(COMPARED, "1.2.3") | {"python": "3.11.7.final.0"}
AT = "tcp://10.0.0.9:4711"


def told(*workers: dict[str, str]) -> dict[str, object]:
    """What `Client.get_versions` gives for workers with some other versions."""
    theirs = {f"{AT}{row}": {"packages": OURS | other} for row, other in enumerate(workers)}
    return {"client": {"packages": OURS}, "workers": theirs}


class Client:
    """A client of a scheduler that is not there."""

    def __init__(self, versions: dict[str, object], threads: dict[str, int]) -> None:
        self.versions, self.threads, self.status = versions, threads, "running"

    def nthreads(self) -> dict[str, int]:
        return self.threads

    def wait_for_workers(self, count: int, timeout: float) -> None:
        raise TimeoutError

    def get_versions(self, packages: list[str]) -> dict[str, object]:
        return self.versions

    def close(self) -> None:
        self.status = "closed"


@pytest.fixture
def scheduler(monkeypatch):
    """A function: let this client be what connects."""

    def put(client: Client) -> Client:
        monkeypatch.setitem(
            sys.modules, "distributed", SimpleNamespace(Client=lambda *_, **__: client)
        )
        monkeypatch.setattr("skinmap.parallel.workers.WORKER_SECONDS", 0.0)
        return client

    return put


@pytest.mark.parametrize(
    ("other", "said"),
    [
        ({"numpy": "9.9"}, "has numpy 9.9, this process has 1.2.3"),
        ({"skinmap": "0.0.1"}, "has skinmap 0.0.1, this process has 1.2.3"),
        ({"libigl": None}, r"has libigl \(none\), this process has 1.2.3"),
        ({"python": "3.12.1.final.0"}, "has python 3.12, this process has 3.11"),
    ],
)
def test_workers_of_other_versions_are_named(scheduler, other, said):
    client = scheduler(Client(told({}, other), {f"{AT}0": 1, f"{AT}1": 1}))
    with pytest.raises(VersionMismatchError, match=f"the worker {AT}1 {said}.* install the same"):
        ClusterPool(AT)
    assert client.status == "closed"


def test_another_patch_of_python_is_no_other_version():
    check_versions(told({"python": "3.11.2.final.0"}))


def test_a_scheduler_without_workers_is_said(scheduler):
    client = scheduler(Client(told(), {}))
    with pytest.raises(UnreachableError, match=f"at '{AT}' has no worker; start some with `dask"):
        run_tasks(len, ["a"], workers=Workers(jobs=AT))
    assert client.status == "closed"


def test_threads_of_all_workers_are_used(scheduler):
    client = scheduler(Client(told({}, {}), {f"{AT}0": 3, f"{AT}1": 1}))
    pool = ClusterPool(AT)
    assert pool.size == 4
    pool.close()
    assert client.status == "closed"


def test_without_dask_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingLibraryError, match=r"install skinmap\[dask\]"):
        run_tasks(len, ["a"], workers=Workers(jobs=AT))


@pytest.mark.parametrize("state", ["missing", "other version"])
def test_a_command_ends_with_one_line(monkeypatch, scheduler, capsys, tmp_path, state):
    """Before anything is computed, and nothing is left behind."""
    if state == "missing":
        monkeypatch.setitem(sys.modules, "distributed", None)
    else:
        scheduler(Client(told({"scipy": "0.1"}), {AT: 1}))
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    out = tmp_path / "maps"
    words = ["flatten", str(tmp_path / "a.obj"), "--jobs", AT]
    monkeypatch.setattr(sys, "argv", ["skinmap", *words, "--out", str(out)])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert len(said.err.splitlines()) == 1
    assert ("skinmap[dask]" if state == "missing" else "scipy 0.1") in said.err
    assert not out.exists()


@pytest.mark.parametrize("given", ["0", "many", "257"])
def test_jobs_are_a_number_or_an_address(given):
    result = CliRunner().invoke(cli, ["flatten", "a.obj", "--jobs", given])
    assert result.exit_code == 2
    assert "'--jobs'" in result.output


@pytest.mark.parametrize("given", [["--backend", "dask"], ["--address", AT]])
def test_the_options_of_before_answer(given):
    result = CliRunner().invoke(cli, ["flatten", "a.obj", *given])
    assert result.exit_code == 2
    assert f"{given[0]} was removed: write --jobs tcp://HOST:PORT" in result.output
