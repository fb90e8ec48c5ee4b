from __future__ import annotations

import numpy as np
import pytest

from skinmap.errors import DataFormatError
from skinmap.io.taxels.taxel_table import read_skinware, read_taxels

ROW = "1 7 1000000 -2500000 3 0 600000000 800000000 1750000 2"


@pytest.fixture
def database(tmp_path):
    """A function that writes a database and returns its path."""

    def write(text: str):
        (tmp_path / "skin.calib").write_text(text)
        return tmp_path / "skin.calib"

    return write


def test_read_skinware_turns_nanometres_into_metres_and_uids_into_channels(database):
    table = read_taxels(database(f"2\n{ROW}\n1 3 0 0 0 0 0 1000000000 1750000 2\n"))
    np.testing.assert_array_equal(table.channels, [3, 7])
    np.testing.assert_array_equal(table.modules, [0, 0])
    np.testing.assert_array_equal(table.positions, [[0, 0, 0], [1e-3, -2.5e-3, 3e-9]])
    np.testing.assert_array_equal(table.normals, [[0, 0, 1], [0, 0.6, 0.8]])
    assert table.link == "2"


def test_read_skinware_takes_the_count_from_the_first_word(database):
    assert len(read_skinware(database(f"\n  1 {ROW}\n\n"))) == 1


def test_read_skinware_reads_one_link_and_type(database):
    other_link, other_type = ROW[:-1] + "5", "4" + ROW[1:]
    with pytest.raises(DataFormatError, match="several links, make a file of each: 2, 5"):
        read_skinware(database(f"2\n{ROW}\n{other_link}\n"))
    with pytest.raises(DataFormatError, match="several types"):
        read_skinware(database(f"2\n{ROW}\n{other_type}\n"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"skin\.calib:1: expected the number of taxels"),
        ("0\n", "at least 1"),
        ("many\n", ":1: expected a whole number, got 'many'"),
        (f"3\n{ROW}\n", ":1: says 3 taxels, holds 1"),
        (f"1\n{ROW}\n{ROW}\n", "says 1 taxels, holds 2"),
        (f"1\n{ROW} 4\n", r":2: expected 10 columns .*, got 11"),
        (f"2\n{ROW}\n{ROW.replace('800000000', '0.8')}\n", ":3: expected a whole number"),
        (f"2\n{ROW}\n{ROW}\n", "channel 7 comes more than once"),
        (f"1\n{ROW.replace(' 7 ', ' -7 ')}\n", ":2: uid -7 is not a channel"),
        (f"1\n{ROW.replace(' 3 ', f' {10**400} ')}\n", ":2: .* is beyond"),
        (f"1\n{ROW.replace(' 3 ', ' 1_0 ')}\n", "got '1_0'"),
    ],
)
def test_read_skinware_names_file_and_line(database, text, message):
    with pytest.raises(DataFormatError, match=message):
        read_skinware(database(text))
