import numpy as np
from numpy.testing import assert_allclose

from skinmap.geometry.topology import border_edges
from viewer.drawing.touches.touch_marks import outline


def perimeter(ends):
    return np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).sum()


def is_closed(ends):
    """Each end of a segment meets an even number of ends."""
    _, count = np.unique(np.round(ends.reshape(-1, ends.shape[2]), 9), axis=0, return_counts=True)
    return bool((count % 2 == 0).all())


def test_outline_of_a_cone_is_its_circle(square_grid):
    vertices, faces = square_grid(41)
    values = 1.0 - np.linalg.norm(vertices[:, :2] - 0.503, axis=1)
    ends = outline(faces, border_edges(faces), values, 0.7).points(vertices)
    assert_allclose(np.linalg.norm(ends[..., :2] - 0.503, axis=-1), 0.3, rtol=0, atol=2e-3)
    # Inscribed polygon with sides of at most a cell's diagonal: short by less than 0.5 %.
    assert_allclose(perimeter(ends), 2 * np.pi * 0.3, rtol=5e-3)
    assert is_closed(ends)


def test_outline_closes_along_the_border(square_grid):
    vertices, faces = square_grid(11)
    ends = outline(faces, border_edges(faces), vertices[:, 0], 0.55).points(vertices)
    # The strip right of x = 0.55: 0.45 wide and 1 high; linear values, so nothing is lost.
    assert_allclose(perimeter(ends), 2 * (0.45 + 1.0), rtol=0, atol=1e-12)
    assert is_closed(ends)


def test_outline_of_everything_is_the_border_and_of_nothing_is_empty(square_grid):
    vertices, faces = square_grid(5)
    border = border_edges(faces)
    everything = outline(faces, border, np.ones(25), 0.5).points(vertices)
    assert_allclose(perimeter(everything), 4.0, rtol=0, atol=1e-12)
    assert len(outline(faces, border, np.zeros(25), 0.5).share) == 0


def test_outline_serves_other_coordinates_of_the_same_vertices(square_grid):
    vertices, faces = square_grid(9)
    line = outline(faces, border_edges(faces), vertices[:, 0], 0.3)
    assert_allclose(2.0 * line.points(vertices), line.points(2.0 * vertices), rtol=0, atol=1e-12)
