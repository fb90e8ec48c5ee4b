"""Iterations and precision of flat maps."""

from __future__ import annotations

import numpy as np
import pytest

from skinmap.errors import InvalidArrayError, UnknownNameError
from skinmap.flat.disc_map import map_disc
from skinmap.flat.distortion import edge_rms, measure_distortion
from skinmap.flat.methods import ITERATED, SINGLE_PRECISION, SLIM_ITERATIONS


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


@pytest.mark.parametrize("method", SINGLE_PRECISION)
def test_single_precision_is_as_near_as_its_digits(saddle, method):
    double = map_disc(*saddle, method=method)
    single = map_disc(*saddle, method=method, precision="float32")
    assert single.method == method
    # The factor of a Laplacian of 144 vertices has a condition number of about 1e3: of the seven
    # digits of float32 at least three are left.
    np.testing.assert_allclose(single.uv, double.uv, atol=1e-3 * np.ptp(double.uv))
    one, other = (edge_rms(*saddle, flat.uv) for flat in (single, double))
    assert one == pytest.approx(other, rel=1e-2)
    if method not in ("dirichlet",):  # whose descent ends in the same place, digit by digit or not
        assert (single.uv != double.uv).any()


@pytest.mark.parametrize(
    ("effort", "kind", "message"),
    [
        ({"iterations": 3}, InvalidArrayError, "iterations need one of the methods arap"),
        ({"iterations": 0, "method": "arap"}, InvalidArrayError, "1 or more, got 0"),
        ({"precision": "float16"}, UnknownNameError, "did you mean 'float64'"),
        ({"precision": "float32", "method": "slim"}, InvalidArrayError, "got 'slim'"),
    ],
)
def test_nonsense_is_refused(saddle, effort, kind, message):
    with pytest.raises(kind, match=message):
        map_disc(*saddle, **{"method": "fast", **effort})


def test_every_iterated_method_exists(saddle):
    for method in ITERATED:
        assert map_disc(*saddle, method=method, iterations=2).method == method
