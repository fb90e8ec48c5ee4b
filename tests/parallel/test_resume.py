"""Results that survive an interruption, and files that are not what they should be."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from skinmap.disk_cache import CacheWarning, content_key
from skinmap.errors import DataFormatError, InvalidArrayError, OutputError
from skinmap.parallel import run_tasks
from skinmap.parallel.workers import ONE, ResumeStore, Workers, open_workers, pack, unpack

sys.path.append(str(Path(__file__).parent))
from sweep_work import Draw, draw, same

NUMBERS = range(6)


def sweep(path: Path, tasks: list[Draw], workers: Workers = ONE, **options) -> list:
    with open_workers(workers, resume=path, sweep="draws") as opened:
        return run_tasks(draw, tasks, workers=opened, **options)


@pytest.fixture
def tasks(tmp_path):
    (tmp_path / "runs").mkdir()
    return [Draw(number, folder=tmp_path / "runs") for number in NUMBERS]


@pytest.fixture
def runs(tmp_path):
    """A function: how often each task was computed."""

    def count() -> list[int]:
        names = [path.name.split(".")[0] for path in (tmp_path / "runs").iterdir()]
        return [names.count(str(number)) for number in NUMBERS]

    return count


class StoppedError(Exception):
    """An interruption."""


def stop_after(count: int):
    told: list[str] = []

    def progress(words: str) -> None:
        told.append(words)
        if len(told) == count:
            raise StoppedError

    return progress


@pytest.mark.parametrize("workers", [ONE, Workers(jobs=2)], ids=["one", "two"])
def test_a_resumed_run_computes_only_what_is_left(tmp_path, tasks, runs, workers):
    whole = [draw(replace(task, folder=None)) for task in tasks]
    with pytest.raises(StoppedError):
        sweep(tmp_path / "sweep", tasks, progress=stop_after(3))
    assert runs() == [1, 1, 1, 0, 0, 0]
    told: list[str] = []
    assert same(sweep(tmp_path / "sweep", tasks, workers, progress=told.append), whole)
    assert runs() == [1] * 6
    assert sorted(told) == [""] * 3 + ["resumed"] * 3
    assert same(sweep(tmp_path / "sweep", tasks), whole)
    assert runs() == [1] * 6


def entries(path: Path) -> list[Path]:
    """Files of the results, in the order in which they were made."""
    return sorted(path.rglob("*.npz"), key=lambda file: file.stat().st_mtime_ns)


def test_an_entry_that_was_half_written_is_computed_again(tmp_path, tasks, runs):
    path = tmp_path / "sweep"
    whole = sweep(path, tasks)
    last = entries(path)[-1]
    last.rename(last.with_suffix(".partial"))  # what a killed process leaves
    assert same(sweep(path, tasks), whole)
    assert same(sweep(path, tasks), whole)
    assert runs() == [1, 1, 1, 1, 1, 2]


@pytest.mark.parametrize("damage", [lambda data: data[:-20], lambda data: data[::-1]])
def test_a_damaged_entry_is_computed_again_with_a_warning(tmp_path, tasks, runs, damage):
    path = tmp_path / "sweep"
    whole = sweep(path, tasks)
    file = entries(path)[1]
    file.write_bytes(damage(file.read_bytes()))
    with pytest.warns(CacheWarning, match=r"cannot be read .*; it is made anew"):
        assert same(sweep(path, tasks), whole)
    assert runs() == [1, 2, 1, 1, 1, 1]


def test_an_entry_of_somebody_else_is_computed_again(tmp_path, tasks, runs):
    path = tmp_path / "sweep"
    whole = sweep(path, tasks)
    np.savez(entries(path)[1], tree=np.frombuffer(b'{"array":"a7"}', np.uint8))
    assert same(sweep(path, tasks), whole)
    assert runs() == [1, 2, 1, 1, 1, 1]


def test_results_of_another_version_are_refused(tmp_path, tasks, runs, monkeypatch):
    path = tmp_path / "sweep"
    sweep(path, tasks)
    monkeypatch.setattr("skinmap.parallel.workers.version", lambda name: f"99 of {name}")
    with pytest.raises(DataFormatError, match=r"results of skinmap .* \(this is '99 of skinmap'\)"):
        sweep(path, tasks)
    assert runs() == [1] * 6
    assert len(entries(path)) == len(tasks)


def test_results_of_another_sweep_are_refused(tmp_path, tasks):
    ResumeStore(tmp_path / "sweep", "evaluate kaspar").close()
    with pytest.raises(DataFormatError, match="holds the results of 'evaluate kaspar', this is"):
        sweep(tmp_path / "sweep", tasks)


@pytest.mark.parametrize("content", [b"\x89PNG\r\n", b"[]\n", b"{}\n", b"channel,x,y\n1,2,3\n"])
def test_what_is_of_another_kind_is_refused_and_kept(tmp_path, content):
    path, folder, head = tmp_path / "other", tmp_path / "folder", tmp_path / "head"
    path.write_bytes(content)
    for place, name in ((folder, "table.csv"), (head, "sweep.json")):
        place.mkdir()
        (place / name).write_bytes(content)
    for place in (path, folder, head):
        with pytest.raises(DataFormatError, match="not a folder of results to resume"):
            ResumeStore(place, "draws")
    for file in (path, folder / "table.csv", head / "sweep.json"):
        assert file.read_bytes() == content


def test_a_store_in_use_and_a_folder_that_is_not_there_are_refused(tmp_path):
    first = ResumeStore(tmp_path / "sweep", "draws")
    with pytest.raises(OutputError, match="is in use by another run"):
        ResumeStore(tmp_path / "sweep", "draws")
    first.close()
    with pytest.raises(OutputError, match=r"cannot write .*No such file"):
        ResumeStore(tmp_path / "gone" / "sweep", "draws")


PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.binary(),
    lambda inner: (
        st.lists(inner) | st.tuples(inner, inner)
        | st.dictionaries(st.text() | st.tuples(st.text(), st.integers()), inner)
    ),
    max_leaves=8,
)  # fmt: skip


@given(PLAIN)
def test_results_are_read_as_they_were_written(value):
    # repr tells -0.0 from 0.0 and lists from tuples, and holds that NaN is NaN.
    assert repr(unpack(pack(value))) == repr(value)


@pytest.mark.parametrize("kind", ["f4", ">f8", "u1", "?", "U3", "c16", "i8"])
def test_arrays_are_read_to_the_same_bits(kind):
    array = np.arange(12).reshape(3, 4).astype(kind)
    back = unpack(pack([array, array[0, 1], array[:0]]))
    assert back[0].dtype == array.dtype
    assert back[0].tobytes() == array.tobytes()
    assert back[0].flags.writeable
    assert back[1] == array[0, 1]
    assert type(back[1]) is type(array[0, 1])
    assert back[2].shape == (0, 4)


def test_what_cannot_be_kept_is_said():
    with pytest.raises(InvalidArrayError, match="a result holds a Draw"):
        pack([Draw(1)])
    with pytest.raises(InvalidArrayError, match="an array of object"):
        pack(np.array([None]))


@given(st.text() | st.from_regex(r'\{"(array|number|bytes|tuple|dict)":\[.{0,40}\]\}'))
def test_entries_from_elsewhere_run_nothing(text):
    tree = np.frombuffer(text.encode("utf-8", "replace"), np.uint8)
    try:
        unpack({"tree": tree})
    except (ValueError, LookupError, TypeError, RecursionError):
        return


@dataclass(frozen=True, eq=False)
class Held:
    array: np.ndarray
    name: str = "a"


def test_keys_tell_contents_apart_and_nothing_else(prepared):
    skin = prepared("left_foot")
    tasks = [
        Held(np.arange(4)), Held(np.arange(4), "b"), Held(np.arange(4.0)),
        Held(np.arange(4).reshape(2, 2)), Draw(1), Draw(2), [1, 2], [[1], 2], "12", 12, 12.0,
        True, None, {"a": 1}, {"a": 2}, {"b": 1}, skin, [skin, skin], b"12", Path("12"),
    ]  # fmt: skip
    keys = [content_key(draw, task) for task in tasks]
    assert len({*keys}) == len(keys)
    assert content_key(draw, Held(np.arange(8)[::2] // 2)) == keys[0]
    assert content_key(same, Draw(1)) != keys[4]
    skin.hoods  # noqa: B018 - what is computed of a skin does not change what it is
    assert content_key(draw, skin) == keys[16]
    with pytest.raises(InvalidArrayError, match="without a list of its content"):
        content_key(draw, object())
    with pytest.raises(InvalidArrayError, match="has no name to key a result by"):
        content_key(lambda task: task, 1)
