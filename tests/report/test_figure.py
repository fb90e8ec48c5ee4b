from __future__ import annotations

import numpy as np
import pytest

from skinmap.report.figure import FlatMapSheet


@pytest.fixture(scope="module")
def flats(prepared):
    return [prepared(part).flat for part in ("left_hand", "torso")]


def test_a_sheet_filled_again_shows_what_a_new_one_shows(flats, tmp_path):
    used = FlatMapSheet()
    for flat in flats:
        used.write(flat, tmp_path / "used.png")
    FlatMapSheet().write(flats[-1], tmp_path / "new.png")
    # To the byte: nothing of the part before is left on it.
    assert (tmp_path / "used.png").read_bytes() == (tmp_path / "new.png").read_bytes()


def test_a_sheet_draws_all_taxels_true_to_scale(flats, tmp_path):
    for flat in flats:
        sheet = FlatMapSheet()
        sheet.write(flat, tmp_path / "map.png")
        for panel in sheet._maps:
            uv = np.concatenate([chart.uv for chart in flat.charts]) * 1e3
            pixels = panel._axis.transData.transform(uv)
            box = panel._axis.bbox
            assert ((pixels > box.min) & (pixels < box.max)).all()
            spread = np.ptp(pixels, axis=0) / np.ptp(uv, axis=0)
            assert spread[0] == pytest.approx(spread[1], rel=1e-9)
            # The map fills its panel one way but for the margin.
            assert (np.ptp(pixels, axis=0) / box.size).max() == pytest.approx(1 / 1.06)
