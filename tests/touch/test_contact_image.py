from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import Delaunay

from skinmap.errors import InvalidArrayError, SkinMismatchError
from skinmap.flat.flat_map import FlatMap, flatten
from skinmap.geometry.topology import boundary_loops
from skinmap.geometry.triangles import signed_areas
from skinmap.skin.skin import skin_from_points
from skinmap.surface.surface_mesh import SurfaceMesh, build_surface
from skinmap.touch.images import contact_image
from skinmap.touch.images.contact_image import ContactImageGeometry, image_geometry

# Three products and two sums in single precision, of values up to 1.
SINGLE = 4 * np.finfo(np.float32).eps
SHAPES = ({}, {"pitch": 3e-3}, {"shape": (66, 100)}, {"shape": (100, None)}, {"shape": (None, 40)})


@pytest.fixture(scope="module")
def flat(prepared) -> FlatMap:
    """Two patches, no seam."""
    return prepared("right_forearm").flat


@pytest.fixture(scope="module")
def tube() -> FlatMap:
    """A closed tube of 16 x 9 taxels, 10 mm apart: its flat map has a seam."""
    angle = np.arange(16) * 2 * np.pi / 16
    ring = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    height = 10e-3 * np.array([0.0, 0.0, 1.0])
    radius = 10e-3 * 16 / (2 * np.pi)
    points = np.concatenate([radius * ring + step * height for step in range(9)])
    return flatten(build_surface(skin_from_points(points, np.tile(ring, (9, 1)))))


def centres(geometry: ContactImageGeometry) -> np.ndarray:
    """(rows * columns, 2) flat-map coordinates of the pixels' centres."""
    row, column = np.divmod(np.arange(geometry.mask.size), geometry.shape[1])
    return geometry.corner + geometry.pitch * np.column_stack([column + 0.5, -row - 0.5])


@pytest.mark.parametrize("grid", SHAPES)
def test_matrix_reproduces_linear_fields(flat, grid):
    geometry = image_geometry(flat, **grid)
    field = np.array([1.0, 20.0, -30.0])
    at_taxels = field[0] + flat.uv @ field[1:]
    inside = geometry.mask.ravel()
    # A centre on an edge may be moved by 1e-9 of a triangle, so the field by 30 * 3e-2 * 1e-9.
    np.testing.assert_allclose(
        (geometry.matrix @ at_taxels)[inside],
        (field[0] + centres(geometry) @ field[1:])[inside],
        rtol=0,
        atol=1e-9,
    )
    assert (geometry.matrix @ np.ones(len(geometry)))[~inside].max(initial=0.0) == 0.0


@pytest.mark.parametrize("grid", SHAPES)
def test_mask_and_coverage_agree_with_the_triangles(flat, grid):
    geometry = image_geometry(flat, **grid)
    skin = sum(signed_areas(chart.uv, chart.faces).sum() for chart in flat.charts)
    assert geometry.coverage.sum() * geometry.pitch**2 == pytest.approx(skin, rel=1e-12)
    assert (geometry.coverage[geometry.mask] > 0).all()
    assert geometry.mask[geometry.coverage > 1 - 1e-12].all()
    # The mask errs by at most the pixels that the border runs through.
    cut = ((geometry.coverage > 1e-12) & (geometry.coverage < 1 - 1e-12)).sum()
    assert abs(geometry.mask.sum() - geometry.coverage.sum()) <= cut


def test_mask_is_what_the_borders_go_round(flat):
    # Another way to the same: the angle under which the borders are seen from a pixel. Gaps
    # between patches lie inside the convex hull, which a new Delaunay triangulation would fill.
    geometry = image_geometry(flat, pitch=3e-3)
    seen = np.zeros(geometry.mask.size)
    for chart in flat.charts:
        for loop in boundary_loops(chart.faces):
            arms = chart.uv[loop][None] - centres(geometry)[:, None]
            ahead = np.roll(arms, -1, axis=1)
            cross = arms[..., 0] * ahead[..., 1] - arms[..., 1] * ahead[..., 0]
            seen += np.arctan2(cross, (arms * ahead).sum(axis=2)).sum(axis=1)
    np.testing.assert_array_equal(geometry.mask.ravel(), np.abs(seen) > np.pi)
    hull = Delaunay(flat.uv).find_simplex(centres(geometry)) >= 0
    assert (hull & ~geometry.mask.ravel()).sum() > 100


def test_grids_have_the_size_that_was_asked_for(flat):
    width, height = np.ptp(np.concatenate([chart.uv for chart in flat.charts]), axis=0)
    plain = image_geometry(flat)
    assert plain.pitch == 8e-3
    assert plain.shape == (np.ceil(height / 8e-3), np.ceil(width / 8e-3))
    tall = image_geometry(flat, shape=(100, None))
    assert tall.pitch == pytest.approx(height / 100)
    assert tall.shape == (100, np.ceil(width / tall.pitch))
    assert image_geometry(flat, shape=(512, 512)).shape == (512, 512)


def test_seam_vertices_share_their_taxel(tube):
    (chart,) = tube.charts
    doubled = np.flatnonzero(np.bincount(chart.taxels) == 2)
    assert len(doubled) == 9
    geometry = image_geometry(tube, pitch=2e-3)
    constant = geometry.matrix @ np.ones(len(geometry))
    np.testing.assert_allclose(constant[geometry.mask.ravel()], 1.0, atol=1e-14)
    # Pressed, one of them shows at both places of the map, 16 taxels apart.
    pressures = np.zeros(len(geometry))
    pressures[doubled[4]] = 1.0
    lit = centres(geometry)[geometry.image(pressures).ravel() > 0]
    for place in chart.uv[chart.taxels == doubled[4]]:
        assert np.linalg.norm(lit - place, axis=1).min() < 2e-3
    assert np.ptp(lit[:, 0]) > 0.14


def test_renumbered_taxels_give_the_same_image(flat, rng):
    mesh, n = flat.mesh, len(flat.mesh.skin)
    new = rng.permutation(n)
    old = np.argsort(new)
    skin = skin_from_points(mesh.skin.positions[old], mesh.skin.normals[old])
    moved = SurfaceMesh(skin, new[mesh.faces], new[mesh.representative][old], mesh.face_patches)
    charts = tuple(replace(chart, taxels=new[chart.taxels]) for chart in flat.charts)
    renumbered = image_geometry(FlatMap(moved, charts, flat.uv[old]))
    pressures = rng.random(n)
    np.testing.assert_allclose(  # but for the order in which three products are added
        renumbered.matrix @ pressures[old],
        image_geometry(flat).matrix @ pressures,
        rtol=0,
        atol=4e-16,
    )


def test_taxels_at_one_place_share_it(rng):
    points = np.column_stack([*np.divmod(np.arange(30.0), 6), np.zeros(30)]) * 8e-3
    twins = np.concatenate([points, points[[14]]])
    geometry = image_geometry(
        flatten(build_surface(skin_from_points(twins, np.tile([0.0, 0, 1], (31, 1)))))
    )
    pressures = rng.random(31)
    shared = pressures.copy()
    shared[[14, 30]] = pressures[[14, 30]].mean()
    for image in (geometry.image, lambda values: geometry.images(values[None])[0]):
        np.testing.assert_allclose(image(pressures), image(shared), atol=SINGLE)
    swapped = pressures.copy()
    swapped[[14, 30]] = pressures[[30, 14]]
    np.testing.assert_allclose(geometry.image(swapped), geometry.image(pressures), atol=SINGLE)


@pytest.mark.parametrize("dtype", [np.uint8, np.float32, np.float64])
@pytest.mark.parametrize("compiled", [True, False])
def test_single_and_batch_agree_with_the_matrix(flat, rng, monkeypatch, dtype, compiled):
    if not compiled:
        monkeypatch.setattr(contact_image, "compiled_gathers", lambda: None)
    geometry = image_geometry(flat, shape=(40, 30))
    samples = (255 * rng.random((70, len(geometry)))).astype(dtype)
    exact = (samples.astype(np.float64) @ geometry.matrix.T).reshape(-1, 40, 30)
    images = geometry.images(samples)
    assert images.dtype == np.float32
    np.testing.assert_allclose(images, exact, rtol=0, atol=255 * SINGLE)
    assert (images[:, ~geometry.mask] == 0).all()
    for number in (0, 69):
        np.testing.assert_allclose(
            geometry.image(samples[number]), images[number], rtol=0, atol=255 * SINGLE
        )


def test_unusable_pressures_are_refused(flat):
    geometry = image_geometry(flat)
    n = len(geometry)
    for call, shape in ((geometry.image, (n,)), (geometry.images, (3, n))):
        with pytest.raises(SkinMismatchError, match=rf"{n}.*, one a taxel, got"):
            call(np.zeros(n + 1))
        with pytest.raises(InvalidArrayError, match="must be numbers"):
            call(np.full(shape, "a"))
        for bad in (np.nan, np.inf, -np.inf, 1e300):
            samples = np.zeros(shape)
            samples[..., 5] = bad
            with pytest.raises(InvalidArrayError, match="for taxel 5"):
                call(samples)
    assert geometry.images(np.zeros((0, n))).shape == (0, *geometry.shape)


def test_unusable_grids_are_refused(flat):
    for grid in ({"pitch": 0.0}, {"pitch": -1.0}, {"pitch": np.nan}, {"pitch": np.inf}):
        with pytest.raises(InvalidArrayError, match="pitch must be above 0 m"):
            image_geometry(flat, **grid)
    for grid in ({"shape": (0, 5)}, {"shape": (4, 4), "pitch": 8e-3}):
        with pytest.raises(InvalidArrayError, match="a pitch or a shape"):
            image_geometry(flat, **grid)
    with pytest.raises(InvalidArrayError, match="choose a wider pitch"):
        image_geometry(flat, pitch=1e-6)
