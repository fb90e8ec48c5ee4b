"""The cache: right whatever happens to it, bounded, and safe when two processes write."""

import errno
import json
import os
import resource
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

import skinmap.io.robots.mesh_file as mesh_file
from skinmap.cli.main import cli
from skinmap.disk_cache import Cache, CacheWarning, cached, content_key, open_cache
from skinmap.errors import InvalidArrayError
from skinmap.io.robots.manifest import load_robot

ARRAYS = {"a": np.arange(12.0).reshape(3, 4), "b": np.array([[1, 2]], np.int64)}


class Maker:
    """Makes arrays and counts how often."""

    def __init__(self, arrays=ARRAYS):
        self.arrays, self.made = arrays, 0

    def __call__(self):
        self.made += 1
        return self.arrays


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv("SKINMAP_CACHE", str(tmp_path / "kept"))
    return tmp_path / "kept"


def same(one, other) -> bool:
    return one.keys() == other.keys() and all(
        one[key].dtype == other[key].dtype
        and one[key].flags.f_contiguous == other[key].flags.f_contiguous
        and np.array_equal(one[key], other[key])
        for key in one
    )


def test_what_was_made_is_not_made_again(folder):
    maker = Maker(ARRAYS | {"turned": np.asfortranarray(np.arange(6.0).reshape(2, 3))})
    first = cached("thing", [np.arange(3), "x"], maker)
    second = cached("thing", [np.arange(3), "x"], maker)
    assert maker.made == 1
    assert same(first, second)
    assert cached("thing", [np.arange(3), "y"], maker)["a"].shape == (3, 4)
    assert cached("other", [np.arange(3), "x"], maker)
    assert maker.made == 3


def test_cache_that_is_off_keeps_nothing(folder, monkeypatch):
    monkeypatch.setenv("SKINMAP_CACHE", "off")
    maker = Maker()
    cached("thing", ["x"], maker)
    cached("thing", ["x"], maker)
    assert maker.made == 2
    assert not folder.exists()


def test_another_version_of_what_makes_it_is_another_entry(folder, monkeypatch):
    import skinmap.disk_cache as module

    maker = Maker()
    cached("thing", ["x"], maker, made_by=("trimesh",))
    monkeypatch.setattr(module, "installed", lambda name: "99" if name == "trimesh" else "1")
    cached("thing", ["x"], maker, made_by=("trimesh",))
    assert maker.made == 2


values = st.one_of(
    st.integers(-5, 5),
    st.sampled_from([0.0, -0.0, 1.0, 2.5]),
    st.text(max_size=3),
    st.binary(max_size=3),
)


MAKES = """
import numpy as np
from skinmap.disk_cache import cached
from {name}.helper import factor

def thing():
    return float(cached("thing", ["x"], lambda: dict(value=np.array(factor())))["value"])
"""


def test_what_edited_code_makes_is_another_entry(folder, tmp_path):
    """The version stays the same from one commit to the next."""

    def made(factor: int) -> str:
        package = tmp_path / "maker"
        package.mkdir(exist_ok=True)
        (package / "room.py").write_text(MAKES.format(name="maker"))
        # The algorithm may stand in a module beside the one that asks.
        (package / "helper.py").write_text(f"def factor():\n    return {factor}\n")
        code = "import maker.room; print(maker.room.thing())"
        words = [sys.executable, "-B", "-c", code]
        return subprocess.run(
            words, cwd=tmp_path, env=os.environ | {"SKINMAP_CACHE": str(folder)},
            capture_output=True, text=True, check=True,
        ).stdout.strip()  # fmt: skip

    assert [made(factor) for factor in (2, 3, 2)] == ["2.0", "3.0", "2.0"]
    assert len(Cache(folder).entries()) == 2


@given(st.lists(values, max_size=4), st.lists(values, max_size=4))
def test_hash_tells_different_ingredients_apart(one, other):
    def exact(row):
        return [(type(value), repr(value)) for value in row]

    assert (content_key(*one) == content_key(*other)) == (exact(one) == exact(other))


def test_hash_counts_type_shape_and_bits_of_arrays():
    row = np.arange(6.0)
    kinds = [row, row.reshape(2, 3), row.reshape(3, 2), row.astype(np.float32), row.view(np.int64)]
    assert len({content_key(one) for one in kinds}) == len(kinds)
    assert content_key(row.reshape(2, 3)) == content_key(np.asfortranarray(row.reshape(2, 3)))
    with pytest.raises(InvalidArrayError, match="without a list of its content"):
        content_key(np.array([object()]))


@pytest.mark.fuzz
@given(st.data())
def test_damaged_entry_never_gives_a_wrong_result(tmp_path_factory, data):
    cache = Cache(tmp_path_factory.mktemp("kept"))
    assert cache.put("thing", "key", ARRAYS)
    path = cache.entries()[0].path
    content = bytearray(path.read_bytes())
    if data.draw(st.booleans()):
        content = content[: data.draw(st.integers(0, len(content) - 1))]
    else:
        place = data.draw(st.integers(0, len(content) - 1))
        content[place] ^= 1 << data.draw(st.integers(0, 7))
    path.write_bytes(bytes(content))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CacheWarning)
        got = cache.get("thing", "key")
    # Values are what counts: a flipped bit in a time stamp of the archive does no harm.
    assert got is None or all(np.array_equal(got[key], ARRAYS[key]) for key in got)
    assert got is None or got.keys() <= ARRAYS.keys() or len(got) == len(ARRAYS)


def test_damaged_entry_is_said_and_made_anew(folder):
    maker = Maker()
    cached("thing", ["x"], maker)
    path = open_cache().entries()[0].path
    path.write_bytes(path.read_bytes()[:40])
    with pytest.warns(CacheWarning, match=r"cannot be read .* it is made anew"):
        assert same(cached("thing", ["x"], maker), ARRAYS)
    assert maker.made == 2
    assert same(cached("thing", ["x"], maker), ARRAYS)
    assert maker.made == 2


def test_longest_unused_leave_when_it_is_full(tmp_path):
    block = {"a": np.zeros(1000)}  # 8 kB, and a few hundred bytes of archive
    cache = Cache(tmp_path / "kept", limit=30_000)
    for age, key in enumerate(["old", "middle", "new"]):
        assert cache.put("thing", key, block)
        os.utime(cache._path("thing", key), (1e9 + age, 1e9 + age))
    assert cache.get("thing", "old") is not None  # used now
    assert cache.put("thing", "newest", block)
    kept = {entry.path.stem for entry in cache.entries()}
    assert kept == {"old", "new", "newest"}
    assert sum(entry.size for entry in cache.entries()) <= 30_000


def test_what_is_larger_than_the_limit_is_not_kept(tmp_path):
    cache = Cache(tmp_path / "kept", limit=1000)
    assert not cache.put("thing", "key", {"a": np.zeros(1000)})
    assert not (tmp_path / "kept").exists()


def test_full_disk_costs_time_only(folder):
    maker = Maker({"a": np.zeros(100_000)})
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, hard))
    try:
        with pytest.warns(CacheWarning, match="cannot write the cache"):
            assert cached("thing", ["x"], maker)["a"].size == 100_000
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert [path for path in folder.rglob("*") if path.is_file()] == []


def test_folder_that_cannot_be_made_costs_time_only(monkeypatch):
    monkeypatch.setenv("SKINMAP_CACHE", "/proc/skinmap-cache")  # not even root may
    maker = Maker()
    with pytest.warns(CacheWarning, match=r"cannot write the cache /proc/skinmap-cache"):
        assert same(cached("thing", ["x"], maker), ARRAYS)
    assert same(cached("thing", ["x"], maker), ARRAYS)  # said once


def test_folder_that_became_read_only_is_read_and_costs_time_only(folder, monkeypatch):
    cached("thing", ["x"], Maker())

    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    for name in ("tempfile.mkstemp", "os.utime", "os.unlink", "os.remove"):
        monkeypatch.setattr(name, refuse)
    known, other = Maker(), Maker()
    assert same(cached("thing", ["x"], known), ARRAYS)
    assert known.made == 0
    with pytest.warns(CacheWarning, match="cannot write the cache"):
        assert same(cached("thing", ["y"], other), ARRAYS)


def test_folder_that_others_may_write_to_is_not_used(folder):
    folder.mkdir()
    folder.chmod(0o777)
    maker = Maker()
    with pytest.warns(CacheWarning, match=r"can be written by others, so it is not used"):
        assert same(cached("thing", ["x"], maker), ARRAYS)
    assert list(folder.iterdir()) == []


def test_folder_is_for_its_owner_alone(folder):
    cached("thing", ["x"], Maker())
    assert folder.stat().st_mode & 0o077 == 0


def test_limit_that_is_no_number_is_said(folder, monkeypatch):
    monkeypatch.setenv("SKINMAP_CACHE_MB", "lots")
    with pytest.warns(CacheWarning, match="'lots' is not a number of megabytes; it is 1000"):
        assert open_cache().limit == 1_000_000_000


WRITER = """
import sys
import numpy as np
from pathlib import Path
from skinmap.disk_cache import Cache
cache = Cache(Path(sys.argv[1]), limit=400_000)
print("ready", flush=True)
sys.stdin.readline()
for turn in range(3):
    for key in range(40):
        arrays = {"a": np.full(2000, float(key))}
        cache.put("thing", f"{key:02d}", arrays)
        got = cache.get("thing", f"{(7 * key + turn) % 40:02d}")
        assert got is None or (got["a"] == (7 * key + turn) % 40).all()
"""


def test_two_processes_that_write_at_once_do_no_harm(tmp_path):
    writers = [
        subprocess.Popen(
            [sys.executable, "-W", "error", "-c", WRITER, str(tmp_path / "kept")],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for _ in range(2)
    ]
    for writer in writers:
        assert writer.stdout.readline() == "ready\n"
    for writer in writers:
        writer.stdin.write("go\n")
        writer.stdin.flush()
    for writer in writers:
        writer.communicate(timeout=120)
        assert writer.returncode == 0
    cache = Cache(tmp_path / "kept", limit=400_000)
    entries = cache.entries()
    assert 0 < sum(entry.size for entry in entries) <= 400_000
    for entry in entries:
        assert (cache.get("thing", entry.path.stem)["a"] == int(entry.path.stem)).all()
    assert list((tmp_path / "kept").rglob("*.partial")) == []


def test_mesh_from_the_cache_is_the_mesh_of_the_file(folder, monkeypatch):
    parsed = []
    monkeypatch.setattr(
        mesh_file,
        "_parsed",
        lambda path, merge, _f=mesh_file._parsed: parsed.append(path) or _f(path, merge),
    )
    first, second = (load_robot("icub").mesh("r_forearm") for _ in range(2))
    assert len(parsed) == 1
    assert np.array_equal(first.vertices, second.vertices)
    assert np.array_equal(first.faces, second.faces)


def told() -> dict:
    """What `skinmap info` shows of the cache."""
    return json.loads(CliRunner().invoke(cli, ["info", "--json"]).stdout)["cache"]


def test_info_shows_what_is_kept(folder):
    assert told()["state"] == "empty"
    cached("one", ["x"], Maker())
    cached("two", ["x"], Maker())
    found = told()
    assert found["state"] == "ready"
    assert found["entries"] == 2
    assert found["folder"] == str(folder)
    assert found["used_mb"] == pytest.approx(
        sum(path.stat().st_size for path in folder.rglob("*.npz")) / 1e6, abs=1e-6
    )


def test_info_shows_that_the_cache_is_off(monkeypatch):
    monkeypatch.setenv("SKINMAP_CACHE", "off")
    assert told()["state"] == "off"


def test_a_command_that_was_removed_answers_what_to_do_instead(folder):
    ran = CliRunner().invoke(cli, ["cache", "clear"])
    assert ran.exit_code == 2
    assert "cache was removed: skinmap info shows its folder" in ran.output


def test_cache_that_is_a_file_is_said(folder):
    folder.write_text("")
    folder.chmod(0o600)
    assert told()["state"] == "unusable: not a folder"
    maker = Maker()
    with pytest.warns(CacheWarning, match="cannot write the cache"):
        assert same(cached("thing", ["x"], maker), ARRAYS)


VERSION = """
import sys
import numpy as np
from skinmap import disk_cache as cache
version = sys.argv[1]
cache.installed = lambda name: version
print("ready", flush=True)
sys.stdin.readline()
for turn in range(3):
    for key in range(40):
        mine = {"a": np.full(2000, float(version) + key)}
        got = cache.cached("thing", [key], lambda: mine)
        assert (got["a"] == mine["a"]).all(), (version, key, got["a"][0])
"""


def test_two_processes_of_two_versions_never_see_each_others_entries(folder):
    users = [
        subprocess.Popen(
            [sys.executable, "-W", "error", "-c", VERSION, version],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )
        for version in ("1000", "2000")
    ]  # fmt: skip
    for user in users:
        assert user.stdout.readline() == "ready\n"
    for user in users:
        user.stdin.write("go\n")
        user.stdin.flush()
    for user in users:
        _, said = user.communicate(timeout=120)
        assert user.returncode == 0, said
    kept = open_cache().entries()
    assert len(kept) == 80
