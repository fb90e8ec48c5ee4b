"""Flattening methods that other distributions add, and what is asked of every method."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from skinmap import registry
from skinmap.errors import SkinWarning
from skinmap.flat.methods import flatteners, map_disc
from skinmap.geometry.topology import boundary_loops


@pytest.fixture
def plugin(monkeypatch):
    """A function: put a method under a name, as an entry point of the group would."""

    def add(name, method) -> None:
        point = SimpleNamespace(name=name, load=lambda: method)
        groups = {"skinmap.flatteners": [point]}
        monkeypatch.setattr(registry, "entry_points", lambda group: groups.get(group, []))
        monkeypatch.setattr(flatteners, "_plugins", None)

    yield add
    flatteners._plugins = None


def test_a_plugin_is_found_by_name_and_used(plugin, square_grid):
    vertices, faces = square_grid(5)
    plugin("from-above", lambda v, f, loop: v[:, :2])
    assert "from-above" in flatteners.names()
    flat = map_disc(vertices, faces, method="from-above")
    assert (flat.method, flat.fallback) == ("from-above", False)
    np.testing.assert_allclose(np.ptp(flat.uv, axis=0), 1.0, rtol=1e-12)


def broken(vertices, faces, loop):
    raise KeyError("a library's fault")


@pytest.mark.parametrize(
    "method",
    [
        broken,
        lambda v, f, loop: np.full((len(v), 2), np.nan),
        lambda v, f, loop: v,  # three columns
        lambda v, f, loop: v[:3, :2],
        lambda v, f, loop: -v[:, :2] * [-1, 1],
        lambda v, f, loop: "nothing",
    ],
)
def test_a_plugin_that_fails_is_replaced_and_named(plugin, square_grid, method):
    vertices, faces = square_grid(5)
    plugin("bad", method)
    with pytest.warns(SkinWarning, match="mesh: bad flips or fails, bff is used"):
        flat = map_disc(vertices, faces, method="bad")
    assert (flat.method, flat.fallback) == ("bff", True)


@pytest.mark.parametrize("name", flatteners.names())
def test_every_method_keeps_its_contract(name, half_cylinder):
    """What `Flattener` promises: a new (n, 2) array, the input as it was, the same each time."""
    vertices, faces = half_cylinder
    loop = boundary_loops(faces)[0]
    before = vertices.copy(), faces.copy(), loop.copy()
    one = flatteners.get(name)(vertices, faces, loop)
    other = flatteners.get(name)(vertices, faces, loop)
    assert one.shape == (len(vertices), 2)
    np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)
    for now, then in zip((vertices, faces, loop), before, strict=True):
        assert (now == then).all()
