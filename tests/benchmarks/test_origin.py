"""Which code made a result: pieces that ran, and what counts as the same piece."""

from __future__ import annotations

import importlib.util
import json
import sys

import pytest

from benchmarks.harness import keep
from benchmarks.harness import record as origin

MODULE = '''"""What it is."""

LIMIT = 3


def used(x):
    """Twice a number."""
    # counted by hand
    return 2 * min(x, LIMIT)


def unused(x):
    return x


class Kept:
    """A thing."""

    size: int = 4

    def half(self):
        return self.size / 2
'''


@pytest.fixture
def pieces(tmp_path, monkeypatch):
    """A function: the pieces that run where `used(1)` of a module is called, and all of it."""
    monkeypatch.setattr(origin, "ROOT", tmp_path)
    (tmp_path / "skinmap").mkdir()
    count = iter(range(100))

    def run(text, *, name="one", call=lambda made: made.used(1)):
        path = tmp_path / "skinmap" / f"{name}{next(count)}.py"
        path.write_text(text)
        spec = importlib.util.spec_from_file_location(path.stem, path)
        made = importlib.util.module_from_spec(spec)
        with origin.watched() as found:
            spec.loader.exec_module(made)
            call(made)
        every = origin.today()
        path.unlink()
        return found, every

    return run


def test_what_ran_is_known_and_what_did_not_is_not(pieces):
    found, every = pieces(MODULE)
    assert found < every
    assert len(every) == 5  # the limit, the size, and three functions
    assert len(every - found) == 2  # `unused` and `half`


def test_a_module_of_which_nothing_ran_is_behind_no_result(pieces):
    assert pieces(MODULE, call=lambda _: None)[0] == set()


@pytest.mark.parametrize(
    ("old", "new", "same"),
    [
        ("# counted by hand", "# counted again", True),
        ('"""Twice a number."""', '"""The double."""', True),
        ("return 2 * min(x, LIMIT)", "return (\n        2 * min(x, LIMIT)\n    )", True),
        ("\n\n\ndef used", "\n\n\ndef new():\n    return 1\n\n\ndef used", True),
        ("    return x\n", "    return -x\n", True),  # it did not run
        ("return 2 * min", "return 2 * max", False),
        ("LIMIT = 3", "LIMIT = 4", False),
        ("size: int = 4", "size: int = 5", False),
    ],
)
def test_only_code_that_ran_changes_a_result(pieces, old, new, same):
    found, _ = pieces(MODULE)
    assert old in MODULE
    later = pieces(MODULE.replace(old, new), name="moved")[1]
    share = origin.changed({"code": " ".join(found)}, later)
    assert (share == 0.0) == same


def test_a_result_without_its_code_has_no_age():
    assert origin.changed({"commit": "abc1234"}, frozenset()) is None


def test_a_trace_that_was_there_goes_on(pieces):
    before = sys.gettrace()
    pieces(MODULE)
    assert sys.gettrace() is before


def test_a_kept_command_has_its_head_its_words_and_its_code(tmp_path, monkeypatch):
    monkeypatch.setenv("SKINMAP_CACHE", str(tmp_path))
    found = keep.run(["list", "parts", "kaspar"])
    made = found.pop("made")
    assert {"commit", "clean", "date", "versions", "python", "command", "code"} <= set(made)
    assert made["command"] == "skinmap list parts kaspar"
    assert origin.changed({"made": made}, origin.today()) == 0.0
    assert found
    with pytest.raises(ValueError, match="one process"):
        keep.run(["evaluate", "--protocol", "kaspar", "--jobs", "4"])


def test_a_full_run_of_an_area_has_the_code_of_its_quick_one(tmp_path, pieces):
    from benchmarks.harness import record

    (tmp_path / "skinmap" / "area.py").write_text(MODULE)
    spec = importlib.util.spec_from_file_location("area", tmp_path / "skinmap" / "area.py")
    area = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(area)
    ran = []

    def measure(quick):
        ran.append(quick)
        return {"two": area.used(1)}

    out = tmp_path / "area.json"
    record.command(measure, "An area.", "area", ["--out", str(out)])
    result = json.loads(out.read_text())
    assert ran == [False, True]
    assert result["two"] == 2
    assert origin.changed(result, origin.today()) == 0.0
    (tmp_path / "skinmap" / "area.py").write_text(MODULE.replace("return 2 *", "return 3 *"))
    assert origin.changed(result, origin.today()) > 0.0
