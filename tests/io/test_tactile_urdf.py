from __future__ import annotations

import numpy as np
import pytest

from skinmap.errors import DataFormatError, SkinWarning
from skinmap.io.taxels.tactile_urdf import read_tactile_sensors, read_tactile_urdf
from skinmap.io.taxels.taxel_table import read_taxels

ARRAY = '<array rows="2" cols="3" size="0.01 0.02"/>'
TAXEL = '<taxel idx="4" xyz="0.1 0.2 0.3" rpy="0 1.5707963267948966 0"/>'


def sensor(tactile: str, *, name: str = "s", origin: str = "") -> str:
    return (
        f'<sensor name="{name}" update_rate="100"><parent link="tip"/>{origin}\n'
        f'<tactile channel="c">\n{tactile}</tactile></sensor>'
    )


@pytest.fixture
def urdf(tmp_path):
    """A function that writes a URDF around sensors and returns its path."""

    def write(*sensors: str, head: str = '<robot name="r">'):
        text = f'{head}<link name="tip"/>\n' + "\n".join(sensors) + "</robot>"
        (tmp_path / "r.urdf").write_text(text)
        return tmp_path / "r.urdf"

    return write


def test_read_tactile_urdf_lays_rows_along_x(urdf):
    table = read_taxels(urdf(sensor(ARRAY)))
    assert table.link == "tip"
    np.testing.assert_array_equal(table.channels, range(6))
    np.testing.assert_allclose(table.positions[:, 0], 0.01 * np.array([0, 0, 0, 1, 1, 1]))
    np.testing.assert_allclose(table.positions[:, 1], 0.02 * np.array([0, 1, 2, 0, 1, 2]))
    np.testing.assert_array_equal(table.normals, np.tile([0.0, 0.0, 1.0], (6, 1)))


@pytest.mark.parametrize("order", ["col-major", "column-major"])
def test_read_tactile_urdf_counts_columns_first_where_told(urdf, order):
    array = ARRAY.replace("size", f'order="{order}" spacing="0.1 -1" offset="1 2" size')
    table = read_tactile_urdf(urdf(sensor(array)))
    np.testing.assert_allclose(table.positions[:, 0], 0.1 * np.array([0, 1, 0, 1, 0, 1]) - 1)
    np.testing.assert_allclose(table.positions[:, 1], -np.array([0, 0, 1, 1, 2, 2]) - 2.0)


def test_read_tactile_urdf_turns_z_into_the_normal_and_then_places_the_sensor(urdf):
    origin = '<origin xyz="1 0 0" rpy="0 0 1.5707963267948966"/>'
    table = read_tactile_urdf(urdf(sensor(TAXEL, origin=origin)))
    # Pitch takes z to x, the sensor's yaw takes x to y; the reference rotates by scipy.
    np.testing.assert_allclose(table.normals, [[0, 1, 0]], atol=1e-15)
    np.testing.assert_allclose(table.positions, [[0.8, 0.1, 0.3]], atol=1e-15)


def test_rpy_is_about_fixed_axes(urdf, rng):
    from scipy.spatial.transform import Rotation

    rpy, xyz, shift = rng.normal(size=(3, 3))
    words = " ".join(repr(float(value)) for value in rpy)
    origin = f'<origin xyz="{" ".join(map(str, shift.tolist()))}" rpy="{words}"/>'
    taxel = f'<taxel idx="0" xyz="{" ".join(map(str, xyz.tolist()))}" rpy="{words}"/>'
    table = read_tactile_urdf(urdf(sensor(taxel, origin=origin)))
    turn = Rotation.from_euler("xyz", rpy)  # lower case: extrinsic
    np.testing.assert_allclose(table.positions[0], turn.apply(xyz) + shift, atol=1e-14)
    np.testing.assert_allclose(table.normals[0], (turn * turn).apply([0, 0, 1]), atol=1e-14)


def test_read_tactile_urdf_reads_any_namespace(urdf):
    path = urdf(sensor(TAXEL), head='<robot name="r" xmlns="http://www.ros.org">')
    assert len(read_tactile_urdf(path)) == 1


def test_several_sensors_are_read_by_name(urdf):
    camera = '<sensor name="camera"><parent link="tip"/><camera/></sensor>'
    path = urdf(sensor(TAXEL, name="a"), camera, sensor(ARRAY, name="b"))
    assert {name: len(table) for name, table in read_tactile_sensors(path).items()} == {
        "a": 1,
        "b": 6,
    }
    with pytest.raises(DataFormatError, match="several tactile sensors, make a file of each: a, b"):
        read_tactile_urdf(path)


def test_what_is_ignored_is_said(urdf):
    with pytest.warns(SkinWarning, match="the rest is ignored"):
        assert len(read_tactile_urdf(urdf(sensor(TAXEL + ARRAY)))) == 1
    with pytest.warns(SkinWarning, match="'s' comes twice; the first one counts"):
        assert len(read_tactile_urdf(urdf(sensor(TAXEL), sensor(ARRAY)))) == 1


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('idx="4"', "", r"r\.urdf:4: <taxel> lacks 'idx'"),
        ('idx="4"', 'idx="-4"', ":4: idx starts at 0"),
        ('idx="4"', 'idx="4.5"', ":4: expected a whole number, got '4.5'"),
        ("0.1 0.2 0.3", "0.1 0.2", ":4: xyz needs 3 numbers, got 2"),
        ("0.1 0.2 0.3", "0.1 0.2 nan", ":4: expected a finite number"),
        ("0.1 0.2 0.3", "${x} 0.2 0", r"got '\$\{x\}'"),
        (TAXEL, TAXEL + TAXEL, "channel 4 comes more than once"),
        (TAXEL, TAXEL.replace("idx", 'normal="0 0 1" idx'), ":4: normal and rpy disagree"),
        (TAXEL, "", ":3: <tactile> has neither"),
        (TAXEL, ARRAY.replace('"2"', '"0"'), ":4: rows and cols start at 1"),
        (TAXEL, ARRAY.replace('"2"', '"99999999"'), ":4: .* more than 100000 taxels"),
        (TAXEL, ARRAY.replace("size", 'order="spiral" size'), "no order 'spiral'"),
        (TAXEL, ARRAY.replace("size", "sizes"), "<array> lacks 'size'"),
        (TAXEL, ARRAY.replace("0.01", "1e308").replace('"2"', '"9"'), "NaN or infinity"),
        ('<parent link="tip"/>', "", "lacks <parent"),
        ('<parent link="tip"/>', "<parent/>", "<parent> lacks 'link'"),
        ("tactile", "camera", "no <sensor> with <tactile>"),
        ("robot", "robert", "not a URDF: <robert>"),
    ],
)
def test_read_tactile_urdf_names_file_and_line(urdf, old, new, message):
    path = urdf(sensor(TAXEL))
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(DataFormatError, match=message):
        read_tactile_urdf(path)
