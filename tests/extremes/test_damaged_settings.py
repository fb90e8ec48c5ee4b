"""Damaged files that hold no samples: saved views, anchors, responses, models."""

from __future__ import annotations

import warnings
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calibration.response import ResponseCalibration
from calibration.response_file import load_response, save_response
from calibration.tables import read_anchors, read_board
from skinmap.classify.check import planted_touches
from skinmap.classify.classifier import classifiers
from skinmap.classify.model_file import load_classifier, save_classifier
from skinmap.errors import SkinError, SkinWarning
from viewer.interaction.view_file import SavedView, load_view, save_view

BOARD = "channel,x,y\n" + "".join(f"{row},{row}.5,{row % 3}\n" for row in range(12))
ANCHORS = "channel,x,y,z,sigma\n" + "".join(f"{row},{row}.5,0,1e-3,0.1\n" for row in range(12))
VIEW = SavedView(
    "iCub", (1.0, 0.2, 0.1), (0.0, 0.0, 0.1), (0.0, 0.0, 1.0), 22.0, "still", "health", "discs",
    "torso", {"torso": (3, 4)},
)  # fmt: skip
SHARE = st.floats(0, 1, exclude_max=True)


def read_anchor_files(path: Path) -> Any:
    return read_anchors(path, read_board(path.with_name("board.csv")))


READERS = {
    "view.json": load_view,
    "anchors.csv": read_anchor_files,
    "response.npz": load_response,
    "touch.skinmodel": load_classifier,
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A whole file of each kind."""
    folder = tmp_path_factory.mktemp("whole")
    rng = np.random.default_rng(0)
    save_view(VIEW, folder / "view.json")
    (folder / "board.csv").write_text(BOARD)
    (folder / "anchors.csv").write_text(ANCHORS)
    response = ResponseCalibration.fit(np.rint(20 + rng.normal(0, 1.2, (200, 8))))
    save_response(response, folder / "response.npz")
    model = classifiers.get("histogram")().fit(planted_touches(8, rng=rng), rng=rng)
    save_classifier(model, folder / "touch.skinmodel")
    return folder


@pytest.mark.parametrize("name", READERS)
def test_whole_files_are_read(folder, name):
    assert READERS[name](folder / name) is not None


@pytest.mark.fuzz
@settings(
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(flips=st.lists(st.tuples(SHARE, st.integers(0, 7)), max_size=4), end=st.floats(0.5, 1.5))
@pytest.mark.parametrize("name", READERS)
def test_damaged_files_are_read_or_refused(folder, name, flips, end):
    data = bytearray((folder / name).read_bytes())
    for where, bit in flips:
        data[int(where * len(data))] ^= 1 << bit
    damaged = folder / f"damaged{Path(name).suffix}"
    damaged.write_bytes(bytes(data[: int(end * len(data))]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", SkinWarning)
        with suppress(SkinError):
            READERS[name](damaged)
