from __future__ import annotations

import re
import warnings

import numpy as np
import pytest

from skinmap.errors import DataFormatError, InvalidArrayError, SkinWarning
from skinmap.io.flat_maps.drawing import PLACES, Drawing, read_drawing
from skinmap.io.taxels.icub import read_icub
from skinmap.skin.modules import BUILTIN
from skinmap.skin.repair import repair_table

# Real drawings of which something cannot be placed: how many lines, of which types. All others
# are placed whole.
LEFT_OUT = {
    **{f"{side}_hand{kind}.ini": (5, {"fingertip"}) for side in ("left", "right")
       for kind in ("", "_V1_3", "_V2")},
    "left_hand_V2_1.ini": (5, {"fingertip2L"}),
    "right_hand_V2_1.ini": (5, {"fingertip2R"}),
    "left_hand_V2_2.ini": (5, {"fingertip3L"}),
    "right_hand_V2_2.ini": (5, {"fingertip3R"}),
    "right_arm_V2_7.ini": (8, {"triangle_10pad"}),
}  # fmt: skip
NOTHING = {
    "left_hand_R1.ini": ("cer_sh_pdl 0", "cer_sh_pp 2", "cer_sh_td 5", "cer_sh_tp 8"),
    "right_hand_R1.ini": ("cer_sh_pdr 0", "cer_sh_pp 2", "cer_sh_td 5", "cer_sh_tp 8"),
    "posfet_quad.ini": ("quad16 0",),
}


@pytest.fixture
def drawing(tmp_path):
    """A function that writes a drawing of some lines and returns its path."""

    def write(*lines: str, head: str = "robotPart x\nwidth 500\n[SENSORS]\n"):
        (tmp_path / "d.ini").write_text(head + "\n".join(lines) + "\n")
        return tmp_path / "d.ini"

    return write


def read_all(path) -> tuple[Drawing, list[str]]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        return read_drawing(path), [str(warning.message) for warning in caught]


def test_read_drawing_mirrors_then_turns_then_moves(drawing):
    plain = read_drawing(drawing("triangle_10pad 2 0 0 0 4"))
    np.testing.assert_array_equal(plain.channels, 24 + np.array([0, 1, 2, 3, 4, 5, 7, 8, 9, 11]))
    np.testing.assert_array_equal(plain.modules, [2] * 10)
    np.testing.assert_array_equal(plain.xy, BUILTIN["triangle_10pad"].tactile)
    turned = read_drawing(drawing("triangle_10pad 2 100 -20 90 4 1"))
    x, y = -plain.xy[:, 0], plain.xy[:, 1]  # mirrored; a quarter turn then takes x to y
    np.testing.assert_allclose(turned.xy, np.column_stack([0.1 - y, x - 0.02]), atol=1e-15)


def test_channels_are_counted_through_the_ids(drawing):
    with pytest.warns(SkinWarning, match="line 4: fingertip 0: its taxel places are not known"):
        found = read_drawing(
            drawing("fingertip 0 0 0 0 4", "triangle 12 90 0 0 4", "palmL 8 0 0 0 4 0 0")
        )
    palm = found.channels[found.channels < 144]
    np.testing.assert_array_equal(palm, np.setdiff1d(range(96, 144), [107, 119, 131, 139]))
    # The palm took 48 channels for its id; ids 9, 10 and 11 take twelve each.
    np.testing.assert_array_equal(found.channels[len(palm) :], range(180, 192))


def test_what_follows_a_type_of_unknown_size_is_left_out(drawing):
    path = drawing("triangle 0 0 0 0 4", "quad16 1 0 0 0 4", "triangle 2 50 0 0 4")
    with pytest.warns(SkinWarning) as caught:
        found = read_drawing(path)
    np.testing.assert_array_equal(found.modules, [0] * 12)
    assert found.skipped == (
        "line 5: quad16 1: its taxel places are not known",
        "line 6: triangle 2: it follows quad16 1, whose number of channels is not known",
    )
    assert all(note in str(caught[0].message) for note in found.skipped)


def test_the_first_of_two_equal_ids_counts(drawing):
    with pytest.warns(SkinWarning, match="line 5: triangle 3: id 3 is drawn in line 4"):
        found = read_drawing(drawing("triangle 3 0 0 0 4", "triangle 3 90 0 0 4"))
    assert len(found) == 12
    assert abs(found.xy).max() < 0.02


def test_layouts_other_than_the_first_are_left_out(drawing):
    with pytest.warns(SkinWarning, match="line 5: triangle 1: its layout 1 is not known"):
        read_drawing(drawing("triangle 0 0 0 0 4 1 0", "triangle 1 90 0 0 4 1 1"))


def test_comments_and_other_sections_are_no_modules(drawing):
    path = drawing("#triangle 0 0 0 0 4", "triangle 1 0 0 0 4 # mine", "[OTHER]", "x 1")
    assert len(read_drawing(path)) == 12


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("triangle 0 0 0 0", r"d\.ini:4: expected type id X Y theta gain .*, got 5 words"),
        ("triangle 0 0 0 0 4 0 0 7", ":4: .*got 9 words"),
        ("triangle x 0 0 0 4", ":4: expected a whole number, got 'x'"),
        ("triangle -1 0 0 0 4", ":4: id -1 is not in 0.."),
        ("triangle 99999 0 0 0 4", ":4: id 99999 is not in 0.."),
        ("triangle 0 nan 0 0 4", ":4: expected a finite number"),
        ("triangle 0 1e300 0 0 4", ":4: a place or an angle beyond"),
        ("triangle 0 0 0 0 4 2", ":4: mirror must be 0 or 1, got 2"),
        ("quad16 0 0 0 0 4", "nothing to place: line 4: quad16 0"),
        ("", "nothing to place: no module"),
    ],
)
def test_read_drawing_names_file_and_line(drawing, line, message):
    with pytest.raises(DataFormatError, match=message):
        read_drawing(drawing(line))


def test_read_drawing_wants_its_section(drawing):
    with pytest.raises(DataFormatError, match=r"no line \[SENSORS\]"):
        read_drawing(drawing("triangle 0 0 0 0 4", head=""))


def test_drawing_refuses_shapes_that_differ():
    with pytest.raises(InvalidArrayError, match="channels and modules"):
        Drawing(np.arange(2), np.arange(3), np.zeros((3, 2)))


def test_every_real_drawing_is_read_or_says_what_it_left_out(icub_main):
    files = sorted((icub_main / "skinGui").glob("*.ini"))
    assert len(files) == 49
    for path in files:
        if path.name in NOTHING:
            with pytest.raises(DataFormatError, match="nothing to place") as refused:
                read_drawing(path)
            assert re.findall(r"line \d+: (\S+ \d+):", str(refused.value)) == [*NOTHING[path.name]]
            continue
        found, said = read_all(path)
        assert len(found) > 0
        count, types = LEFT_OUT.get(path.name, (0, set()))
        assert len(found.skipped) == count, path.name
        assert {note.split()[2] for note in found.skipped} == types
        assert len(said) == bool(count)
        assert all(note in said[0] for note in found.skipped)


def test_the_eight_duplicates_of_right_arm_change_nothing(icub_main):
    found, said = read_all(icub_main / "skinGui" / "right_arm_V2_7.ini")
    assert len(found) == 350
    assert said[0].count("is drawn in line") == 8


@pytest.mark.parametrize(
    ("part", "ini"),
    [
        ("left_arm", "left_arm_V2_7"),  # not left_arm.ini: that is another build of the arm
        ("right_arm", "right_arm_V2_7"),
        ("left_forearm_V2", "left_forearm_V2"),
        ("right_forearm_V2", "right_forearm_V2"),
        ("left_foot", "left_foot"),
        ("right_foot", "right_foot"),
        ("left_leg_lower", "left_leg_lower"),
        ("right_leg_lower", "right_leg_lower"),
        ("left_leg_upper", "left_leg_upper"),
        ("right_leg_upper", "right_leg_upper"),
        ("torso", "torso"),
    ],
)
def test_real_drawings_have_the_channels_of_their_tables(icub_main, part, ini):
    table = read_icub(icub_main / "positions" / f"{part}.txt")
    tactile = repair_table(table, BUILTIN["triangle_10pad"], steps=("thermal",)).table
    found, _ = read_all(icub_main / "skinGui" / f"{ini}.ini")
    np.testing.assert_array_equal(found.channels, tactile.channels)
    np.testing.assert_array_equal(found.modules, tactile.modules)


def test_left_arm_does_not_belong_to_the_drawing_of_its_name(icub_main):
    table = read_icub(icub_main / "positions" / "left_arm.txt")
    found, _ = read_all(icub_main / "skinGui" / "left_arm.ini")
    assert set(found.modules) != set(table.modules)


@pytest.mark.parametrize(("side", "outward"), [("left", -1.0), ("right", 1.0)])
def test_palms_are_those_of_the_position_files_seen_from_outside(icub_main, side, outward):
    table = read_icub(icub_main / "positions" / f"{side}_hand_V2_1.txt")
    found, _ = read_all(icub_main / "skinGui" / f"{side}_hand_V2_1.ini")
    np.testing.assert_array_equal(found.channels, table.channels[table.representative >= 0])
    row = np.searchsorted(table.channels, found.channels)
    x, y, _ = table.positions[row].T
    # The palm is flat; from outside, a quarter turn to the left makes (x, y) of the right palm,
    # whose normal is +z, into (-y, x), and the left palm is its mirror image.
    seen = np.column_stack([-outward * y, x])
    np.testing.assert_allclose(found.xy - found.xy.mean(0), seen - seen.mean(0), atol=1e-12)
    assert (table.normals[:, 2] == outward).all()


def test_both_palms_have_the_same_places():
    left, right = PLACES["palmL"][1], PLACES["palmR"][1]
    assert {tuple(place) for place in left} == {tuple(place) for place in right}
    np.testing.assert_allclose(left.mean(0), 0.0, atol=1e-15)
