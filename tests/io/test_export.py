from __future__ import annotations

import dataclasses
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from skinmap.errors import OutputError
from skinmap.io.taxels.icub import read_icub, write_icub
from skinmap.io.taxels.tactile_urdf import (
    read_tactile_sensors,
    read_tactile_urdf,
    write_tactile_urdf,
)
from skinmap.io.taxels.taxel_table import read_csv, write_csv
from skinmap.skin.taxels import ABSENT, THERMAL, TaxelTable

# Any float that a place can be; products of larger ones leave the range of a double.
NUMBERS = st.floats(-1e100, 1e100)


@st.composite
def tables(draw, *, icub: bool = False) -> TaxelTable:
    """Any table; with `icub`, one that the format of the iCub has room for."""
    channels = draw(st.lists(st.integers(0, 2000), min_size=1, max_size=30, unique=True))
    n = len(channels)
    positions = draw(arrays(float, (n, 3), elements=NUMBERS))
    normals = draw(arrays(float, (n, 3), elements=NUMBERS))
    modules = draw(arrays(np.int64, n, elements=st.integers(-5, 2**31 - 1)))
    if icub:
        modules = np.array(channels) // 12
        positions[~positions.any(axis=1)] = [0.0, -0.0, 1e-300]
    return TaxelTable(np.array(channels), modules, positions, normals, link="l_hand")


# The folder is shared by the examples of a test: each overwrites the file before it.
bounded = settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def through_csv(table: TaxelTable, folder: Path) -> TaxelTable:
    write_csv(table, folder / "t.csv")
    return read_csv(folder / "t.csv")


def through_icub(table: TaxelTable, folder: Path) -> TaxelTable:
    write_icub(table, folder / "t.txt")
    return read_icub(folder / "t.txt")


def through_urdf(table: TaxelTable, folder: Path) -> TaxelTable:
    write_tactile_urdf({"s": table}, folder / "t.urdf")
    return read_tactile_urdf(folder / "t.urdf")


@bounded
@given(table=tables())
@pytest.mark.parametrize("through", [through_csv, through_urdf])
def test_any_table_comes_back_with_the_same_bits(tmp_path, same_table, through, table):
    same_table(through(table, tmp_path), table)


@bounded
@given(table=tables(icub=True))
def test_tables_of_an_icub_come_back_with_the_same_bits(tmp_path, same_table, table):
    back = through_icub(table, tmp_path)
    same_table(back, table)
    assert back.link == table.link


@pytest.mark.parametrize("through", [through_csv, through_icub, through_urdf])
def test_real_files_come_back_with_the_same_bits(tmp_path, same_table, icub_main, through):
    files = sorted((icub_main / "positions").glob("*.txt"))
    assert len(files) == 19
    for path in files:
        table = read_icub(path)
        same_table(through(table, tmp_path), table)


@pytest.mark.parametrize("through", [through_csv, through_icub, through_urdf])
def test_parts_of_the_icub_come_back_with_the_same_bits(tmp_path, same_table, icub, through):
    for part in ("left_hand", "right_foot", "torso"):
        skin = icub.skin(part)
        table = TaxelTable(skin.channels, skin.modules, skin.positions, skin.normals)
        same_table(through(table, tmp_path), table)


def table_of(channels, **changes) -> TaxelTable:
    channels = np.array(channels)
    places = 1.0 + np.arange(3.0 * len(channels)).reshape(-1, 3)
    table = TaxelTable(channels, channels // 12, places, np.tile([0, 0, 2.0], (len(channels), 1)))
    return dataclasses.replace(table, **changes)


def test_write_icub_names_the_centre_of_each_module_or_its_first_taxel(tmp_path):
    table = table_of([0, 1, 3, 16, 17, 200])
    write_icub(table, tmp_path / "t.txt", name="chest")
    lines = (tmp_path / "t.txt").read_text().splitlines()
    assert lines[:2] == ["name chest", "spatial_sampling taxel"]
    assert lines[3] == "[calibration]"
    assert len(lines) == 4 + 2 * 192
    stated = [int(word) for word in lines[2].split()[2:-1]]
    assert len(stated) == 2 * 192
    assert {i: value for i, value in enumerate(stated) if value != ABSENT} == {
        0: 3, 1: 3, 3: 3, 16: 16, 17: 16, 200: 200,
    }  # fmt: skip
    assert lines[4 + 2] == "0.0 0.0 0.0 0.0 0.0 0.0"


def test_write_icub_keeps_what_a_file_said_of_thermal_and_absent_channels(tmp_path):
    table = table_of([0, 1, 3, 6, 15], representative=np.array([3, 3, ABSENT, THERMAL, -3]))
    back = through_icub(table, tmp_path)
    # The centre of the first module is absent, so its first taxel stands for it.
    np.testing.assert_array_equal(back.representative, [0, 0, ABSENT, THERMAL, 15])


def test_representatives_of_the_icubs_files_are_written_as_they_were(tmp_path, icub_main):
    for name in ("left_foot", "right_foot", "left_leg_lower", "left_leg_upper", "left_arm"):
        table = read_icub(icub_main / "positions" / f"{name}.txt")
        back = through_icub(table, tmp_path)
        listed = table.representative != -3  # the lists of the upper legs end early
        np.testing.assert_array_equal(back.representative[listed], table.representative[listed])


@pytest.mark.parametrize(
    ("table", "name", "message"),
    [
        (table_of([0, 1], modules=np.array([0, 4])), "x", "channel 1 is of module 4; .* write csv"),
        (table_of([0, 1], positions=np.eye(2, 3) * [1, 0, 1]), "x", "channel 1 lies in the origin"),
        (table_of([10**6]), "x", "channel 1000000: .* write csv"),
        (table_of([0]), "two words", "a name of one word, got 'two words'"),
        (table_of([0]), "a\n", "a name of one word"),
    ],
)
def test_write_icub_refuses_what_its_format_cannot_hold(tmp_path, table, name, message):
    with pytest.raises(OutputError, match=message):
        write_icub(table, tmp_path / "t.txt", name=name)
    assert not (tmp_path / "t.txt").exists()


def test_write_tactile_urdf_is_read_by_what_knows_no_attributes_of_ours(tmp_path, icub):
    skin = icub.skin("left_hand")
    table = TaxelTable(skin.channels, skin.modules, skin.positions, skin.normals, link="l_hand")
    write_tactile_urdf({"palm": table}, tmp_path / "t.urdf", robot="iCub")
    root = ET.parse(tmp_path / "t.urdf").getroot()
    for taxel in root.iter("taxel"):
        del taxel.attrib["module"], taxel.attrib["normal"]
        assert taxel.find("geometry/cylinder") is not None
    ET.ElementTree(root).write(tmp_path / "bare.urdf")
    back = read_tactile_urdf(tmp_path / "bare.urdf")
    assert back.link == "l_hand"
    np.testing.assert_array_equal(back.positions, table.positions)
    # Angles of unit vectors: the last bits go, no more.
    np.testing.assert_allclose(back.normals, table.normals, atol=4e-16)


def test_write_tactile_urdf_loads_as_a_urdf_and_holds_several_sensors(tmp_path):
    from skinmap.io.robots.urdf import UrdfBody

    sensors = {"<a> & b": table_of([0, 1]), "c": table_of([5])}
    write_tactile_urdf(sensors, tmp_path / "t.urdf")
    back = read_tactile_sensors(tmp_path / "t.urdf")
    assert {name: len(table) for name, table in back.items()} == {"<a> & b": 2, "c": 1}
    assert UrdfBody(tmp_path / "t.urdf").links == ("base",)


def test_write_tactile_urdf_refuses_what_is_no_robot(tmp_path):
    path = tmp_path / "t.urdf"
    with pytest.raises(OutputError, match=r"on one link, got \['base', 'tip'\]"):
        write_tactile_urdf({"a": table_of([0]), "b": table_of([0], link="tip")}, path)
    with pytest.raises(OutputError, match="on one link, got"):
        write_tactile_urdf({}, path)
    with pytest.raises(OutputError, match=r"cannot hold the name 'a\\x00'"):
        write_tactile_urdf({"a\0": table_of([0])}, path)
    assert not path.exists()


def test_an_empty_table_is_not_written(tmp_path):
    empty = table_of([0])
    empty = TaxelTable(*(getattr(empty, name)[:0] for name in empty.__slots__[:4]))
    with pytest.raises(OutputError, match="no taxel to write"):
        write_icub(empty, tmp_path / "t")
    assert list(tmp_path.iterdir()) == []
