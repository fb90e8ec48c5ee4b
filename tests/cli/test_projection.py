"""The pictures of surfaces: views, the checkerboard, the order of painting."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from skinmap.geometry.triangles import cross_2d, face_areas, face_normals, signed_areas
from skinmap.report.flat_figures import (
    ENOUGH,
    SEEN,
    View,
    checkerboard,
    choose_views,
    draw_surface,
    shaded,
    square_side,
)

FRAME = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # up, front, side
FRONT = View("front", FRAME[1], FRAME[0])


def test_a_view_shows_outer_faces_counter_clockwise(sphere):
    vertices, faces = sphere
    for view in choose_views(vertices, faces, FRAME):
        seen = face_normals(vertices, faces) @ view.out > 1e-9  # rounding of faces on edge
        flat = view.project(vertices)
        assert (signed_areas(flat[:, :2], faces[seen]) > 0).all()
        np.testing.assert_allclose(flat[:, 2], vertices @ view.out)


def test_views_are_as_few_as_show_nearly_everything(sphere, square_grid):
    vertices, faces = square_grid(4)
    (only,) = choose_views(vertices, faces, np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]))
    assert only.name == "front"
    vertices, faces = sphere
    half = (vertices[faces].mean(axis=1)[:, 0] > 0) & (
        np.abs(vertices[faces].mean(axis=1)[:, 2]) < 0.6
    )
    views = choose_views(vertices, faces[half], FRAME)
    seen = np.any([face_normals(vertices, faces[half]) @ view.out > SEEN for view in views], axis=0)
    area = face_areas(vertices, faces[half])
    assert area[seen].sum() >= ENOUGH * area.sum()


def test_near_triangles_hide_far_ones_and_turned_ones_are_left_out():
    near = np.array([[1.0, -1, -1], [1, 1, -1], [1, 0, 1]])
    far, back = near - [2.0, 0, 0], near[::-1] + [1.0, 0, 0]
    polygons = np.stack([near, back, far])
    normals = np.array([[1.0, 0, 0], [-1, 0, 0], [1, 0, 0]])
    colours = np.array([[1.0, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1]])
    axis = Figure().subplots()
    draw_surface(axis, FRONT, polygons, normals, colours)
    (drawn,) = axis.collections
    painted = [to_hex(colour) for colour in drawn.get_facecolors()]
    blue, red = shaded(colours[[2, 0]], FRONT.project(normals[[2, 0]]))
    assert painted == [to_hex(blue), to_hex(red)]  # the far one first, the turned one not at all


def test_shade_is_darker_where_the_surface_looks_aside():
    white = np.ones((2, 4))
    facing, aside = shaded(white, np.array([[-0.4, 0.5, 0.77], [0.77, 0.6, 0.0]]))
    assert aside[0] < facing[0] <= 1.0
    assert (facing[3], aside[3]) == (1.0, 1.0)


def test_checkerboard_cuts_along_its_lines_and_loses_nothing(rng):
    uv = rng.uniform(-3, 3, size=(40, 3, 2))
    body = np.concatenate([uv, uv[..., :1] - 2 * uv[..., 1:]], axis=2)  # a plane through them
    pieces, triangle, colour = checkerboard(uv, body, 0.5)
    area = np.array([_polygon_area(piece[:, :2]) for piece in pieces])
    whole = np.abs(signed_areas(uv.reshape(-1, 2), np.arange(120).reshape(-1, 3)))
    np.testing.assert_allclose(np.bincount(triangle, area, minlength=40), whole, rtol=1e-9)
    for piece, shade in zip(pieces, colour, strict=True):
        cell = np.floor(piece[:, :2].mean(axis=0) / 0.5)
        assert (np.abs(piece[:, :2] / 0.5 - cell - 0.5) <= 0.5 + 1e-9).all()
        assert shade == cell.sum() % 2
        # Corners that cutting made lie on the triangle's plane, as all its points do.
        np.testing.assert_allclose(piece[:, 4], piece[:, 2] - 2 * piece[:, 3], atol=1e-9)


def _polygon_area(corners: np.ndarray) -> float:
    return float(abs(cross_2d(corners, np.roll(corners, -1, axis=0)).sum()) / 2)


@pytest.mark.parametrize(("size", "side"), [(1.0, 0.05), (140.0, 10.0), (3e-29, 2e-30)])
def test_squares_have_a_round_side(size, side):
    assert square_side(np.array([[0.0, 0.0], [size, 0.1 * size]])) == pytest.approx(side)
