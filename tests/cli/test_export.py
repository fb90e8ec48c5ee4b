from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

from skinmap.cli.main import cli
from skinmap.errors import SkinError
from skinmap.io.taxels.icub import read_icub
from skinmap.io.taxels.taxel_table import read_taxels


def run(*words: str) -> dict:
    result = CliRunner().invoke(cli, ["export", *words, "--json"], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def test_export_writes_a_part_that_existing_users_can_read(tmp_path, icub):
    path = tmp_path / "torso.txt"
    result = run("icub", "--part", "torso", "--format", "icub", "-o", str(path))
    assert result["files"] == [str(path)]
    assert result["parts"] == [
        {"name": "torso", "link": "chest", "channels": 756, "taxels": 430, "modules": 43}
    ]
    table, skin = read_icub(path), icub.skin("torso")
    assert table.link == "chest"
    for name in ("channels", "modules", "positions", "normals"):
        np.testing.assert_array_equal(getattr(table, name), getattr(skin, name))


def test_export_of_what_was_exported_changes_nothing(tmp_path, same_table):
    first = tmp_path / "a.csv"
    run("icub", "--part", "left_foot", "--format", "csv", "-o", str(first))
    for format, name in (("icub", "b.txt"), ("urdf", "c.urdf"), ("csv", "d.csv")):
        second = tmp_path / name
        run(str(first), "--format", format, "-o", str(second))
        same_table(read_taxels(second), read_taxels(first))
        first = second


def test_export_reads_a_bare_table_in_a_format_that_is_named(tmp_path):
    (tmp_path / "skin.db").write_text("1\n0 5 1000000 0 0 0 0 1000000000 1 0\n")
    result = run(f"skinware:{tmp_path / 'skin.db'}", "-o", str(tmp_path / "t.csv"))
    assert result["robot"] == result["parts"][0]["name"] == "skin"
    np.testing.assert_array_equal(read_taxels(tmp_path / "t.csv").positions, [[1e-3, 0, 0]])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("icub",), "a file holds one part, --part chooses it: torso, left_arm"),
        (("icub", "--part", "tail"), "no part 'tail'; the parts are: torso"),
        (("gone.csv",), r"no file 'gone\.csv'; expected a taxel table"),
        (("gone.csv", "--part", "torso"), "--part is for a robot"),
        (("skinware:gone.db",), "no file"),
        (("icub", "--part", "torso", "--format", "excel"), "'excel' is not one of 'csv'"),
    ],
)
def test_export_says_what_is_wrong_and_writes_nothing(tmp_path, monkeypatch, words, message):
    import re

    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(cli, ["export", *words, "-o", "t.out"])
    assert isinstance(result.exception, SkinError | SystemExit)
    text = str(result.exception) if isinstance(result.exception, SkinError) else result.output
    assert re.search(message, " ".join(text.split()))
    assert list(tmp_path.iterdir()) == []


def test_export_for_people(tmp_path):
    path = str(tmp_path / "t.csv")
    result = CliRunner().invoke(cli, ["export", "--part", "left_hand", "-o", path])
    assert result.exit_code == 0
    assert result.output.split("\n")[:2] == ["left_hand: 48 taxels, 4 modules", path]


def test_export_writes_over_nothing_that_it_reads(tmp_path):
    """`--force` replaced a recording by its contacts, and a robot's URDF by its skin alone."""
    touches, table, urdf = (tmp_path / name for name in ("own.csv", "arm.csv", "arm.urdf"))
    table.write_text("x,y,z\n0,0,0\n0.01,0,0\n0,0.01,0\n0.01,0.01,0\n")
    urdf.write_text('<robot name="arm"><link name="arm"/></robot>')
    manifest = tmp_path / "arm.toml"
    manifest.write_text('[robot]\nname = "arm"\nurdf = "arm.urdf"\n'
                        '[[part]]\nname = "arm"\nlink = "arm"\ntaxels = "arm.csv"\n')  # fmt: skip
    touches.write_text("time,ch0,ch1,ch2,ch3\n0,0,0,0,0\n0.02,9,9,9,9\n")
    touches.with_suffix(".toml").write_text('robot = "arm.toml"\npart = "arm"\nlabel = "poke"\n')
    for words in (f"{touches} --format contacts -o {touches}", f"{manifest} -o {table}",
                  f"{manifest} --format urdf -o {urdf}", f"{table} -o {table}"):  # fmt: skip
        output = words.split()[-1]
        with open(output, "rb") as file:
            before = file.read()
        result = CliRunner().invoke(cli, ["export", *words.split(), "--force"])
        assert f"cannot write {output!r}: it is read" in str(result.exception)
        with open(output, "rb") as file:
            assert file.read() == before
