from __future__ import annotations

import numpy as np
import pytest

import skinmap
from skinmap.errors import DataFormatError, SkinError
from skinmap.touch.recording import Recording, load_recordings, rows_of, save_recordings


@pytest.fixture
def stored(tmp_path):
    """A file of one recording."""
    pressures = np.random.default_rng(0).integers(0, 255, (200, 30)).astype(np.uint8)
    file = tmp_path / "touches.npz"
    save_recordings([Recording("p", np.arange(200) / 50, pressures, np.full(200, -1), ())], file)
    return file


def test_a_damaged_recording_is_refused_or_read_never_a_traceback(stored):
    whole = stored.read_bytes()
    refused = 0
    for place in range(0, len(whole), 7):
        damaged = bytearray(whole)
        damaged[place] ^= 0xFF
        stored.write_bytes(bytes(damaged))
        try:
            load_recordings(stored)
        except SkinError:
            refused += 1
    # What is not covered by a checksum (time stamps of the archive) may be anything.
    assert refused > 0.9 * len(range(0, len(whole), 7))


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 0.999])
def test_a_cut_recording_is_refused(stored, share):
    whole = stored.read_bytes()
    stored.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(DataFormatError, match="not a Skinmap recording"):
        load_recordings(stored)


def test_rows_of_each_event_are_found_in_one_pass(rng):
    events = rng.integers(-1, 6, 500)  # mixed: stretches of two events may take turns
    for event, rows in enumerate(rows_of(events, 7)):
        np.testing.assert_array_equal(rows, np.flatnonzero(events == event))
    assert [len(rows) for rows in rows_of(np.zeros(0, np.int64), 2)] == [0, 0]


def test_arrays_of_another_lab_name_the_way_in(tmp_path):
    np.savez(tmp_path / "x.npz", pressures=np.zeros((10, 5)), times=np.arange(10) / 50)
    with pytest.raises(DataFormatError, match=r"\['pressures', 'times'\].*`skinmap export FILE"):
        skinmap.load_recordings(tmp_path / "x.npz")
