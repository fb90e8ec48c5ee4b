from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from skinmap.errors import SkinWarning
from skinmap.flat.flat_map import flatten, flatten_disc
from skinmap.flat.mesh_charts import flatten_mesh
from skinmap.flat.seams import divided_touches, open_surface, split_along, touch_counts
from skinmap.geometry.topology import boundary_loops, check_surface, euler_number
from skinmap.geometry.triangles import face_areas
from skinmap.skin.skin import skin_from_points
from skinmap.surface.surface_mesh import build_surface, surface_from_faces

SHARE = 0.35


def tube(around: int, along: int, radius: float, length: float):
    """Vertices and faces of an open tube."""
    i, j = np.meshgrid(np.arange(around), np.arange(along))
    angle = 2 * np.pi * i.ravel() / around
    height = length * j.ravel() / (along - 1)
    vertices = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])
    p = (np.arange(along - 1)[:, None] * around + np.arange(around)).ravel()
    q = (np.arange(along - 1)[:, None] * around + (np.arange(around) + 1) % around).ravel()
    lower = np.column_stack([p, q, p + around])
    upper = np.column_stack([q, q + around, p + around])
    return vertices, np.concatenate([lower, upper])


def check_opened(vertices, faces, cut):
    check_surface(cut.faces)
    assert euler_number(cut.faces) == 1
    assert len(boundary_loops(cut.faces)) == 1
    np.testing.assert_array_equal(cut.origin[cut.faces], faces)
    moved = vertices[cut.origin]
    np.testing.assert_array_equal(face_areas(moved, cut.faces), face_areas(vertices, faces))


def test_a_disc_is_left_alone(square_grid):
    vertices, faces = square_grid(5)
    cut = open_surface(vertices, faces, hole_share=SHARE)
    np.testing.assert_array_equal(cut.faces, faces)
    assert cut.seam_length == 0.0


def test_a_tube_is_cut_along_its_shortest_seam():
    vertices, faces = tube(24, 20, 1.0, 5.0)
    cut = open_surface(vertices, faces, hole_share=SHARE)
    check_opened(vertices, faces, cut)
    assert cut.seam_length == pytest.approx(5.0)
    assert len(cut.origin) == len(vertices) + 20


@pytest.mark.parametrize("ratio", [0.1, 0.33, 0.36])
def test_a_tapered_sleeve_lies_flat_along_a_seam_however_narrow_its_rim(ratio):
    """A frustum can be developed exactly; a flat hole in it is as good filled as not."""
    vertices, faces = tube(36, 16, 1.0, 2.0)
    vertices[:, :2] *= 1.0 - (1.0 - ratio) * vertices[:, 2:] / 2.0
    middle = 8 * 36 + 6
    mesh = surface_from_faces(
        skin_from_points(vertices, vertices * [1, 1, 0] + [0, 0, 1e-9]),
        faces[(faces != middle).all(axis=1)],
    )
    with pytest.warns(SkinWarning, match=f"1 taxels are in no triangle: channels {middle}"):
        (chart,) = flatten(mesh).charts
    assert chart.distortion.edge_rms < 0.01
    assert (chart.holes, chart.seam_length) == (1, pytest.approx(np.hypot(2.0, 1.0 - ratio)))


def test_a_closed_skin_is_slit(sphere):
    vertices, faces = sphere
    cut = open_surface(vertices, faces, hole_share=SHARE)
    check_opened(vertices, faces, cut)
    assert cut.seam_length == pytest.approx(np.pi, rel=0.1)  # half round the unit sphere


def test_a_closed_skin_is_slit_where_fewest_vertices_are(sphere):
    vertices, faces = sphere
    # The poles stay; vertices are drawn together towards +x, so -x is thinly covered.
    angle = np.arctan2(vertices[:, 1], vertices[:, 0])
    radius = np.hypot(vertices[:, 0], vertices[:, 1])
    angle = angle - 0.75 * np.sin(angle)
    squeezed = np.column_stack(
        [radius * np.cos(angle), radius * np.sin(angle), 1.5 * vertices[:, 2]]
    )
    cut = open_surface(squeezed, faces, hole_share=SHARE)
    check_opened(squeezed, faces, cut)
    slit = np.flatnonzero(np.bincount(cut.origin) > 1)
    around = np.abs(vertices[slit][:, 2]) < 0.8  # near the poles all sides are one
    assert around.any()
    # Half of the surface that holds a quarter of the vertices.
    assert (np.cos(angle[slit][around]) < 0.5).all()


def test_the_seam_is_the_shortest_of_all(rng):
    vertices, faces = tube(14, 10, 1.0, 4.0)
    vertices = vertices + rng.normal(scale=0.06, size=vertices.shape)
    cut = open_surface(vertices, faces, hole_share=SHARE)
    pairs = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    length = np.full((len(vertices),) * 2, np.inf)
    reach = np.linalg.norm(vertices[pairs[:, 0]] - vertices[pairs[:, 1]], axis=1)
    length[pairs[:, 0], pairs[:, 1]] = length[pairs[:, 1], pairs[:, 0]] = reach
    for k in range(len(vertices)):  # Floyd and Warshall: all ways between all vertices
        length = np.minimum(length, length[:, k : k + 1] + length[k : k + 1])
    assert cut.seam_length == pytest.approx(length[:14, -14:].min())


def test_small_holes_are_filled_for_the_solve_and_open_in_the_map(square_grid):
    vertices, faces = square_grid(11)
    vertices = vertices + [0, 0, 1] * (0.2 * np.sin(3 * vertices[:, :1]) * vertices[:, 1:2])
    hole = (np.abs(vertices[faces].mean(axis=1)[:, :2] - 0.5) < 0.1).all(axis=1)
    uv, _, holes = flatten_disc(vertices, faces)
    assert holes == 0
    used, compact = np.unique(faces[~hole], return_inverse=True)
    open_uv, _, holes = flatten_disc(vertices[used], compact.reshape(-1, 3))
    assert holes == 1
    assert len(boundary_loops(compact.reshape(-1, 3))) == 2
    # The fill holds the hole's place: edges are as long as on the whole sheet, within 1 %.
    one, other = uv[faces[~hole]], open_uv[compact.reshape(-1, 3)]
    ratio = np.linalg.norm(other[:, 0] - other[:, 1], axis=1) / np.linalg.norm(
        one[:, 0] - one[:, 1], axis=1
    )
    np.testing.assert_allclose(ratio, 1.0, atol=0.01)


@pytest.mark.parametrize("bend", [0.0, 1.5])
@pytest.mark.parametrize("periodic", [False, True])
def test_a_plate_with_a_wide_hole_lies_flat_uncut(square_grid, bend, periodic):
    vertices, faces = square_grid(13)
    faces = faces[(np.abs(vertices[faces][:, :, :2] - 0.5) > 0.26).any(axis=(1, 2))]
    angle = bend * vertices[:, 0]
    if bend:
        vertices = np.column_stack([np.sin(angle), bend * vertices[:, 1], np.cos(angle)]) / bend
    (chart,) = flatten_mesh(vertices, faces, periodic=periodic).charts
    assert (chart.seam_length, chart.holes, chart.periodic) == (0.0, 1, False)
    assert len(np.unique(chart.taxels)) == len(chart.taxels)
    assert chart.distortion.flips == 0
    assert chart.distortion.edge_rms < 1e-3


def test_doubled_vertices_share_taxel_and_value():
    vertices, _ = tube(24, 12, 0.04, 0.1)
    mesh = build_surface(skin_from_points(vertices, vertices * [1, 1, 0] / 0.04))
    (chart,) = flatten(mesh).charts
    taxels, count = np.unique(chart.taxels, return_counts=True)
    assert (count == 2).sum() == 12
    for taxel in taxels[count == 2]:
        one, other = np.flatnonzero(chart.taxels == taxel)
        np.testing.assert_array_equal(mesh.vertices[chart.taxels[one]], vertices[taxel])
        assert np.linalg.norm(chart.uv[one] - chart.uv[other]) > 0.2  # across the map: 2 pi 0.04


def test_flatten_keeps_seams_away_from_taxels():
    vertices, _ = tube(24, 12, 0.04, 0.1)
    mesh = build_surface(skin_from_points(vertices, vertices * [1, 1, 0] / 0.04))
    (chart,) = flatten(mesh).charts
    on_seam = np.flatnonzero(np.bincount(chart.taxels) > 1)
    (other,) = flatten(mesh, avoid=on_seam).charts
    assert not np.isin(np.flatnonzero(np.bincount(other.taxels) > 1), on_seam).any()


def test_a_torus_is_opened():
    mesh = trimesh.creation.torus(1.0, 0.3, major_sections=24, minor_sections=12)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int64)
    check_opened(vertices, faces, open_surface(vertices, faces, hole_share=SHARE))


def torus(*holes, reach=0.2):
    """A torus of radii 1 and 0.35 m, faces near some points left out."""
    mesh = trimesh.creation.torus(1.0, 0.35, major_sections=48, minor_sections=24)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int64)
    middle = vertices[faces].mean(axis=1)
    for hole in holes:
        keep = np.linalg.norm(middle - hole, axis=1) > reach
        faces, middle = faces[keep], middle[keep]
    used, compact = np.unique(faces, return_inverse=True)
    return vertices[used], compact.reshape(-1, 3)


TOP, OUTSIDE, BEHIND = (-1.0, 0, 0.35), (1.35, 0, 0), (-1.35, 0, 0)


@pytest.mark.parametrize("holes", [(OUTSIDE,), (OUTSIDE, TOP), (OUTSIDE, TOP, (0, -1, 0.35))])
def test_a_torus_with_holes_is_laid_flat(holes):
    vertices, faces = torus(*holes)
    assert len(boundary_loops(faces)) == len(holes)
    check_opened(vertices, faces, open_surface(vertices, faces, hole_share=SHARE))
    (chart,) = flatten_mesh(vertices, faces).charts
    assert (chart.distortion.flips, chart.fallback) == (0, False)


def test_a_handle_between_wide_holes_is_opened():
    vertices, faces = torus(OUTSIDE, BEHIND, reach=0.5)
    check_opened(vertices, faces, open_surface(vertices, faces, hole_share=SHARE))


def test_components_with_handles_are_laid_flat_one_by_one():
    one, other = torus(OUTSIDE), torus(OUTSIDE, TOP)
    both = np.concatenate([one[0], other[0] + [3.0, 0, 0]])
    pieces = flatten_mesh(both, np.concatenate([one[1], other[1] + len(one[0])]))
    assert len(pieces.charts) == 2
    assert pieces.flips == 0


def test_a_torus_is_cut_along_its_shortest_loops():
    vertices, faces = torus()
    cut = open_surface(vertices, faces, hole_share=SHARE)
    check_opened(vertices, faces, cut)
    # Round the tube, and round the axis where the root lies: not longer than on the outside.
    assert 2 * np.pi * (0.35 + 0.65) * 0.95 < cut.seam_length < 2 * np.pi * (0.35 + 1.35)


def test_a_seam_keeps_away_from_chosen_vertices():
    vertices, faces = tube(24, 20, 1.0, 5.0)
    first = open_surface(vertices, faces, hole_share=SHARE)
    on_seam = np.flatnonzero(np.bincount(first.origin) > 1)
    other = open_surface(vertices, faces, hole_share=SHARE, avoid=on_seam)
    assert not set(np.flatnonzero(np.bincount(other.origin) > 1)) & set(on_seam)


def test_split_along_opens_inner_edges_only(square_grid):
    vertices, faces = square_grid(4)
    _, origin = split_along(faces, np.array([[5, 6]]))
    # One inner edge: its ends hold the mesh together, so nothing comes apart.
    assert len(origin) == len(vertices)
    _, origin = split_along(faces, np.array([[5, 6], [6, 7]]))
    assert len(origin) == len(vertices) + 2  # 7 lies on the border: 6 and 7 are doubled


def test_a_tube_of_taxels_flattens_to_its_unrolled_length():
    vertices, _ = tube(24, 12, 0.04, 0.1)
    normals = vertices * [1, 1, 0] / 0.04
    (chart,) = flatten(build_surface(skin_from_points(vertices, normals))).charts
    # Uncut, a tube cannot be flattened; cut, what is left are its facets (cut measured: 0.5 %).
    assert chart.distortion.flips == 0
    assert chart.distortion.edge_rms < 0.006
    assert chart.seam_length == pytest.approx(0.1, rel=0.01)
    width = np.sort(np.ptp(chart.uv, axis=0))
    np.testing.assert_allclose(width, sorted([0.1, 2 * np.pi * 0.04]), rtol=0.02)
    doubled = np.flatnonzero(np.bincount(chart.taxels) > 1)
    assert len(doubled) == 12


@pytest.mark.parametrize("ratio", [10, 100])
def test_long_tubes_flatten(ratio):
    vertices, faces = tube(12, 12 * ratio // 3, 1.0, 2.0 * ratio)
    cut = open_surface(vertices, faces, hole_share=SHARE)
    uv, method, _ = flatten_disc(vertices[cut.origin], cut.faces)
    assert method == "balanced"
    assert np.isfinite(uv).all()


def test_a_closed_skin_flattens_without_flips(sphere):
    vertices, _ = sphere
    flat = flatten(build_surface(skin_from_points(0.1 * vertices, vertices)))
    assert flat.flips == 0
    assert np.isfinite(flat.uv).all()


def presses(vertices, places, rng, count, reach):
    """Round touches near habitual places, their taxels within a reach [m]."""
    tree = cKDTree(vertices)
    middles = places[rng.integers(0, len(places), count)] + rng.normal(0, reach / 2, (count, 3))
    return [
        np.array(found) for found in tree.query_ball_point(vertices[tree.query(middles)[1]], reach)
    ]


@pytest.mark.parametrize("closed", [False, True])
def test_a_seam_that_knows_touches_divides_fewer_others(closed, sphere, rng):
    vertices, faces = sphere if closed else tube(24, 20, 1.0, 5.0)
    ratios, reach = [], 0.6 if closed else 0.9
    for _ in range(12):
        # Three places on one half: where a limb is touched by habit.
        half = np.flatnonzero(vertices @ rng.normal(size=3) > 0)
        places = vertices[rng.choice(half, 3)]
        known, others = (presses(vertices, places, rng, 100, reach) for _ in range(2))
        plain = open_surface(vertices, faces, hole_share=SHARE)
        counts = touch_counts(known, len(vertices))
        wise = open_surface(vertices, faces, hole_share=SHARE, touched=counts)
        check_opened(vertices, faces, wise)
        ratios.append([divided_touches(cut.faces, cut.origin, others) for cut in (plain, wise)])
    plain, wise = np.sum(ratios, axis=0)
    assert plain > 40
    assert wise <= 0.65 * plain


def test_touches_spread_evenly_leave_a_tube_its_shortest_seam():
    vertices, faces = tube(24, 20, 1.0, 5.0)
    cut = open_surface(vertices, faces, hole_share=SHARE, touched=np.ones(len(vertices)))
    assert cut.seam_length == pytest.approx(5.0)


def test_a_touch_is_divided_where_both_sides_of_the_seam_have_some_of_it():
    vertices, faces = tube(24, 20, 1.0, 5.0)
    cut = open_surface(vertices, faces, hole_share=SHARE)
    seam = np.flatnonzero(np.bincount(cut.origin) > 1)
    row = seam[9] // 24 * 24
    around = row + (seam[9] % 24 + np.arange(-3, 4)) % 24
    assert divided_touches(cut.faces, cut.origin, [around]) == 1
    assert divided_touches(cut.faces, cut.origin, [around[3:]]) == 0  # its rim is on the seam
    assert divided_touches(cut.faces, cut.origin, [around[4:]]) == 0


def sampled(solid, count):
    """A skin of irregular taxels all over a solid, with gaps of several sizes."""
    points, own = trimesh.sample.sample_surface_even(solid, count, seed=1)
    return skin_from_points(np.asarray(points), solid.face_normals[own])


@pytest.mark.parametrize("name", ["sphere", "torus", "plate", "cone", "box"])
@pytest.mark.filterwarnings("ignore::skinmap.errors.SkinWarning")
def test_irregular_skins_all_over_a_solid_lie_flat_without_flips(name):
    made = trimesh.creation
    solid, count = {
        "sphere": (made.icosphere(4, 0.06), 400),
        "torus": (made.torus(0.06, 0.02), 500),
        "plate": (made.box([0.1, 0.004, 0.1]), 600),  # holes that touch, handles through the plate
        "cone": (made.cone(0.05, 0.1, sections=80), 300),
        "box": (made.box([0.08, 0.06, 0.05]), 500),
    }[name]
    mesh = build_surface(sampled(solid, count))
    for more in ({}, {"max_distortion": 4.5}):
        flat = flatten(mesh, **more)
        assert sum(chart.distortion.flips for chart in flat.charts) == 0
        assert {t for chart in flat.charts for t in chart.taxels} == set(np.unique(mesh.faces))


def test_a_finger_that_is_stretched_is_warned_of_and_slits_mend_it():
    mesh = build_surface(sampled(trimesh.creation.capsule(0.04, 0.008, count=[40, 40]), 180))
    with pytest.warns(SkinWarning, match="is stretched by .* a max-distortion of 4.5 slits it"):
        stretched = flatten(mesh)
    slit = flatten(mesh, max_distortion=4.5)
    assert stretched.charts[0].distortion.edge_rms > 0.5
    assert slit.charts[0].distortion.edge_rms < 0.25
