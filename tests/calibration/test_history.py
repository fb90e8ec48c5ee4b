"""Check-ups that are kept: files that are never replaced, and taxels that change between them."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
import pytest

from benchmarks.calibration.person import SimulatedSkin
from calibration.wiring import Doctor, boards_of
from calibration.wiring.examination import Plan, examine_live
from calibration.wiring.findings import findings, with_changes
from calibration.wiring.history import (
    KeptPart,
    KeptTouch,
    changes_of,
    earlier_checkups,
    keep_checkup,
)
from skinmap.errors import DataFormatError, OutputError

PART = "left_forearm"
TIMES = [f"2026-{month:02}-03T10:00:00+00:00" for month in (9, 10, 11)]


def kept(boards, rng, weak=(), baseline=0.0):
    """A check-up with strokes all over, of answers that are smooth but for gains."""
    doctor = Doctor.of(boards)
    doctor.next_place("stroke")
    gains = np.ones(len(boards.table))
    gains[list(weak)] *= 0.7
    touches = []
    for path in doctor.places["stroke"].paths[::3]:
        middle = path + rng.normal(0, 2e-3, 3)
        away = np.linalg.norm(boards.table.positions[:, None] - middle[None], axis=2).min(axis=1)
        answers = 150 * np.exp(-(away**2) / 2 / 8e-3**2) * gains * rng.normal(1, 0.02, len(gains))
        rows = np.flatnonzero(answers > 6)
        touches.append(KeptTouch("stroke", path.tolist(), rows.tolist(), answers[rows].tolist()))
    level = np.zeros(len(gains))
    level[7] = baseline
    return KeptPart(boards.table.channels.tolist(), level.tolist(), [0.5] * len(level), touches)


def test_a_taxel_that_loses_gain_is_named_after_two_checkups(icub):
    boards = boards_of(icub, PART)
    rng = np.random.default_rng(0)
    several = [kept(boards, rng), kept(boards, rng, (100,)), kept(boards, rng, (100,), 20.0)]
    found = {one.row: one for one in changes_of(boards, TIMES, several)[0]}
    assert {100, 7} <= set(found)
    assert len(found) <= 2 + 0.01 * len(boards.table)  # false ones: 1 % at most is asked for
    assert found[100].kind == "weaker"
    assert found[100].words.endswith("since 3 October 2026")
    assert found[7].words == "its rest lies 20 counts higher since 3 November 2026"
    assert changes_of(boards, TIMES[:2], several[:2])[0] == []  # one check-up may err


def test_each_checkup_is_kept_beside_those_before(icub, tmp_path):
    folder = tmp_path / "checkups"
    for day in (3, 4):
        skin = SimulatedSkin(icub, PART, [], day)
        found = examine_live(skin, icub, (PART,), Plan(markers=[skin], covers=True))
        before = earlier_checkups(folder)
        when = datetime(2026, 11, day, 10, tzinfo=UTC)
        result = findings(found)
        changes, files = keep_checkup(folder, before, found, result, when)
        result = with_changes(result, found.cases, changes, len(before) + 1)
    assert (result.status, result.checkups, len(files)) == ("healthy", 2, 2)
    names = sorted(path.name for path in folder.iterdir())
    assert names == ["checkup_2026-11-03T10-00-00.json", "checkup_2026-11-04T10-00-00.json",
                     "checkup_2026-11-04T10-00-00.pdf"]  # fmt: skip
    assert all(path.stat().st_size < 300_000 for path in folder.iterdir())
    with pytest.raises(OutputError, match="there already"):
        keep_checkup(folder, before, found, result, when)
    first = folder / names[0]
    for damaged in (first.read_text()[:500], "[]", first.read_text().replace("up 1", "up 9")):
        first.write_text(damaged)
        with pytest.raises(DataFormatError, match="not a kept check-up"):
            earlier_checkups(folder)
