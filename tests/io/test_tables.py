from __future__ import annotations

import warnings

import numpy as np
import pytest

from skinmap.errors import DataFormatError, InvalidArrayError, MissingFileError, UnknownNameError
from skinmap.io.taxels.icub import read_icub
from skinmap.io.taxels.taxel_table import COLUMNS, read_csv, read_taxels, readers, write_csv
from skinmap.io.text import csv_rows
from skinmap.skin.taxels import TaxelTable

HEADER = ",".join(COLUMNS)
ROW = "4,0,0.1,0.2,0.3,0,0,1"


def test_write_csv_and_read_csv_give_the_same_bits(tmp_path, rng):
    n = 50
    table = TaxelTable(
        rng.permutation(n), np.arange(n) // 12, rng.normal(size=(n, 3)), rng.normal(size=(n, 3))
    )
    write_csv(table, tmp_path / "t.csv")
    back = read_csv(tmp_path / "t.csv")
    for name in ("channels", "modules", "positions", "normals"):
        np.testing.assert_array_equal(getattr(back, name), getattr(table, name))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"t\.csv:1: expected the header"),
        ("a,b\n1,2\n", "expected the header.*only x,y,z are needed"),
        (f"{HEADER}\n", "no taxel"),
        (f"{HEADER}\n1,2,3\n", r"t\.csv:2: expected 8 columns, got 3"),
        (f"{HEADER}\n{ROW}\n5,0,x,0,0,0,0,1\n", r"t\.csv:3: expected a number, got 'x'"),
        (f"{HEADER}\n5,0,nan,0,0,0,0,1\n", r":2: expected a finite number"),
        (f"{HEADER}\n1.5,0,0,0,0,0,0,1\n", "whole numbers"),
        (f"{HEADER}\n-1,0,0,0,0,0,0,1\n", "whole numbers"),
        (f"{HEADER}\n{ROW}\n{ROW}\n", "channel 4 comes more than once"),
    ],
)
def test_read_csv_names_file_and_line(tmp_path, text, message):
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(DataFormatError, match=message):
        read_csv(tmp_path / "t.csv")


@pytest.mark.parametrize(
    ("header", "row", "channel", "module"),
    [
        ("x,y,z", "0.1,0.2,0.3", 1, 0),
        ("channel,x,y,z", "4,0.1,0.2,0.3", 4, 0),
        ("channel,module,x,y,z", "4,7,0.1,0.2,0.3", 4, 7),
        ("module, X, Y, Z", "7,0.1,0.2,0.3", 1, 7),
    ],
)
def test_columns_beside_the_position_may_be_missing(tmp_path, header, row, channel, module):
    first = row.replace("0.1", "0.5").replace("4,", "2,")
    (tmp_path / "t.csv").write_text(f"{header}\n{first}\n{row}\n")
    table = read_csv(tmp_path / "t.csv")
    assert (table.channels[1], table.modules[1]) == (channel, module)
    np.testing.assert_array_equal(table.positions[1], [0.1, 0.2, 0.3])
    assert not table.normals.any()


@pytest.mark.parametrize(
    ("text", "left"),
    [
        ("z,channel,x,module,y\n0.3,4,0.1,7,0.2\n", ""),
        ("channel\tmodule\tx\ty\tz\n4\t7\t0,1\t0.2\t0.3\n", ""),
        ("id,module,x,y,z,channel,comment\nA,7,0.1,0.2,0.3,4,hello\n", "id, comment"),
    ],
)
def test_columns_go_by_their_names(tmp_path, text, left):
    (tmp_path / "t.csv").write_text(text)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        table = read_csv(tmp_path / "t.csv")
    assert [str(one.message) for one in told] == [f"t.csv: columns that are not read: {left}"] * (
        left != ""
    )
    assert (table.channels.tolist(), table.modules.tolist()) == ([4], [7])
    np.testing.assert_array_equal(table.positions, [[0.1, 0.2, 0.3]])
    (tmp_path / "t.csv").write_text("x,y,z,x\n1,2,3,4\n")
    with pytest.raises(DataFormatError, match="expected the header"):
        read_csv(tmp_path / "t.csv")


@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
@pytest.mark.parametrize("end", [b"\n", b"\r\n"])
@pytest.mark.parametrize("comma", [b".", b","])
def test_a_table_saved_by_a_spreadsheet_is_read(tmp_path, mark, end, comma):
    (tmp_path / "t.csv").write_text(f"{HEADER}\n{ROW}\n5,0,-0.5,1e-2,.25,0,1,0\n")
    plain = read_csv(tmp_path / "t.csv")
    text = (tmp_path / "t.csv").read_bytes().replace(b",", b";").replace(b".", comma)
    (tmp_path / "t.csv").write_bytes(mark + text.replace(b"\n", end))
    saved = read_csv(tmp_path / "t.csv")
    for name in ("channels", "modules", "positions", "normals"):
        np.testing.assert_array_equal(getattr(saved, name), getattr(plain, name))


def test_a_decimal_comma_is_one_only_between_semicolons(tmp_path):
    def rows(text):
        return [row for _, row in csv_rows(text, tmp_path)]

    found = rows('name;x\n"poke, hard";0,5\n1,5e-3;"1,2,3"\n')
    assert found == [["name", "x"], ["poke, hard", "0.5"], ["1.5e-3", "1,2,3"]]
    assert rows('a,b\n"0,5",1;2\n') == [["a", "b"], ["0,5", "1;2"]]


def test_read_csv_refuses_what_is_not_text(tmp_path):
    (tmp_path / "t.csv").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(DataFormatError, match="not a text file"):
        read_csv(tmp_path / "t.csv")


def test_read_icub_keeps_placed_rows_and_the_last_one(tmp_path):
    rows = ["0 0 0 1 0 0"] * 14
    rows[3], rows[13] = "0.1 0 0 1 0 0", "0 0 0.2 1 0 0"
    text = "name r_hand\nspatial_sampling taxel\ntaxel2Repr ( 3 )\n[calibration]\n"
    (tmp_path / "p.txt").write_text(text + "\n".join(rows))
    table = read_icub(tmp_path / "p.txt")
    np.testing.assert_array_equal(table.channels, [3, 13])
    np.testing.assert_array_equal(table.modules, [0, 1])


def test_read_icub_reads_bare_rows(tmp_path):
    (tmp_path / "p.txt").write_text("0.1 0 0 1 0 0\n0 0 0 0 0 0\n")
    assert len(read_icub(tmp_path / "p.txt")) == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name x\n0 0 1 0 0 0\n", r"no line \[calibration\]"),
        ("[calibration]\n0 0 1 0 0\n", r"p\.txt:2: expected 6 columns, got 5"),
        ("[calibration]\n0 0 0 0 0 0\n", "no placed taxel"),
        ("", "no placed taxel"),
    ],
)
def test_read_icub_names_what_is_wrong(tmp_path, text, message):
    (tmp_path / "p.txt").write_text(text)
    with pytest.raises(DataFormatError, match=message):
        read_icub(tmp_path / "p.txt")


def test_read_taxels_names_missing_files_and_formats(tmp_path):
    with pytest.raises(MissingFileError, match=r"no file .*gone\.csv.*taxel table"):
        read_taxels(tmp_path / "gone.csv")
    (tmp_path / "t.xyz").write_text("")
    with pytest.raises(UnknownNameError, match=r"\.csv"):
        read_taxels(tmp_path / "t.xyz")
    with pytest.raises(UnknownNameError, match="are: csv, cyskin, icub"):
        read_taxels(tmp_path / "t.xyz", "excel")
    assert readers.names()[:2] == ("csv", "cyskin")


def test_taxel_table_refuses_shapes_that_differ():
    with pytest.raises(InvalidArrayError, match="channels and modules"):
        TaxelTable(np.arange(2), np.arange(3), np.zeros((3, 3)), np.zeros((3, 3)))
