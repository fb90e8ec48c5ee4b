"""The room's door: its names, where they come from, and what they cost."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import viewer


@pytest.mark.parametrize("name", viewer.__all__)
def test_every_name_of_the_door_leads_to_a_documented_thing(name):
    thing = getattr(viewer, name)
    stub = Path(viewer.__file__ + "i").read_text()
    assert f"from {thing.__module__} import {name} as {name}\n" in stub
    assert "Parameters" in thing.__doc__
    assert name in dir(viewer)


def test_other_names_are_not_there():
    with pytest.raises(AttributeError, match="no attribute 'paint'"):
        viewer.paint  # noqa: B018


def test_opening_the_door_imports_nothing_heavy():
    code = (
        "import sys, viewer; heavy = {'numpy', 'vtkmodules', 'pyvista', 'skinmap.live.loop'}\n"
        "sys.exit(', '.join(heavy & set(sys.modules)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
