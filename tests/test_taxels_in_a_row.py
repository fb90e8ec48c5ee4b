"""A skin of taxels in one row, as on a bumper: no surface, and still a skin."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner

import skinmap
from skinmap.cli.main import cli
from skinmap.errors import InvalidArrayError
from skinmap.live.response.loads import PartForces
from skinmap.skin.normals import repair_normals
from skinmap.skin.skin import skin_from_points
from skinmap.touch import measure_skin
from skinmap.touch.contacts.skin_geometry import find_contacts
from skinmap.touch.prepared_skin import PreparedSkin

ORDER = np.random.default_rng(0).permutation(20)  # rows of a table come in any order


@pytest.fixture
def row():
    points = np.outer(ORDER * 6e-3, [0.6, 0.8, 0.0])
    return skin_from_points(points, np.tile([0.0, 0.0, 1.0], (20, 1)))


def test_it_has_a_map_contacts_and_neighbours(row):
    mesh = skinmap.build_surface(row)
    assert len(mesh.faces) == 0
    uv = skinmap.flatten(mesh).uv
    apart = np.abs(uv[:, None, 0] - uv[None, :, 0])
    np.testing.assert_allclose(apart, 6e-3 * np.abs(ORDER[:, None] - ORDER), atol=1e-12)
    pressed = np.isin(ORDER, [3, 4, 5, 12, 13])
    found = find_contacts(measure_skin(mesh), 200.0 * pressed)
    assert sorted(sorted(ORDER[one.taxels].tolist()) for one in found) == [[3, 4, 5], [12, 13]]
    counts = (PreparedSkin.of(mesh).neighbourhoods().index >= 0).sum(axis=1)
    assert sorted(counts.tolist()) == [1, 1] + [2] * 18


def test_forces_of_its_contacts_are_pressures_on_the_areas_of_its_taxels(row):
    forces = PartForces(PreparedSkin.of(skinmap.build_surface(row)))
    pressed = 1e4 * np.isin(ORDER, [3, 4, 5])
    found = forces.contact(np.flatnonzero(pressed), pressed, 0.9 * pressed, 1.1 * pressed)
    assert found.force.value == pytest.approx(3e4 * forces.areas[0])
    np.testing.assert_allclose(found.normal, [0, 0, 1], atol=1e-12)


def test_its_normals_come_from_the_table_or_the_body(row):
    with pytest.raises(InvalidArrayError, match="write them in the table"):
        repair_normals(row.positions, None)


def test_commands_take_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rows = [f"{0.006 * k},0,0,0,0,1" for k in ORDER]
    (tmp_path / "bar.csv").write_text("\n".join(["x,y,z,nx,ny,nz", *rows]) + "\n")

    trimesh.creation.box([0.3, 0.02, 0.01]).apply_translation([0.05, 0, -0.006]).export("bar.stl")
    for words in (
        ["new", "bar.stl", "--taxels", "bar.csv", "--units", "m", "-o", "bar.toml"],
        ["inspect", "bar.toml"],
        ["flatten", "bar.toml", "--out", "maps"],
        ["structures", "bar.toml"],
        ["simulate", "bar.toml", "--gesture", "poke", "-o", "t.npz"],
        ["classify", "t.npz"],
        ["view", "bar.toml", "--source", "sim", "--screenshot", "v.png"],
    ):
        result = CliRunner().invoke(cli, words)
        assert result.exit_code == 0, (words, result.output, result.exception)
