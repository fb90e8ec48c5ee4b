"""Anchors picked one by one: what counts, what is taken back, what is refused; and files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.commands.anchor_session import AnchorSession
from calibration.commands.calibration_options import Outputs
from calibration.files.tables import Anchor, BoardTable, read_anchor_table, write_anchor_table
from skinmap.errors import InvalidArrayError


@pytest.fixture
def board(bent):
    count = len(bent.layout)
    return BoardTable(100 + np.arange(count), np.zeros(count, np.int64), bent.layout)


@pytest.fixture
def session(board, bent):
    return AnchorSession(board, (bent.vertices, bent.faces))


def pick(session, bent, taxels):
    for taxel in taxels:
        session.pick_taxel(int(taxel))
        session.pick_point(bent.places[taxel])


def test_undo_takes_back_each_pick_and_nothing_more(session, bent):
    seen = []
    for taxel in bent.corners:
        seen.append((session.anchors, session.taxel))
        session.pick_taxel(int(taxel))
        seen.append((session.anchors, session.taxel))
        session.pick_point(bent.places[taxel])
    session.remove(int(bent.corners[1]))
    assert len(session.anchors) == len(bent.corners) - 1
    assert session.undo()
    assert len(session.anchors) == len(bent.corners)
    for anchors, taxel in reversed(seen):
        assert session.undo()
        assert (session.anchors, session.taxel) == (anchors, taxel)
    assert not session.undo()
    assert session.message == "nothing to take back"


def test_a_taxel_picked_twice_replaces_its_anchor_and_says_so(session, bent):
    pick(session, bent, bent.corners[:3])
    session.pick_point(bent.places[5])
    session.pick_taxel(int(bent.corners[0]))
    assert "taxel 100 has a new place" in session.message
    assert len(session.anchors) == 3
    assert session.anchors[-1] == Anchor(0, tuple(bent.places[5].tolist()), 1e-3)


def test_picks_beside_board_and_link_change_nothing(session, bent):
    far = bent.layout[0] - 0.05
    assert not session.pick_board(far)
    assert session.taxel is None
    session.pick_point(None)
    assert session.point is None
    assert "missed the link" in session.message
    near = bent.layout[7] + [0.5 * session.reach, 0.0]
    assert session.pick_board(near)
    assert session.taxel == 7
    with pytest.raises(InvalidArrayError, match=r"taxel 72 of a board with taxels 0\.\.71"):
        session.pick_taxel(72)
    with pytest.raises(InvalidArrayError, match="point holds NaN"):
        session.pick_point([0.0, np.nan, 0.0])


@pytest.mark.parametrize(
    ("taxels", "places", "words"),
    [
        ([0, 7], [0, 7], "2 anchors, at least 3 are needed"),
        ([0, 3, 7], [0, 3, 7], "in a row on the board"),
        ([0, 7, 64], [0, 7, 7], "are at the same point"),
        ([0, 1, 2, 8], [0, 7, 64, 71], "times as far apart as on the layout"),
    ],
)
def test_what_cannot_be_solved_is_said(session, bent, taxels, places, words):
    for taxel, place in zip(taxels, places, strict=True):
        session.pick_taxel(taxel)
        session.pick_point(bent.places[place])
    solution = session.solve()
    assert solution.found is None
    assert words in session.message
    assert not session.ready  # nothing new to solve


def test_a_solution_of_earlier_anchors_is_called_stale(session, bent):
    pick(session, bent, bent.corners[:4])
    assert session.ready
    assert session.solve().found is not None
    assert not session.stale
    pick(session, bent, bent.corners[4:5])
    assert session.stale
    assert session.found is not None  # still there to look at


def test_saving_a_doubtful_patch_keeps_what_was_there(session, bent, tmp_path):
    pick(session, bent, bent.corners)
    options = Outputs(out=tmp_path)
    good = session.save(options)
    assert good == ("taxels.csv", "report.html", "anchors.csv")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    for taxel in bent.corners[1:]:
        session.remove(int(taxel))
    pick(session, bent, [1, 8, 9])
    doubtful = session.save(options)
    assert session.found is not None
    assert session.found.status != "ok"
    assert doubtful == ("refused.html", "refused_anchors.csv")
    assert {name: (tmp_path / name).read_bytes() for name in before} == before
    assert "not accepted" in session.message
    assert "taxels.csv" in session.save(replace(options, accept=True))


def test_saving_nothing_writes_nothing(session, tmp_path):
    assert session.save(Outputs(out=tmp_path / "out")) == ()


@pytest.mark.parametrize("stated", [True, False])
def test_anchor_tables_are_read_to_the_bits_that_were_written(board, tmp_path, stated):
    rng = np.random.default_rng(2)
    anchors = [
        Anchor(taxel, tuple(rng.normal(size=3).tolist()), float(rng.random()) if stated else None)
        for taxel in (3, 70, 12)
    ]
    write_anchor_table(anchors, board, tmp_path / "anchors.csv")
    assert read_anchor_table(tmp_path / "anchors.csv", board) == anchors
