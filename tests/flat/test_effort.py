"""Iterations of flat maps."""

from __future__ import annotations

import numpy as np
import pytest

from skinmap.errors import InvalidArrayError
from skinmap.flat.distortion import measure_distortion
from skinmap.flat.methods import ITERATED, SLIM_ITERATIONS, map_disc


@pytest.fixture(scope="module")
def saddle(square_grid):
    vertices, faces = square_grid(12)
    bent = vertices.copy()
    bent[:, 2] = 0.8 * (vertices[:, 0] - 0.5) * (vertices[:, 1] - 0.4)
    return bent, faces


@pytest.mark.parametrize(
    ("method", "own"), [("balanced", 5), ("slim", SLIM_ITERATIONS), ("dirichlet", 200)]
)
def test_a_method_with_its_own_number_of_iterations_is_itself(saddle, method, own):
    default, given = (
        map_disc(*saddle, method=method),
        map_disc(*saddle, method=method, iterations=own),
    )
    np.testing.assert_array_equal(given.uv, default.uv)
    assert given.method == method


def test_more_iterations_of_the_descent_never_raise_its_energy(saddle):
    energy = []
    for iterations in (1, 3, 200):
        flat = map_disc(*saddle, method="dirichlet", iterations=iterations)
        one = measure_distortion(*saddle, flat.uv)
        energy.append(np.average(one.symmetric_dirichlet, weights=one.face_areas))
    # The energy is measured at the best size of the map, which the descent looks for as well:
    # rounding aside, each step may only lower it.
    assert energy[0] >= energy[1] - 1e-6 >= energy[2] - 2e-6


@pytest.mark.parametrize(
    ("effort", "kind", "message"),
    [
        ({"iterations": 3}, InvalidArrayError, "iterations need one of the methods arap"),
        ({"iterations": 0, "method": "arap"}, InvalidArrayError, "1 or more, got 0"),
    ],
)
def test_nonsense_is_refused(saddle, effort, kind, message):
    with pytest.raises(kind, match=message):
        map_disc(*saddle, **{"method": "fast", **effort})


def test_every_iterated_method_exists(saddle):
    for method in ITERATED:
        assert map_disc(*saddle, method=method, iterations=2).method == method
