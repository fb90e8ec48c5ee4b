"""The harness: one process an area, failures reported."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from benchmarks import ROOT


def areas_of(**codes):
    """Planted areas, each a module of so much code."""
    from benchmarks.harness.areas import Area

    return {name: Area(f"planted_{name}", "planted", seconds=60.0) for name in codes}


@pytest.fixture
def planted_areas(tmp_path, monkeypatch):
    """Areas whose children run a harness of the test's own: a folder with planted modules."""

    def plant(**codes):
        from benchmarks.harness import bench

        folder = tmp_path / "modules"
        folder.mkdir()
        for name, code in codes.items():
            (folder / f"planted_{name}.py").write_text(code)
        table = ", ".join(f"{n!r}: areas.Area('planted_{n}', 'planted')" for n in codes)
        (folder / "child.py").write_text(
            f"import sys\nsys.path[:0] = [{str(folder)!r}, {str(ROOT)!r}]\n"
            "from benchmarks.harness import areas, bench\n"
            f"areas.AREAS = {{{table}}}\n"
            "raise SystemExit(bench.main(sys.argv[1:]))\n"
        )
        monkeypatch.setattr(bench, "PROGRAM", (sys.executable, str(folder / "child.py")))
        monkeypatch.setattr(bench.areas, "AREAS", areas_of(**codes))
        return bench

    return plant


GOOD = "def measure(quick, *, n=3): return {'n': n, 'quick': quick}"


def test_a_failing_area_is_reported_and_hides_no_other(planted_areas, tmp_path):
    bench = planted_areas(
        first=GOOD,
        broken="def measure(quick): raise ValueError('no such wheel')",
        gone="import os\ndef measure(quick): os._exit(7)",
        last=GOOD,
    )
    keep = tmp_path / "kept.json"
    result = bench.measure_all(("first", "broken", "gone", "last"), "quick", keep)
    areas = result["areas"]
    assert areas["first"]["rows"] == areas["last"]["rows"] == {"n": 3, "quick": True}
    assert areas["broken"]["failed"] == "exit 1: ValueError: no such wheel"
    assert areas["gone"]["failed"] == "exit 7: it said nothing"
    assert set(json.loads(keep.read_text())["areas"]) == set(areas)


def test_an_area_that_takes_too_long_is_ended_with_all_that_it_started(planted_areas):
    code = "import subprocess\ndef measure(quick): subprocess.run(['sleep', '600'])"
    bench = planted_areas(slow=code)
    area = bench.areas.Area("planted_slow", "planted", seconds=1.0)
    found = bench.measure_one("slow", area, "short")
    assert found["failed"] == "took longer than 1 s"
    assert found["seconds"] < 60.0  # not the 600 s of what it started


def test_the_short_form_passes_on_what_a_module_takes(monkeypatch):
    from benchmarks.harness import areas

    took = {}

    class Module:
        @staticmethod
        def measure(quick, *, n=1):
            took[quick] = n
            return {}

    monkeypatch.setattr(areas, "import_module", lambda _: Module)
    area = areas.Area("x", "x", {"n": 7, "unknown": 3})
    for form in ("short", "full", "quick"):
        areas.run(area, form)
        assert took.pop(form == "quick") == (7 if form == "short" else 1)


def test_a_harness_that_is_ended_ends_the_area_that_runs(planted_areas, tmp_path):
    pid = tmp_path / "pid"
    code = (
        "import os, pathlib, time\ndef measure(quick):\n"
        f" pathlib.Path({str(pid)!r} + '_').write_text(str(os.getpid()))\n"
        f" os.rename({str(pid)!r} + '_', {str(pid)!r})\n time.sleep(600)"
    )
    bench = planted_areas(slow=code)
    program = Path(bench.PROGRAM[-1]).with_name("harness.py")
    text = (
        Path(bench.PROGRAM[-1])
        .read_text()
        .replace("raise SystemExit", f"bench.PROGRAM = {bench.PROGRAM!r}\nraise SystemExit")
    )
    program.write_text(text)
    out = str(tmp_path / "x.json")
    harness = subprocess.Popen([sys.executable, str(program), "--quick", "--out", out])
    wait_for(pid.exists)
    harness.terminate()
    assert harness.wait(60) == 128 + signal.SIGTERM
    wait_for(lambda: not Path(f"/proc/{pid.read_text()}/cmdline").is_file()
             or not Path(f"/proc/{pid.read_text()}/cmdline").read_bytes())  # fmt: skip


def wait_for(condition):
    """Wait until something holds, at most a minute."""
    deadline = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < deadline
        threading.Event().wait(0.05)


def test_take_turns_gives_cpu_of_each_turn():
    from benchmarks.harness.timing import medians, spreads, take_turns

    calls = []
    tasks = {"a": lambda: calls.append("a"), "b": (lambda: calls.append("b"), 2)}
    times = take_turns(tasks, 3)
    assert calls == ["a", "b"] + ["a", "b", "b"] * 3  # once to warm up, then in turns
    assert {name: len(one) for name, one in times.items()} == {"a": 3, "b": 3}
    assert set(medians(times)) == {"a", "b"}
    assert set(spreads(times)["a"]) == {"cpu"}


def test_quartiles_are_in_order():
    from benchmarks.harness.timing import quartiles

    assert quartiles([5.0, 1.0, 3.0, 2.0, 4.0]) == (2.0, 3.0, 4.0)


def test_results_are_readable_json_with_the_same_values(tmp_path):
    import numpy as np

    from benchmarks.harness.record import write

    result = {"a": [1.0 / 3.0] * 40, "b": {"c": np.float64(2.5), "d": float("nan")}, "n": 12345678}
    write(tmp_path / "x.json", result)
    text = (tmp_path / "x.json").read_text()
    assert json.loads(text) == {"a": [0.333333] * 40, "b": {"c": 2.5, "d": None}, "n": 12345678}
    assert '"b": {"c": 2.5, "d": null}' in text
    assert list(tmp_path.iterdir()) == [tmp_path / "x.json"]
