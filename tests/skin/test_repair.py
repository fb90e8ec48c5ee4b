from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from skinmap.errors import DataFormatError, InvalidArrayError, SkinWarning, UnknownNameError
from skinmap.geometry.proximity import nearest
from skinmap.geometry.rigid import rigid_fit
from skinmap.io.taxels.icub import read_icub
from skinmap.skin.checks import ModuleCheck, mirror_distance, twin_parts
from skinmap.skin.cover import fit_to_mesh
from skinmap.skin.modules import BUILTIN, ModuleLayout, fit_modules, module_layout, shared_places
from skinmap.skin.repair import detect_unit, repair_table, take
from skinmap.skin.skin import skin_from_table
from skinmap.skin.taxels import THERMAL, TaxelTable

POSITIONS = Path(__file__).parents[3] / "shared" / "data" / "icub-main" / "positions"
LAYOUT = BUILTIN["triangle_10pad"]
TACTILE = np.flatnonzero(~LAYOUT.thermal)
real_files = pytest.mark.skipif(
    not POSITIONS.is_dir(), reason="the position files of icub-main are not beside the checkout"
)


def real(name: str) -> TaxelTable:
    return read_icub(POSITIONS / f"{name}.txt")


@pytest.fixture
def boards():
    """Six 10-pad boards on a plane, tactile slots only, in row-major places 40 mm apart."""
    positions, channels = [], []
    for module in range(6):
        shift = 0.04 * np.array([module % 3, module // 3, 0])
        turn = Rotation.from_rotvec([0, 0, 2.0 * np.pi / 3.0 * module]).as_matrix()
        flat = np.column_stack([LAYOUT.xy[TACTILE], np.zeros(len(TACTILE))])
        positions.append(flat @ turn.T + shift)
        channels.append(12 * module + TACTILE)
    channel = np.concatenate(channels)
    points = np.concatenate(positions)
    return TaxelTable(channel, channel // 12, points, np.tile([1.0, 0, 0], (len(points), 1)))


def collapse(table: TaxelTable, module: int, slots: list[int]) -> TaxelTable:
    """The table with some slots of a module at the place of its centre."""
    positions = table.positions.copy()
    centre = positions[table.channels == 12 * module + LAYOUT.centre]
    positions[np.isin(table.channels, 12 * module + np.array(slots))] = centre
    return replace(table, positions=positions)


def test_layouts_have_their_pitch():
    assert pytest.approx(6.533e-3, abs=2e-6) == BUILTIN["triangle_10pad"].pitch
    assert pytest.approx(5e-3, abs=2e-6) == BUILTIN["triangle_12pad"].pitch
    assert BUILTIN["triangle_10pad"].thermal.sum() == 2


def test_the_nominal_11_pad_has_its_published_numbers():
    board = BUILTIN["triangle_11pad"]
    assert (len(board), board.thermal.sum(), board.side) == (11, 0, 0.03)
    assert board.pitch == pytest.approx(8e-3, abs=0.02e-3)
    # Every taxel's centre lies on the triangular board: within its inradius of all three sides.
    inward = np.array([[0.0, 1.0], [3**0.5 / 2, -0.5], [-(3**0.5) / 2, -0.5]])
    assert (board.xy @ inward.T >= -0.03 / (2 * 3**0.5)).all()


def test_rigid_fit_recovers_a_planted_motion(rng):
    places = rng.normal(size=(8, 3))
    turn = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
    fit = rigid_fit(places, places @ turn.T + [1, 2, 3], np.ones(8))
    np.testing.assert_allclose(fit[:3, :3], turn, atol=1e-12)
    np.testing.assert_allclose(fit[:3, 3], [1, 2, 3], atol=1e-12)


def test_fit_modules_finds_planted_boards(boards):
    poses = fit_modules(boards, LAYOUT)
    assert sorted(poses) == list(range(6))
    for module, pose in poses.items():
        np.testing.assert_allclose(
            pose.T_link_module[:3, 3], 0.04 * np.array([module % 3, module // 3, 0]), atol=1e-12
        )
        assert pose.sure
        assert pose.residual < 1e-12


@pytest.mark.parametrize("slots", [[4, 5, 7], [0, 1, 2, 4, 5, 8], [0, 1, 2, 4, 5, 7, 8, 9]])
def test_collapsed_taxels_return_to_their_planted_places(boards, slots):
    # The last case leaves slots 3 and 11: two places, and a normal lent by the neighbours.
    report = repair_table(collapse(boards, 2, slots), LAYOUT)
    np.testing.assert_allclose(report.table.positions, boards.positions, atol=1e-9)
    assert set(report.rebuilt) == {24 + slot for slot in [*slots, LAYOUT.centre]}
    assert len(report.unplaced) == 0


def test_repair_without_a_layout_reports_what_it_leaves(boards):
    report = repair_table(collapse(boards, 2, [4, 5]), None)
    assert set(report.unplaced) == {24 + 3, 24 + 4, 24 + 5}
    assert len(report.rebuilt) == 0


def test_repair_is_reversible(boards):
    broken = collapse(boards, 2, [4, 5])
    report = repair_table(broken, LAYOUT)
    assert report.original is broken
    undone = repair_table(report.original, LAYOUT, steps=["units", "thermal"])
    np.testing.assert_array_equal(undone.table.positions, broken.positions)


def test_boards_of_another_layout_are_left_alone(boards, rng):
    noisy = replace(boards, positions=boards.positions + rng.normal(scale=8e-3, size=(60, 3)))
    broken = collapse(noisy, 2, [4, 5])
    report = repair_table(broken, LAYOUT)
    np.testing.assert_array_equal(report.table.positions, broken.positions)
    assert len(report.unplaced) == 3


@pytest.mark.parametrize(
    ("unit", "factor"), [("mm", 1e3), ("cm", 1e2), ("inch", 1 / 0.0254), ("mil", 1e3 / 0.0254)]
)
def test_units_are_told_from_the_pitch(boards, unit, factor):
    mixed_up = replace(boards, positions=boards.positions * factor)
    with pytest.warns(SkinWarning, match=f"positions are in {unit}"):
        report = repair_table(mixed_up, LAYOUT)
    assert report.unit == unit
    np.testing.assert_allclose(report.table.positions, boards.positions, rtol=1e-12)


def test_metres_stay_metres(boards):
    assert detect_unit(boards.positions, LAYOUT) == "m"
    assert detect_unit(boards.positions, None) == "m"


def test_thermal_pads_go_by_the_files_word_and_by_their_slot():
    channels = np.arange(12)
    stated = np.full(12, 3)
    stated[6], stated[10] = THERMAL, -1
    points = np.column_stack([LAYOUT.xy, np.zeros(12)])
    table = TaxelTable(channels, channels // 12, points, np.zeros((12, 3)), stated)
    np.testing.assert_array_equal(repair_table(table, LAYOUT).thermal, [6, 10])
    np.testing.assert_array_equal(repair_table(table, None).thermal, [6])
    silent = TaxelTable(channels, channels // 12, points, np.zeros((12, 3)))
    np.testing.assert_array_equal(repair_table(silent, LAYOUT).thermal, [6, 10])
    channels = np.arange(20)  # numbered without the pads: no slots
    grid = 0.007 * np.column_stack([channels % 5, channels // 5, np.zeros(20)])
    dense = TaxelTable(channels, channels // 10, grid, np.zeros((20, 3)))
    assert len(repair_table(dense, LAYOUT).table) == 20


def test_take_keeps_rows_whole(boards):
    some = take(boards, boards.modules == 1)
    np.testing.assert_array_equal(some.channels, 12 + TACTILE)


@real_files
@pytest.mark.parametrize(
    ("name", "taxels", "rebuilt", "thermal"),
    [
        ("left_forearm_V2", 240, 112, 0),
        ("right_forearm_V2", 240, 112, 0),
        ("torso", 440, 82, 88),
    ],
)
def test_real_collapsed_files_have_all_their_places_again(name, taxels, rebuilt, thermal):
    table = real(name)
    report = repair_table(table, LAYOUT)
    assert len(np.unique(report.table.positions, axis=0)) == len(report.table) == taxels
    assert (len(report.rebuilt), len(report.thermal)) == (rebuilt, thermal)
    modules = np.unique(table.modules[shared_places(table)])
    gaps = [
        nearest(report.table.positions[report.table.modules == module], 1)[0] for module in modules
    ]
    np.testing.assert_allclose(np.concatenate(gaps), 6.533e-3, atol=0.05e-3)


@real_files
def test_real_palm_marks_its_thermal_rows_absent_at_slots_of_its_own():
    table = real("left_hand_V2_1")
    pads = table.channels[table.representative == -1]
    assert set(pads % 12) == {7, 11}
    assert len(repair_table(table, None).table) == 48


@real_files
def test_real_short_and_long_lists_are_read():
    leg, arm = real("right_leg_upper"), real("left_arm")
    assert (leg.representative[leg.channels >= 960] == -3).all()  # past the end of its list
    assert (arm.representative >= 0).all()
    assert leg.channels.max() == 1343  # the last row is a real taxel


@real_files
def test_all_19_real_files_load():
    files = sorted(POSITIONS.glob("*.txt"))
    assert len(files) == 19
    for path in files:
        assert len(read_icub(path)) >= 48, path.name


def test_modules_of_the_icub_face_outward_within_5_degrees(icub):
    # The mean repaired normal of a module against the plane of its own taxels.
    for part in icub.parts:
        skin = icub.skin(part)
        angles = []
        for module in np.unique(skin.modules):
            rows = skin.modules == module
            points = skin.positions[rows] - skin.positions[rows].mean(axis=0)
            plane = np.linalg.svd(points)[2][2]
            mean = skin.normals[rows].mean(axis=0)
            cosine = abs(plane @ mean) / np.linalg.norm(mean)
            angles.append(np.degrees(np.arccos(min(cosine, 1.0))))
        assert np.median(angles) <= 5.0, part


def test_check_modules_finds_planted_faults(boards):
    poses = {m: pose.T_link_module for m, pose in fit_modules(boards, LAYOUT).items()}
    skin = up(boards)
    clean = ModuleCheck(boards, skin, LAYOUT, poses)
    assert (clean.missing, clean.swapped, clean.rotated, clean.mirrored) == ((), {}, (), ())
    assert clean.pitch == pytest.approx(6.533e-3, abs=1e-6)
    swapped = {**poses, 1: poses[4], 4: poses[1]}
    assert ModuleCheck(boards, skin, LAYOUT, swapped).swapped == {1: 4, 4: 1}
    turned = {**poses, 3: poses[3] @ np.diag([-1.0, -1, 1, 1])}
    assert ModuleCheck(boards, skin, LAYOUT, turned).rotated == (3,)
    extra = {**poses, 9: np.eye(4)}
    assert ModuleCheck(boards, skin, LAYOUT, extra).missing == (9,)
    mirrored = boards.positions.copy()
    rows = boards.modules == 5
    middle = mirrored[rows].mean(axis=0)
    mirrored[rows] = (mirrored[rows] - middle) * [-1, 1, 1] + middle
    table = replace(boards, positions=mirrored)
    assert ModuleCheck(table, up(table), LAYOUT, poses).mirrored == (5,)


def sized(factor: float, slots: int = 12) -> ModuleLayout:
    """The layout in another size, its first slots."""
    thermal = LAYOUT.thermal[:slots]
    return ModuleLayout("sized", factor * LAYOUT.xy[:slots], thermal, LAYOUT.centre)


@pytest.mark.parametrize(
    ("layout", "wrong"), [(sized(1), 0), (sized(2), 6), (sized(0.8), 6), (sized(1, 8), 6)]
)
def test_modules_that_do_not_fit_their_layout_are_told(boards, layout, wrong, rng):
    noisy = replace(boards, positions=boards.positions + rng.normal(scale=5e-4, size=(60, 3)))
    assert len(ModuleCheck(noisy, up(noisy), layout, {}).misfit) == wrong


def up(table: TaxelTable):
    """The skin of a flat table, normals up."""
    from skinmap.skin.skin import Skin

    normals = np.tile([0.0, 0, 1], (len(table), 1))
    return Skin("p", "l", table.channels, table.modules, table.positions, normals)


def test_icubs_left_and_right_parts_are_mirror_images(icub):
    for part in icub.parts:
        if part.startswith("left_"):
            here, there = (
                icub.repair(name).table.positions for name in (part, part.replace("left", "right"))
            )
            assert mirror_distance(here, there) < 0.5e-3, part


def test_mirror_distance_sees_another_shape(icub):
    foot, hand = (icub.repair(name).table.positions for name in ("left_foot", "right_hand"))
    assert mirror_distance(foot, hand) > 2e-3


def test_icubs_forearms_have_modules_that_the_urdf_puts_elsewhere(icub):
    part = "left_forearm"
    check = ModuleCheck(icub.repair(part).table, icub.skin(part), LAYOUT, icub.module_frames(part))
    assert len(check.swapped) == 16
    assert check.swapped[0] == 3


# What `neuromorphic_body_schema` reaches by its rigid fits: mean distance to the mesh [mm].
INCUMBENT = {
    "torso": 0.87, "left_arm": 0.64, "right_arm": 0.66, "left_forearm": 0.82,
    "right_forearm": 0.82, "left_hand": 0.87, "right_hand": 1.23, "left_leg_upper": 0.68,
    "right_leg_upper": 0.68, "left_leg_lower": 0.68, "right_leg_lower": 0.68, "left_foot": 1.1,
    "right_foot": 1.09,
}  # fmt: skip


def test_fit_to_mesh_beats_the_incumbent_on_every_part(icub):
    for part, bound in INCUMBENT.items():
        skin, mesh = icub.skin(part), icub.mesh(icub.part(part).link)
        fit = fit_to_mesh(skin.positions, mesh.vertices, mesh.faces)
        assert fit.after.mean() <= fit.before.mean()
        assert 1e3 * fit.after.mean() <= bound, part


def test_fit_to_mesh_recovers_a_planted_shift(half_cylinder):
    from skinmap.geometry.proximity import closest_on_mesh

    vertices, faces = half_cylinder
    points = vertices[faces].mean(axis=1)[::3]
    turn = Rotation.from_rotvec([0.02, 0.03, -0.02]).as_matrix()
    fit = fit_to_mesh(points @ turn.T + [0.01, 0.0, 0.01], vertices, faces)
    assert fit.before.mean() > 5e-3
    assert fit.after.mean() < 1e-4
    moved = (points @ turn.T + [0.01, 0, 0.01]) @ fit.T_fit_now[:3, :3].T + fit.T_fit_now[:3, 3]
    distance, _, _ = closest_on_mesh(moved, vertices, faces)
    np.testing.assert_allclose(distance, fit.after, atol=1e-12)


def test_user_layouts_are_read(tmp_path):
    (tmp_path / "b.toml").write_text(
        "slots_mm = [[0, 0], [5, 0], [0, 5], [9, 9]]\nthermal = [3]\ncentre = 1\nside_mm = 20\n"
    )
    layout = module_layout("b.toml", tmp_path)
    np.testing.assert_array_equal(layout.thermal, [False, False, False, True])
    assert (layout.centre, layout.side) == (1, 0.02)
    (tmp_path / "b.csv").write_text("slot,x_mm,y_mm,thermal\n0,0,0,0\n1,5,0,0\n2,0,5,0\n3,9,9,1\n")
    np.testing.assert_array_equal(module_layout("b.csv", tmp_path).xy, layout.xy)


@pytest.mark.parametrize("text", ["", "slots_mm = 3", "slots_mm = [[0, 0]]", "nonsense"])
def test_user_layouts_that_are_none_are_refused(tmp_path, text):
    (tmp_path / "b.toml").write_text(text)
    with pytest.raises(DataFormatError, match="not a module layout"):
        module_layout("b.toml", tmp_path)


def test_layouts_and_steps_are_named(boards):
    with pytest.raises(UnknownNameError, match="triangle_10pad, triangle_12pad, triangle_11pad"):
        module_layout("octagon")
    with pytest.raises(
        UnknownNameError, match="no repair step 'polish'; the repair steps are: units"
    ):
        repair_table(boards, LAYOUT, steps=["polish"])
    with pytest.raises(InvalidArrayError, match="fewer than three"):
        ModuleLayout("x", np.zeros((2, 2)), np.zeros(2, bool), 0)


def test_skin_from_a_repaired_table_has_unit_normals(icub):
    report = icub.repair("left_foot")
    skin = skin_from_table(report.table, icub.mesh("l_foot"), "left_foot", "l_foot")
    np.testing.assert_allclose(np.linalg.norm(skin.normals, axis=1), 1.0, rtol=1e-12)


@real_files
def test_real_forearm_marks_thermal_pads_as_absent():
    # No file of the forearm says -2: its pads are -1 and have no place.
    table = real("left_forearm_V2")
    assert not (table.representative == THERMAL).any()
    assert not np.isin(table.channels % 12, [6, 10]).any()


@real_files
def test_real_last_rows_are_taxels():
    for name, last in (("left_leg_upper", 1343), ("right_leg_upper", 1343), ("left_arm", 767)):
        assert real(name).channels.max() == last


@real_files
def test_real_normals_are_placeholders_or_absent():
    assert not real("left_forearm_nomesh").normals.any()
    length = np.linalg.norm(real("left_arm_mesh").normals, axis=1)
    assert 0.49 < length.min() < 0.99 < length.max() < 1.01
    assert len(np.unique(real("left_leg_lower").normals, axis=0)) == 1


@real_files
def test_real_shared_places_contain_the_modules_representative():
    for name in ("left_forearm_V2", "torso"):
        table = real(name)
        shared = shared_places(table)
        for module in np.unique(table.modules[shared]):
            group = table.channels[shared & (table.modules == module)]
            assert 12 * module + LAYOUT.centre in group, (name, module)


def test_stored_normals_of_nine_live_parts_are_far_from_their_modules(icub):
    # What the files ship: the median angle between stored normal and module plane per part.
    far = 0
    for part in icub.parts:
        table, skin = icub.repair(part).original, icub.skin(part)
        length = np.linalg.norm(table.normals, axis=1)
        cosine = np.abs(np.einsum("ij,ij->i", table.normals, skin.normals)) / length
        far += np.degrees(np.median(np.arccos(np.clip(cosine, 0, 1)))) > 20.0
    assert far >= 9


def test_steps_of_a_robot_can_be_left_out(icub):
    import skinmap

    robot = skinmap.load_robot("icub")
    robot.steps = ("units",)
    skin = robot.skin("left_foot")
    np.testing.assert_array_equal(skin.normals, robot.repair("left_foot").original.normals)
    assert not np.allclose(skin.normals, icub.skin("left_foot").normals)


def some(skin, rows):
    """Some taxels of a skin."""
    from skinmap.skin.skin import Skin

    columns = (skin.channels, skin.modules, skin.positions, skin.normals)
    return Skin(skin.part, skin.link, *(column[rows] for column in columns))


def test_a_part_and_its_mirror_image_are_twins_and_a_missing_module_parts_no_pair(icub):
    skins = {part: icub.skin(part) for part in icub.parts}
    worn = skins["right_arm"]
    skins["right_arm"] = some(worn, worn.modules != worn.modules[0])
    found = twin_parts(skins)
    assert len(skins["right_arm"]) == len(skins["left_arm"]) - 10
    wanted = {part: part.replace("right_", "left_") for part in icub.parts}
    assert found == wanted


def test_parts_of_one_count_and_another_shape_are_no_twins(icub):
    shape = {part: icub.skin(part) for part in ("torso", "left_foot")}
    shape["torso"] = some(shape["torso"], np.arange(430) < len(shape["left_foot"]))
    assert len(shape["torso"]) == len(shape["left_foot"])
    assert twin_parts(shape) == {"torso": "torso", "left_foot": "left_foot"}
