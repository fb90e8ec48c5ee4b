"""Surfaces at the edge of what numbers and shapes can be: a correct map or a named error."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest

from skinmap.errors import FlatteningError, InvalidMeshError, SkinError, SkinWarning
from skinmap.flat.distortion import measure_distortion
from skinmap.flat.flat_map import flatten, flatten_disc
from skinmap.flat.methods import flatteners
from skinmap.flat.seams import open_surface
from skinmap.geometry.triangles import signed_areas
from skinmap.skin.skin import skin_from_points
from skinmap.surface.surface_mesh import build_surface

METHODS = ["tutte", "harmonic", "lscm", "bff", "balanced", "accurate", "dirichlet", "auto"]


def dome(n: int = 9) -> tuple[np.ndarray, np.ndarray]:
    """A grid bent over a shallow dome: n x n vertices, about one unit wide."""
    row, column = np.divmod(np.arange(n * n), n)
    x, y = column / (n - 1), row / (n - 1)
    vertices = np.column_stack([x, y, 0.3 * np.sin(np.pi * x) * np.sin(np.pi * y)])
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    lower = np.column_stack([corner, corner + 1, corner + n])
    upper = np.column_stack([corner + 1, corner + n + 1, corner + n])
    return vertices, np.concatenate([lower, upper])


def lay(vertices, faces, method="balanced"):
    """A flat map that is finite and free of flips, or a SkinError."""
    uv, _, _ = flatten_disc(vertices, faces, method=method)
    assert np.isfinite(uv).all()
    assert (signed_areas(uv, faces) > 0).all()
    return uv


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("scale", [1e-30, 1e-9, 1e-3, 1e9, 1e30])
def test_scale_changes_nothing(method, scale):
    vertices, faces = dome()
    plain = lay(vertices, faces, method)
    scaled = lay(vertices * scale, faces, method)
    np.testing.assert_allclose(scaled / scale, plain, rtol=0, atol=1e-9)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("offset", [1.0, 1e4, 1e8])
def test_offset_changes_nothing_but_the_digits_it_takes(method, offset):
    vertices, faces = dome()
    plain = measure_distortion(vertices, faces, lay(vertices, faces, method))
    moved = vertices + offset
    other = measure_distortion(moved, faces, lay(moved, faces, method))
    # 1e8 leaves eight digits of coordinates of size one.
    assert other.edge_rms == pytest.approx(plain.edge_rms, abs=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_float32_input_is_as_good_as_its_digits(method):
    vertices, faces = dome()
    single = vertices.astype(np.float32)
    np.testing.assert_allclose(
        lay(single.astype(float), faces, method), lay(vertices, faces, method), atol=1e-5
    )


@pytest.mark.filterwarnings("ignore::skinmap.errors.SkinWarning")
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("height", [1e-2, 1e-4, 1e-8, 1e-13, 0.0])
def test_slivers_flatten_or_are_named(method, height):
    vertices, faces = dome()
    # Vertex 40, in the middle, moved to a hair's breadth of the edge between 31 and 39.
    vertices[40] = 0.5 * (vertices[31] + vertices[39]) + [height, height, 0]
    # Named or flat and free of flips; `lay` fails on anything in between.
    with contextlib.suppress(FlatteningError):
        lay(vertices, faces, method)


@pytest.mark.parametrize("gap", [0.0, 1e-15, 1e-12, 1e-9, 1e-6])
def test_near_coincident_taxels_share_a_vertex_or_stand_alone(gap):
    vertices, _ = dome(9)
    points = 0.05 * np.concatenate([vertices, vertices[40:41] + gap])
    normals = np.tile([0.0, 0, 1], (len(points), 1))
    mesh = build_surface(skin_from_points(points, normals))
    assert mesh.representative[-1] == 40
    flat = flatten(mesh)
    assert flat.flips == 0
    assert np.isfinite(flat.uv).all()


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.zeros((5, 3))])
def test_too_few_points_are_named(points):
    normals = np.tile([0.0, 0, 1], (len(points), 1))
    with pytest.raises(SkinError, match=r"distinct taxels|no three"):
        build_surface(skin_from_points(points, normals))


@pytest.mark.parametrize("points", [np.zeros((1, 3)), np.eye(3)[:2]])
def test_one_or_two_taxels_are_discs_without_a_triangle(points):
    normals = np.tile([0.0, 0, 1], (len(points), 1))
    mesh = build_surface(skin_from_points(points, normals))
    assert len(mesh.faces) == 0
    assert mesh.representative.tolist() == list(range(len(points)))


def test_three_taxels_make_one_triangle():
    mesh = build_surface(skin_from_points(np.eye(3), np.ones((3, 3)) / np.sqrt(3)))
    flat = flatten(mesh)
    assert len(mesh.faces) == 1
    np.testing.assert_allclose(flat.charts[0].distortion.edge_strain, 0.0, atol=1e-9)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_are_named(value):
    points = dome()[0]
    points[7, 1] = value
    with pytest.raises(SkinError, match="NaN or infinity, first in row 7"):
        skin_from_points(points, np.tile([0.0, 0, 1], (81, 1)))


def test_reversed_and_non_manifold_faces_are_named():
    vertices, faces = dome()
    turned = faces.copy()
    turned[5] = turned[5][::-1]
    with pytest.raises(SkinError, match=r"opposite ways|lies in"):
        flatten_disc(vertices, turned)
    fin = np.concatenate([faces, [[faces[0][1], faces[0][0], 80]]])
    with pytest.raises(SkinError, match=r"lies in 3 faces|opposite ways|meet in one vertex"):
        flatten_disc(vertices, np.concatenate([fin, [[faces[0][0], faces[0][1], 79]]]))


def test_two_components_in_one_call_are_named():
    vertices, faces = dome(4)
    both = np.concatenate([vertices, vertices + [2, 0, 0]])
    with pytest.raises(SkinError, match=r"no disc|wide hole"):
        flatten_disc(both, np.concatenate([faces, faces + len(vertices)]))


def test_a_moebius_strip_is_named():
    n = 40
    angle = 2 * np.pi * np.arange(n) / n
    across = np.array([-0.2, 0.2])
    twist = angle / 2
    radius = 1 + across[None] * np.cos(twist)[:, None]
    vertices = np.stack(
        [radius * np.cos(angle)[:, None], radius * np.sin(angle)[:, None],
         across[None] * np.sin(twist)[:, None]], -1
    ).reshape(-1, 3)  # fmt: skip
    faces = []
    for i in range(n):
        a, b = 2 * i, 2 * i + 1
        c, d = (2 * i + 2, 2 * i + 3) if i < n - 1 else (1, 0)
        faces += [[a, c, b], [b, c, d]]
    with pytest.raises(SkinError, match="opposite ways"):
        flatten_disc(vertices, np.array(faces))


@pytest.mark.parametrize("method", METHODS)
def test_every_method_is_checked_and_replaced_when_it_fails(method, monkeypatch):
    vertices, faces = dome()
    broken = dict(flatteners._own)
    broken[method] = lambda v, f, loop: np.full((len(v), 2), np.nan)
    monkeypatch.setattr(flatteners, "_own", broken)
    if method in ("tutte", "bff", "auto"):  # auto looks no method up: it runs ours on one disc
        uv, used, _ = flatten_disc(vertices, faces, method="harmonic")
        assert used == "harmonic"
        return
    with pytest.warns(SkinWarning, match=f"{method} flips or fails, bff is used"):
        uv, _, _ = flatten_disc(vertices, faces, method=method)
    assert np.isfinite(uv).all()


def test_an_annulus_is_cut_open():
    n = 24
    angle = 2 * np.pi * np.arange(n) / n
    ring = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    points = np.concatenate([r * ring for r in (0.6, 0.75, 0.9, 1.05)])
    mesh = build_surface(skin_from_points(points, np.tile([0.0, 0, 1], (4 * n, 1))))
    flat = flatten(mesh)
    assert flat.flips == 0
    assert flat.charts[0].distortion.edge_rms < 0.05  # a flat ring stays nearly as it is


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("offset", [1e4, 1e8])
def test_float32_far_from_the_origin_is_laid_flat_or_named(method, offset):
    vertices, faces = dome()
    single = (vertices + offset).astype(np.float32).astype(float)
    # 1e8 leaves steps of 8 m: all points coincide but for a few. 1e4 leaves 1 mm of a metre.
    if offset == 1e8:
        with pytest.raises(SkinError, match=r"without area|is not manifold|opposite ways"):
            lay(single, faces, method)
    else:
        lay(single, faces, method)


@pytest.mark.filterwarnings("ignore::skinmap.errors.SkinWarning")
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("degrees", [1e-2, 1e-5, 1e-8, 1e-10, 1e-13])
def test_sliver_angles_flatten_or_are_named(method, degrees):
    """Two right triangles whose apex angle is a hair, beside a healthy one."""
    height = np.tan(np.radians(degrees))
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [1, height, 0], [0, height, 0.0], [0.5, -1, 0.2]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [1, 0, 4]])
    with contextlib.suppress(FlatteningError):
        uv = lay(vertices, faces, method)
        # Developable: whoever keeps lengths keeps them, however thin the triangles.
        if method in ("bff", "balanced", "dirichlet") and degrees > 1e-6:
            assert measure_distortion(vertices, faces, uv).edge_rms < 1e-3


@pytest.mark.parametrize("method", METHODS)
def test_one_triangle_and_two_are_isometric_or_convex(method):
    vertices = np.array([[0.0, 0, 0], [1, 0, 0.5], [0, 1, 0], [1, 1.5, 0.2]])
    for faces in (np.array([[0, 1, 2]]), np.array([[0, 1, 2], [2, 1, 3]])):
        used = vertices[: faces.max() + 1]
        uv = lay(used, faces, method)
        if method not in ("tutte", "harmonic"):  # those put the border on a circle
            assert measure_distortion(used, faces, uv).edge_rms < 1e-6


def ring(n: int, rows: int, height: float) -> tuple[np.ndarray, np.ndarray]:
    """An open tube of radius 1, n vertices round and `rows` along its height."""
    angle = 2 * np.pi * np.arange(n) / n
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    vertices = np.concatenate(
        [np.column_stack([circle, np.full(n, z)]) for z in np.linspace(0, height, rows)]
    )
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(n), indexing="ij")
    a, b = (n * i + j).ravel(), (n * i + (j + 1) % n).ravel()
    return vertices, np.concatenate(
        [np.column_stack([a, b, a + n]), np.column_stack([b, b + n, a + n])]
    )


def torus(n: int = 24, k: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """Radii 1 and 0.35."""
    u, v = (2 * np.pi * np.arange(m) / m for m in (n, k))
    u, v = (grid.ravel() for grid in np.meshgrid(u, v, indexing="ij"))
    around = 1 + 0.35 * np.cos(v)
    vertices = np.column_stack([around * np.cos(u), around * np.sin(u), 0.35 * np.sin(v)])
    i, j = np.meshgrid(np.arange(n), np.arange(k), indexing="ij")
    a, b = (i * k + j).ravel(), ((i + 1) % n * k + j).ravel()
    c, d = ((i + 1) % n * k + (j + 1) % k).ravel(), (i * k + (j + 1) % k).ravel()
    return vertices, np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])


def lay_open(vertices, faces, method):
    """Cut open as `flatten` does, then flat, finite and free of flips; the cut length."""
    cut = open_surface(vertices, faces, hole_share=0.35)
    points = vertices[cut.origin]
    uv = lay(points, cut.faces, method)
    return measure_distortion(points, cut.faces, uv), cut.seam_length


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("height", [0.01, 1.0, 628.0])
def test_tubes_as_long_as_a_hundred_rounds_unroll(method, height):
    vertices, faces = ring(24, 30 if height > 100 else 6, height)
    distortion, seam = lay_open(vertices, faces, method)
    assert seam == pytest.approx(height, rel=1e-3)
    if method not in ("tutte", "harmonic"):
        # A prism is developable: each method lays it flat without strain.
        assert distortion.edge_rms < 1e-6


@pytest.mark.filterwarnings("ignore::skinmap.errors.SkinWarning")
@pytest.mark.parametrize("method", METHODS)
def test_closed_surfaces_are_cut_and_laid_flat(method, sphere):
    for vertices, faces in (sphere, torus()):
        distortion, seam = lay_open(vertices, faces, method)
        assert seam > 0
        assert distortion.flips == 0


@pytest.mark.parametrize("method", METHODS)
def test_flat_annulus_with_a_wide_hole_is_cut(method):
    vertices, faces = ring(24, 4, 1.0)
    flat = vertices.copy()
    flat[:, :2] *= 1.0 + vertices[:, 2:]
    flat[:, 2] = 0.0
    distortion, _ = lay_open(flat, faces, method)
    if method not in ("tutte", "harmonic"):
        assert distortion.edge_rms < 1e-6  # flat already


@pytest.mark.filterwarnings("ignore::skinmap.errors.SkinWarning")
@pytest.mark.parametrize("method", METHODS)
def test_a_ball_with_a_pinhole_is_laid_flat(method, sphere):
    vertices, faces = sphere
    lay(vertices, faces[1:], method)


def test_unreferenced_vertices_are_named():
    vertices, faces = dome()
    with pytest.raises(InvalidMeshError, match="vertex 81 belongs to no face"):
        flatten_disc(np.concatenate([vertices, [[0.5, 0.5, 9.0]]]), faces)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_vertices_that_are_not_finite_are_named(value):
    vertices, faces = dome()
    vertices[3, 2] = value
    with pytest.raises(SkinError, match="NaN or infinity, first in row 3"):
        flatten_disc(vertices, faces)


def test_no_face_at_all_is_named():
    with pytest.raises(SkinError, match="no faces"):
        flatten_disc(np.zeros((3, 3)), np.zeros((0, 3), np.int64))


@pytest.mark.parametrize("method", METHODS)
def test_a_mesh_numbered_by_subdivision_takes_no_longer(method):
    """SuperLU's own order took 20 s for this one and its like, which the limit of CI would show."""
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=4)
    faces = np.asarray(ball.faces)
    faces = faces[(np.asarray(ball.vertices)[faces][:, :, 2] > 0).all(axis=1)]
    used, compact = np.unique(faces, return_inverse=True)
    lay(np.asarray(ball.vertices)[used], compact.reshape(-1, 3), method)
