"""Meshing at the edge of what numbers and shapes can be: a correct mesh or a named error."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from skinmap.errors import SkinError
from skinmap.geometry.topology import boundary_loops, check_surface, euler_number
from skinmap.geometry.triangles import face_normals, smallest_altitudes
from skinmap.skin.skin import skin_from_points
from skinmap.surface.surface_mesh import MESHING, build_surface


class Shape(NamedTuple):
    """Points with their normals, and the triangles that a body through them has."""

    points: np.ndarray
    normals: np.ndarray
    faces: np.ndarray


def shape(across, along, place, normal, *, round_u=False, round_v=False) -> Shape:
    """A grid of across x along points at place(u, v), closed in u or v where that is round."""
    u, v = np.divmod(np.arange(across * along), along)
    number = np.arange(across * along).reshape(across, along)
    cells = np.indices((across - (not round_u), along - (not round_v)))
    i, j = cells.reshape(2, -1)
    a, b = number[i, j], number[(i + 1) % across, j]
    c, d = number[(i + 1) % across, (j + 1) % along], number[i, (j + 1) % along]
    normals = np.stack(np.broadcast_arrays(*normal(u, v)), 1).astype(float)
    points = np.stack(np.broadcast_arrays(*place(u, v)), 1).astype(float)
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return Shape(points, normals, faces)


def up(u, v):
    return 0 * u, 0 * u, 1 + 0 * u


def turn(n):
    """Functions of u for cosine and sine of n steps round a circle."""
    return lambda u: np.cos(2 * np.pi * u / n), lambda u: np.sin(2 * np.pi * u / n)


def flat_grid(n: int = 11) -> Shape:
    return shape(n, n, lambda u, v: (u, v, 0 * u), up)


def bent_grid(n: int = 11) -> Shape:
    """A third of a cylinder of radius 5."""

    def normal(u, v):
        return -np.cos(u / 5.0), np.sin(u / 5.0), 0 * u

    def place(u, v):
        x, y, _ = normal(u, v)
        return 5.0 * x, 5.0 * y, v

    return shape(n, n, place, normal)


def torus() -> Shape:
    cos_u, sin_u = turn(28)
    cos_v, sin_v = turn(10)
    return shape(
        28, 10,
        lambda u, v: ((5 + 2 * cos_v(v)) * cos_u(u), (5 + 2 * cos_v(v)) * sin_u(u), 2 * sin_v(v)),
        lambda u, v: (cos_v(v) * cos_u(u), cos_v(v) * sin_u(u), sin_v(v)),
        round_u=True, round_v=True,
    )  # fmt: skip


def tube(around: int, along: int, step: float = 1.0) -> Shape:
    radius = around / (2 * np.pi)
    cos_u, sin_u = turn(around)
    return shape(
        around, along,
        lambda u, v: (radius * cos_u(u), radius * sin_u(u), step * v),
        lambda u, v: (cos_u(u), sin_u(u), 0 * u), round_u=True,
    )  # fmt: skip


def annulus() -> Shape:
    cos_u, sin_u = turn(24)
    return shape(
        24, 4, lambda u, v: ((4 + v) * cos_u(u), (4 + v) * sin_u(u), 0 * u), up, round_u=True
    )


def sphere() -> Shape:
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=2)
    points = np.asarray(ball.vertices, float)
    return Shape(points, points, np.asarray(ball.faces, np.int64))


def moebius() -> Shape:
    """A strip with one half turn; its normals jump to the other side where it meets itself."""
    n, wide = 40, 5
    angle, offset = np.divmod(np.arange(n * wide), wide)
    a, t = 2 * np.pi * angle / n, 0.15 * (offset - 2)
    radius = 1 + t * np.cos(a / 2)
    points = np.column_stack([radius * np.cos(a), radius * np.sin(a), t * np.sin(a / 2)])
    across = np.column_stack([np.cos(a / 2) * np.cos(a), np.cos(a / 2) * np.sin(a), np.sin(a / 2)])
    normals = np.cross(np.column_stack([-np.sin(a), np.cos(a), 0 * a]), across)
    band = shape(n, wide, lambda u, v: (u, v, 0 * u), up).faces
    return Shape(points, normals / np.linalg.norm(normals, axis=1, keepdims=True), band)


def mesh_of(of: Shape, method: str):
    """A mesh that holds what every mesh must hold."""
    body = (of.points, of.faces) if method == "accurate" else None
    mesh = build_surface(skin_from_points(of.points, of.normals), method=method, body=body)
    check_surface(mesh.faces)
    boundary_loops(mesh.faces)  # refuses two fans in a point
    at_most_one = (of.points - of.points.mean(axis=0)) / np.ptp(of.points)
    assert (smallest_altitudes(at_most_one, mesh.faces) > 0).all()
    outside = face_normals(at_most_one, mesh.faces)
    assert (np.einsum("ij,ikj->ik", outside, of.normals[mesh.faces]) > 0).all()
    return mesh


def as_one_sheet(mesh, taxels: int, faces: int) -> None:
    assert (mesh.taxel_patches == 0).all()
    assert (len(mesh.taxel_patches), len(mesh.faces)) == (taxels, faces)
    assert euler_number(mesh.faces) == 1


@pytest.mark.parametrize("method", MESHING)
@pytest.mark.parametrize("scale", [1e-30, 1e-9, 1e9, 1e30])
def test_scale_changes_nothing(method, scale):
    points, normals, faces = bent_grid()
    as_one_sheet(mesh_of(Shape(scale * points, normals, faces), method), 121, 200)


@pytest.mark.parametrize("method", MESHING)
@pytest.mark.parametrize("offset", [1.0, 1e4, 1e8])
def test_offset_changes_nothing_while_digits_last(method, offset):
    # Millimetres apart at 1e8 m: a hundred thousand times the last digit.
    points, normals, faces = bent_grid()
    as_one_sheet(mesh_of(Shape(5e-3 * points + offset, normals, faces), method), 121, 200)


@pytest.mark.parametrize("method", MESHING)
def test_float32_is_as_good_as_its_digits(method):
    points, normals, faces = bent_grid()
    single = Shape((5e-3 * points + 1.0).astype(np.float32), normals.astype(np.float32), faces)
    as_one_sheet(mesh_of(single, method), 121, 200)
    far = (5e-3 * points + 1e8).astype(np.float32)  # all of them one number
    with pytest.raises(SkinError, match="1 distinct taxels"):
        mesh_of(Shape(far, normals, faces), method)


@pytest.mark.parametrize("method", MESHING)
@pytest.mark.parametrize("gap", [0.0, 1e-15, 1e-12, 1e-9, 1e-6])
@pytest.mark.parametrize("copies", [1, 3])
def test_coincident_taxels_share_a_vertex(method, gap, copies):
    points, normals, faces = bent_grid()
    many = np.concatenate([5e-3 * points + [k * gap, 0, 0] for k in range(copies + 1)])
    mesh = mesh_of(Shape(many, np.tile(normals, (copies + 1, 1)), faces), method)
    np.testing.assert_array_equal(mesh.representative, np.tile(np.arange(121), copies + 1))
    as_one_sheet(mesh, 121 * (copies + 1), 200)


@pytest.mark.parametrize("method", MESHING)
@pytest.mark.parametrize("make", [flat_grid, bent_grid])
def test_square_grids_have_no_holes(method, make):
    as_one_sheet(mesh_of(make(20), method), 400, 2 * 19 * 19)


@pytest.mark.parametrize("method", MESHING)
def test_three_taxels_in_a_row_make_no_triangle(method):
    row = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 1, 0]])
    faces = np.array([[0, 1, 3], [1, 2, 3]])
    mesh = mesh_of(Shape(row, np.tile([0.0, 0, 1], (4, 1)), faces), method)
    assert sorted(map(sorted, mesh.faces.tolist())) == [[0, 1, 3], [1, 2, 3]]


@pytest.mark.parametrize("method", MESHING)
def test_three_taxels_make_one_triangle(method):
    corner = Shape(np.eye(3), np.full((3, 3), 3**-0.5), np.array([[0, 1, 2]]))
    assert len(mesh_of(corner, method).faces) == 1


@pytest.mark.parametrize("method", MESHING)
@pytest.mark.parametrize(
    "points", [np.outer(np.arange(6.0), [1, 2, 3]), np.outer(np.arange(500.0), [1e8, 0, 1])]
)
def test_points_in_a_row_have_no_faces(method, points):
    shape = Shape(points, np.tile([0.0, 0, 1], (len(points), 1)), np.array([[0, 0, 0]]))
    assert len(mesh_of(shape, method).faces) == 0


@pytest.mark.parametrize("method", MESHING)
@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.zeros((5, 3)), np.full((2000, 3), 0.1)])
def test_too_few_points_are_named(method, points):
    faces = np.array([[0, 0, 0]])
    with pytest.raises(SkinError, match=r"distinct taxels|no three of|no faces|index"):
        mesh_of(Shape(points, np.tile([0.0, 0, 1], (len(points), 1)), faces), method)


@pytest.mark.parametrize("method", MESHING)
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_are_named(method, value):
    for name in ("points", "normals"):
        of = flat_grid()._replace(**{name: getattr(flat_grid(), name).copy()})
        getattr(of, name)[7, 1] = value
        with pytest.raises(SkinError, match="NaN or infinity, first in row 7"):
            mesh_of(of, method)


def test_a_body_that_is_not_finite_is_named():
    points, normals, faces = flat_grid()
    with pytest.raises(SkinError, match="vertices holds NaN or infinity, first in row 3"):
        body = points.copy()
        body[3] = np.nan
        build_surface(skin_from_points(points, normals), method="accurate", body=(body, faces))


@pytest.mark.parametrize("method", MESHING)
def test_two_components_stay_apart(method):
    points, normals, faces = flat_grid()
    both = Shape(
        np.concatenate([points, points[:66] + [30.0, 0, 0]]),
        np.concatenate([normals, normals[:66]]),
        np.concatenate([faces, faces[(faces < 66).all(axis=1)] + 121]),
    )
    mesh = mesh_of(both, method)
    np.testing.assert_array_equal(mesh.taxel_patches, np.repeat([0, 1], [121, 66]))


@pytest.mark.parametrize("method", MESHING)
@pytest.mark.parametrize(("make", "number", "loops"), [
    (sphere, 2, 0), (torus, 0, 0), (annulus, 0, 2), (moebius, 1, 1),
    (lambda: tube(12, 8), 0, 2),
])  # fmt: skip
def test_closed_and_holed_shapes_keep_their_euler_number(method, make, number, loops):
    # A Moebius strip has no outside: the mesh is the strip cut where the normals jump, a disc.
    mesh = mesh_of(make(), method)
    assert (mesh.taxel_patches == 0).all()
    assert euler_number(mesh.faces) == number
    assert len(boundary_loops(mesh.faces)) == loops


@pytest.mark.parametrize("method", MESHING)
def test_a_tube_a_hundred_times_as_long_as_wide_stays_open(method):
    # Seven taxels round it: both ends are loops as short as those of spurious holes.
    long = tube(7, 2 + round(100 * 7 / np.pi))
    mesh = mesh_of(long, method)
    assert np.ptp(long.points[:, 2]) >= 100 * 7 / np.pi
    assert (mesh.taxel_patches == 0).all()
    assert euler_number(mesh.faces) == 0
    assert [len(loop) for loop in boundary_loops(mesh.faces)] == [7, 7]


@pytest.mark.parametrize("method", ["consensus", "fast"])
def test_clouds_that_are_no_surface_give_a_mesh_or_a_named_error(method):
    rng = np.random.default_rng(1)
    for number in range(40):
        n = int(rng.integers(3, 120))
        points = [
            rng.uniform(size=(n, 3)),
            rng.integers(0, 5, size=(n, 3)) * 1.0,
            rng.standard_cauchy(size=(n, 3)),
            np.exp(10 * rng.normal(size=(n, 1))) * rng.normal(size=(n, 3)),
        ][number % 4]
        normals = rng.normal(size=(n, 3)) * (rng.uniform(size=(n, 1)) < 0.95)
        widest = None if number % 3 else float(np.ptp(points))
        try:
            mesh = build_surface(
                skin_from_points(points, normals), method=method, max_edge=widest, largest_hole=50
            )
        except SkinError:
            continue
        check_surface(mesh.faces)
        boundary_loops(mesh.faces)
