"""Without pymeshlab one line says what is missing, and a surface is meshed without it."""

from __future__ import annotations

import sys

import pytest

import skinmap
from skinmap.errors import MissingLibraryError
from skinmap.imports import import_meshlab


def test_missing_pymeshlab_is_one_line_and_the_rest_works(monkeypatch, icub):
    monkeypatch.setitem(sys.modules, "pymeshlab", None)
    with pytest.raises(MissingLibraryError, match=r"^[^\n]*pip install pymeshlab$"):
        import_meshlab()
    mesh = skinmap.build_surface(icub.skin("left_hand"))
    assert len(skinmap.flatten(mesh).charts) >= 1
