from dataclasses import replace

import numpy as np
import pytest

from skinmap import load_robot
from skinmap.geometry.triangles import face_areas, signed_areas
from skinmap.live.contacts.named_touch import NamedTouch
from skinmap.skin.skin import Skin
from skinmap.touch.prepared_skin import PreparedSkin
from tests.viewer.unpacking import unpack
from viewer.drawing.skin.skin_layer import (
    LIFT,
    FineSurface,
    body_places,
    flat_places,
    mark_scale,
    taxel_cells,
)
from viewer.drawing.touches.touch_marks import LONG, arrow
from viewer.web.scene_data import WebScene


@pytest.fixture(scope="module")
def tube():
    """A closed tube of 12 by 8 taxels, 20 mm wide: its flat map has a seam."""
    from skinmap.skin.skin import skin_from_points

    row, column = np.divmod(np.arange(96), 12)
    angle = 2 * np.pi * (column + 0.5 * (row % 2)) / 12
    out = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(96)])
    points = 0.01 * out + np.column_stack([np.zeros((96, 2)), 4.5e-3 * row])
    return PreparedSkin(skin_from_points(points, out))


def test_cells_share_each_triangle_out_equally(square_grid):
    vertices, faces = square_grid(5)
    cells, ends, corners = taxel_cells(faces)
    mids = vertices[ends].mean(axis=1)
    points = np.vstack([vertices, mids])
    points = np.vstack([points, points[corners].mean(axis=1)])
    quads = np.concatenate([cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]])
    areas = face_areas(points, quads).reshape(2, -1).sum(axis=0)
    expected = np.tile(face_areas(vertices, faces) / 3, 3)
    # Lines from a triangle's middle to those of its edges cut it into thirds; rounding only.
    np.testing.assert_allclose(areas, expected, rtol=1e-12)
    np.testing.assert_array_equal(cells[:, 0], faces.T.ravel())


def test_flat_map_has_all_triangles_though_a_seam_cuts_it(tube):
    fine = FineSurface(tube.mesh)
    assert sum(chart.seam_length for chart in tube.flat.charts) > 0, "the tube is cut open"
    places = flat_places(tube.flat, fine, 1e-3)
    assert len(places.faces) == len(fine.faces)
    np.testing.assert_array_equal(places.vertex[places.faces], fine.faces)
    edges = np.linalg.norm(np.diff(places.points[places.faces][:, [0, 1, 2, 0]], axis=1), axis=2)
    round_ = np.linalg.norm(np.diff(fine.positions[fine.faces][:, [0, 1, 2, 0]], axis=1), axis=2)
    # None lies across the map: flat triangles are as large as on the skin, but for distortion.
    assert (edges.max(axis=1) < 2 * round_.max(axis=1)).all()
    assert (signed_areas(places.points[:, :2], places.faces) > 0).all()
    assert len(places.taxels) > len(tube), "taxels on the seam stand on both of its sides"
    np.testing.assert_array_equal(places.owner, tube.mesh.faces.T.ravel())


def test_body_and_flat_map_show_the_same_value_at_the_same_taxel(tube):
    fine = FineSurface(tube.mesh)
    flat = flat_places(tube.flat, fine, 1e-3)
    body = body_places(tube.mesh, fine)
    values = np.random.default_rng(0).uniform(0, 255, len(tube))
    field = fine.smooth @ values
    for places in (body, flat):
        at = np.isin(places.vertex, np.arange(len(fine.taxels)))
        shown = field[places.vertex[at]]
        np.testing.assert_allclose(shown, values[fine.taxels[places.vertex[at]]], rtol=1e-12)


def test_discs_of_neighbours_do_not_touch(tube):
    from scipy.spatial import cKDTree

    places = body_places(tube.mesh, FineSurface(tube.mesh))
    apart = cKDTree(places.centres).query(places.centres, k=2)[0][:, 1]
    assert (2 * places.disc < apart).mean() > 0.95


@pytest.mark.parametrize(
    ("factor", "scale"), [(1.0, 1.0), (0.2, 0.2 * 6.5 / 4.5), (5.0, 39 * 5.0 * 6.5e-3 / 0.5)]
)
def test_lifts_and_arrows_are_of_the_size_of_the_skin(factor, scale):
    grid = np.mgrid[0:12, 0:40].reshape(2, -1).T * 6.5e-3
    flat = np.column_stack([grid, np.zeros(len(grid))])
    up, rows = np.tile([0.0, 0.0, 1.0], (len(flat), 1)), np.arange(len(flat))
    skin = Skin("plate", "link", rows, rows, factor * flat, up)
    assert mark_scale(skin) == pytest.approx(scale)
    mesh = PreparedSkin(skin).mesh
    places = body_places(mesh, FineSurface(mesh))
    assert places.centres[:, 2] == pytest.approx(2.35e-3 * scale)
    touch = NamedTouch("plate", rows[:3], np.zeros(3), "poke", 0.9, normal=up[0], peak=255.0)
    ((points, _, _),) = arrow(touch, np.eye(4), places.scale)
    assert np.ptp(points[:, 2]) == pytest.approx(LONG * scale)


def test_arrows_on_a_small_pad_are_about_as_long_as_it():
    grid = np.mgrid[0:8, 0:8].reshape(2, -1).T * 4e-3
    rows, up = np.arange(64), np.tile([0.0, 0.0, 1.0], (64, 1))
    skin = Skin("pad", "link", rows, rows, np.column_stack([grid, np.zeros(64)]), up)
    assert 0.5 * 0.028 < LONG * mark_scale(skin) < 1.5 * 0.028


def test_the_sheet_of_a_few_taxels_stays_above_a_cover():
    grid = np.mgrid[0:2, 0:2].reshape(2, -1).T * 5e-3
    rows, up = np.arange(4), np.tile([0.0, 0.0, 1.0], (4, 1))
    skin = Skin("pad", "link", rows, rows, np.column_stack([grid, np.zeros(4)]), up)
    assert LIFT * mark_scale(skin) >= 1e-3


def test_a_page_has_the_flat_map_whole_on_both_sides_of_a_seam(tube, opengl):
    robot = load_robot("kaspar")  # a link for the tube
    tube = PreparedSkin(replace(tube.skin, link=robot.skin("torso").link))
    header, arrays = unpack(WebScene(robot, {"torso": tube}).packed)
    part = header["parts"][0]
    assert part["flat_faces"][1] == part["sheet_faces"][1], "no face is left out"
    uv = np.concatenate([arrays["sheet.uv"], arrays["seam.uv"]]).reshape(-1, 2).astype(float)
    corners = [uv[arrays["flat.faces"].reshape(-1, 3)]]
    corners.append(np.concatenate([chart.uv[chart.faces] for chart in tube.flat.charts]))
    sent, whole = (np.linalg.det(np.diff(one, axis=1)).sum() for one in corners)
    assert sent == pytest.approx(whole, rel=1e-4)
    assert len(arrays["seam.taxels"]), "taxels on the seam stand on both of its sides"
