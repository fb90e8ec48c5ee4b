from __future__ import annotations

import numpy as np
import pytest

from skinmap.errors import DataFormatError, SkinError
from skinmap.touch.recording import Recording, load_recordings, save_recordings


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
