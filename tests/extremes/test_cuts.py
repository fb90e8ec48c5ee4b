"""A few cuts and changed bytes of every kind of file; all of them are benchmarks/reliability."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from damage.catalogue import TARGETS
from damage.recordings import mcap

import skinmap
from benchmarks.reliability import cuts, large
from skinmap.errors import DataFormatError, SkinWarning

FEW = 8  # cuts and as many changed bytes of each kind; `make soak` takes 1,000
KINDS = [name for name, target in TARGETS.items() if cuts.is_file(target)]


@pytest.mark.parametrize("kind", KINDS)
def test_cut_and_changed_files_open_whole_say_so_or_are_refused(tmp_path, kind):
    found = cuts.examine(
        TARGETS[kind], tmp_path, FEW, rng=np.random.default_rng(1), checked=kind in cuts.CHECKED
    )
    assert not found["faults"]
    assert found["files"] >= 2 * FEW


@pytest.mark.parametrize("kind", KINDS)
def test_lines_beyond_what_parsers_take_are_refused(tmp_path, kind):
    """The field limit of csv and the depth of a parser end in errors that are not ours."""
    target = TARGETS[kind]
    target.lay_out(tmp_path)
    head, _, rest = target.seeds()[0].partition(b"\n")
    for line in large.LINES.values():
        target.try_one(b"\n".join((head, line, rest)), tmp_path)  # raises what is not ours


@pytest.mark.parametrize("text", ["0\n0\n", "0 1\n1 2\n", "0 1 2\n1 2 3\n"])
def test_lines_without_pairs_are_no_recording_of_cyskin(tmp_path, text):
    target = TARGETS["cyskin-text"]
    target.lay_out(tmp_path)
    (tmp_path / target.file).write_text(text)
    with pytest.raises(DataFormatError, match="neither a line of ids"):
        target.read(tmp_path / target.file)


def test_every_kind_with_a_checksum_is_a_file():
    assert set(cuts.CHECKED) <= set(KINDS)


def test_a_reader_that_says_nothing_is_a_fault(tmp_path):
    """The judge can fail: a recording whose losses nobody mentions, an error of Python's own."""
    target = TARGETS["recording"]
    blind = type(target)("blind", "t.bin", lambda: [b"abc"], lambda path: path.read_bytes())
    found = cuts.examine(blind, tmp_path, 5, rng=np.random.default_rng(0), checked=True)
    assert len(found["faults"]) == found["files"] == 10
    clumsy = type(target)("clumsy", "t.bin", lambda: [b"7"], lambda path: int(path.read_bytes()))
    found = cuts.examine(clumsy, tmp_path, 5, rng=np.random.default_rng(0), checked=False)
    assert "ValueError: invalid literal" in found["faults"][0]


@pytest.mark.parametrize(
    ("kind", "place", "value"),
    [
        # Deflated data end before their last bits: the checksum must be asked for.
        ("recording", 1545, 0xA5), ("self-touch", 1132, 0x12), ("wrenches", 1200, 0x5F),
        ("cache", 310, 0xC5),
        # A date of which COLLADA's parser does not know the time zone, and warns.
        ("mesh-dae", 178, 0x58),
        # A chunk that a flipped bit turns into a record of a kind that readers pass over.
        ("mcap", None, 0xC4),
    ],
)  # fmt: skip
def test_what_cutting_found_is_said(tmp_path, kind, place, value):
    target = TARGETS[kind]
    original = target.seeds()[0]
    target.lay_out(tmp_path)
    if place is None:
        place = chunks(original)[-1]
    changed = original[:place] + bytes([value]) + original[place + 1 :]
    whole = cuts.read(target, original, tmp_path)
    outcome = cuts.read(target, changed, tmp_path)
    assert outcome[0] != "whole" or outcome[1] == whole[1]


def chunks(data: bytes) -> list[int]:
    """Where the chunks of an MCAP file begin."""
    place, found = 8, []
    while place < len(data) - 8:
        found += [place] if data[place] == 6 else []
        place += 9 + int.from_bytes(data[place + 1 : place + 9], "little")
    return found


def test_touches_of_a_cut_recording_come_with_a_warning_of_what_is_lost(tmp_path: Path):
    path, whole = tmp_path / "t.mcap", mcap("pressure")
    path.write_bytes(whole)
    before = skinmap.load_recordings(path)[0]
    path.write_bytes(whole[: chunks(whole)[-2]])
    with pytest.warns(SkinWarning, match=r"t\.mcap' was cut off or damaged: 0\.\d\d s of samples"):
        after = skinmap.load_recordings(path)[0]
    assert 0 < len(after.times) < len(before.times)
    np.testing.assert_array_equal(after.pressures, before.pressures[: len(after.times)])
