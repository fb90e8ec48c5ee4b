"""One way to compiled loops, for installations that cannot be written to as well."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import skinmap
from skinmap.errors import MissingLibraryError
from skinmap.numba_loops import compile_loop, compiled, pays

PACKAGES = ("recognition/histograms", "neighbours", "touch/histograms", "touch/images")
needs_numba = pytest.mark.usefixtures("numba")
LOOPS = """
import json, os, sys
import numpy as np
import skinmap
from skinmap.recognition.histograms.intersection import AdditiveFunction
from skinmap.neighbours.matching import _match
from skinmap.numba_loops import compiled
from skinmap.touch.images.contact_image import compiled_gathers
from skinmap.touch.histograms import codebook as votes

assert skinmap.__file__.startswith(sys.argv[1]), skinmap.__file__
found = AdditiveFunction([np.zeros(0), np.ones(1)], [np.zeros((0, 1)), np.ones((1, 1))], [2.0])
assert found.compile()
image = np.zeros(1, np.float32)
one, many = compiled_gathers()
one(np.array([0]), np.zeros((1, 3), int), np.full((1, 3), 0.5), np.ones(1), image)
loop = votes._compiled(2)
counts = np.zeros((1, 1, 2), np.int64)
held = np.array([[0, 1]], np.uint32).T
loop(np.array([[0.0, 3.0]]), 1.0, np.ascontiguousarray(held), np.array([0, 1]),
     np.array([[[0.0, 0.0], [0.0, 3.0]]]), np.array([0]), np.array([0, 1, 2]), np.array([0, 0]),
     counts)
matching = compiled(_match)
matching.compile("(" + ",".join(["i8[::1]", "f8[:,:,::1]", "i8[::1]", "i8[::1]", "b1[:,::1]",
    "f8[:,::1]", "u8[:,::1]", "f8[:,:,:,::1]", "i8[::1]", "i8[::1]", "b1[:,::1]", "f8[:,::1]",
    "u8[:,:,:,::1]", "f8", "f8", "f8[:,::1]", "f8[:,::1]", "i8[:,::1]"]) + ")")
print(json.dumps({
    "additive": found(np.array([[5.0, 7.0]])).tolist(), "image": image.tolist(),
    "votes": counts.tolist(),
}))
"""


@pytest.fixture
def numba():
    return pytest.importorskip("numba", reason="the compiled loops need numba")


def lines(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def double(x: int) -> int:
    return 2 * x


@needs_numba
def test_every_loop_runs_from_a_folder_that_cannot_be_written(tmp_path):
    """A copy of the package that nobody may write to, and a user without a folder for caches."""
    place = tmp_path / "installed"
    source = Path(skinmap.__file__).parent
    shutil.copytree(source, place / "skinmap", ignore=shutil.ignore_patterns("__pycache__"))
    script = lines(tmp_path / "loops.py", LOOPS)
    for folder in (place, *(path for path in place.rglob("*") if path.is_dir())):
        folder.chmod(0o555)
    # Root may write anywhere: what is a file cannot be a folder, for nobody.
    for package in PACKAGES:
        (place / "skinmap" / package).chmod(0o755)
        (place / "skinmap" / package / "__pycache__").write_text("no folder")
        (place / "skinmap" / package).chmod(0o555)
    nowhere = lines(tmp_path / "no_home", "")
    environment = {
        **{name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")},
        "PYTHONPATH": str(place),
        "PYTHONDONTWRITEBYTECODE": "1",
        "HOME": str(nowhere),
        "XDG_CACHE_HOME": str(nowhere / "caches"),
    }
    ended = subprocess.run(
        [sys.executable, str(script), str(place)],
        env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert ended.returncode == 0, ended.stderr[-2000:]
    assert ended.stdout.strip() == '{"additive": [[3.0]], "image": [1.5], "votes": [[[0, 1]]]}'
    assert not list(place.rglob("*.nbi"))


def test_compiled_loops_need_no_folder_that_can_be_written(numba, monkeypatch):
    def njit(*, cache=False, **options):
        if cache:  # numba's own words where neither the source's folder nor the user's will do
            raise RuntimeError("cannot cache function: no locator available for file")
        return lambda function: function

    monkeypatch.setattr(numba, "njit", njit)
    assert compile_loop(double)(4) == 8


@needs_numba
def test_a_loop_is_compiled_once_in_a_process():
    assert compiled(double)(3) == 6
    assert compiled(double) is compiled(double)


def test_without_numba_it_is_said(monkeypatch):
    monkeypatch.setitem(sys.modules, "numba", None)
    with pytest.raises(MissingLibraryError, match="pip install numba"):
        compile_loop(double)
    assert not pays(1, 2)


@needs_numba
def test_a_full_disk_costs_the_next_process_time_and_nothing_else(monkeypatch):
    from numba.core.caching import IndexDataCacheFile

    tried = []

    def full(*given):
        tried.append(given)
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(IndexDataCacheFile, "save", full)
    monkeypatch.setattr(IndexDataCacheFile, "load", lambda *_: None)
    assert compile_loop(double)(3) == 6
    assert tried
