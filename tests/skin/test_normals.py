from __future__ import annotations

import numpy as np
import pytest
import trimesh

from skinmap.errors import InvalidArrayError, SkinWarning
from skinmap.geometry.triangles import TriangleMesh
from skinmap.skin.cover import measure_fit
from skinmap.skin.normals import estimate_normals, repair_normals
from skinmap.skin.skin import Skin, skin_from_points, skin_from_table
from skinmap.skin.taxels import TaxelTable


def test_repair_normals_of_points_on_a_sphere_are_radial(sphere):
    vertices, faces = sphere
    normals = repair_normals(1.01 * vertices, TriangleMesh(vertices, faces))
    cosine = np.einsum("ij,ij->i", normals, vertices)
    # The nearest ten points of an icosphere are not quite symmetric about each vertex.
    assert cosine.min() > np.cos(np.radians(3))


def test_repair_normals_of_a_board_below_its_body_point_down(hexagons):
    board = np.column_stack([hexagons, np.zeros(len(hexagons))])
    plate = TriangleMesh(
        np.array([[-1.0, -1, 0.001], [1, -1, 0.001], [0, 1, 0.001]]), np.array([[0, 1, 2]])
    )
    normals = repair_normals(board + [0.0, -0.3, -0.001], plate)
    np.testing.assert_allclose(normals, np.tile([0, 0, -1.0], (len(board), 1)), atol=1e-9)


def test_repair_normals_without_a_body_warns(sphere):
    with pytest.warns(SkinWarning, match="a guess"):
        normals = repair_normals(sphere[0], None)
    assert (np.einsum("ij,ij->i", normals, sphere[0]) > 0).all()


@pytest.mark.parametrize("points", [np.zeros((2, 3)), np.outer(np.arange(9.0), [1, 2, 3])])
def test_repair_normals_refuses_what_spans_no_surface(points):
    with pytest.raises(InvalidArrayError, match="span no surface"):
        repair_normals(points, None)


def test_estimate_normals_are_unit(sphere):
    length = np.linalg.norm(estimate_normals(sphere[0]), axis=1)
    np.testing.assert_allclose(length, 1.0, rtol=1e-12)


def test_normals_of_the_icub_follow_its_body(icub):
    fits = [measure_fit(icub.skin(part), icub.mesh(icub.part(part).link)) for part in icub.parts]
    angle = np.degrees(np.concatenate([fit.normal_angle for fit in fits]))
    assert len(angle) == 4326
    assert np.median(angle) <= 5.0
    assert (angle <= 15.0).mean() >= 0.90
    assert sum(fit.inward.sum() for fit in fits) == 0


def test_measure_fit_sees_normals_that_point_inward(icub):
    skin = icub.skin("left_leg_upper")
    turned = Skin(skin.part, skin.link, skin.channels, skin.modules, skin.positions, -skin.normals)
    assert measure_fit(turned, icub.mesh(skin.link)).inward.mean() > 0.9


def test_skins_are_frozen(icub):
    skin = icub.skin("left_hand")
    with pytest.raises(ValueError, match="read-only"):
        skin.positions[0] = 0.0


def test_skin_refuses_channels_of_another_length(hexagons):
    points = np.column_stack([hexagons, np.zeros(len(hexagons))])
    up = np.tile([0.0, 0, 1], (len(points), 1))
    with pytest.raises(InvalidArrayError, match="channels and modules"):
        Skin("p", "l", np.arange(3), np.arange(3), points, up)
    assert len(skin_from_points(points, up)) == len(points)


@pytest.mark.parametrize("stored", [True, False])
def test_both_sides_of_a_thin_body_face_outwards(stored):
    places = np.stack(np.meshgrid(np.arange(12), np.arange(10)), -1).reshape(-1, 2) * 6e-3
    front = np.column_stack([places, np.full(120, 6.5e-3)])
    points = np.concatenate([front, front * [1, 1, -1]])
    out = np.repeat([[0.0, 0, 1], [0, 0, -1]], 120, axis=0)
    box = trimesh.creation.box([0.1, 0.1, 0.012])
    box.apply_translation([0.033, 0.027, 0])
    body = TriangleMesh(np.asarray(box.vertices), np.asarray(box.faces))
    index = np.arange(240)
    table = TaxelTable(index, index // 12, points, out if stored else np.zeros_like(out))
    alone = repair_normals(points, body)
    assert (np.einsum("ij,ij->i", alone, out) < 0).sum() >= 100  # the control
    skin = skin_from_table(table, body, "palm", "hand")
    np.testing.assert_allclose(skin.normals, out, atol=1e-9)
