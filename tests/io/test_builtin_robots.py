"""The two papers' robots: what ships is what the generators make, and what the papers count."""

from __future__ import annotations

import hashlib
import importlib.util
import re

import igl
import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

import skinmap
from skinmap.geometry.rigid import transform_points
from skinmap.io.robots.manifest import builtin_robots, data_folder
from skinmap.io.taxels.taxel_table import read_csv
from skinmap.skin.modules import fit_modules
from skinmap.surface.surface_mesh import build_surface

FOLDERS = {"kaspar": "kaspar", "baxter-forearm": "baxter_forearm"}
ROBOTS = list(FOLDERS)


@pytest.fixture(scope="module", params=ROBOTS)
def name(request) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def robot(name):
    return skinmap.load_robot(name)


@pytest.fixture(scope="module")
def generator(name):
    path = data_folder() / FOLDERS[name] / "generate.py"
    spec = importlib.util.spec_from_file_location(f"generate_{FOLDERS[name]}", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_builtin_robots_are_named_by_their_manifests():
    assert builtin_robots() == ("baxter-forearm", "icub", "kaspar", "ur10e-cyskin")


def test_generator_makes_the_tables_that_ship(robot, name, generator):
    made = generator.tables()
    assert set(made) == set(robot.parts)
    for part, table in made.items():
        shipped = read_csv(data_folder() / FOLDERS[name] / "taxels" / f"{part}.csv")
        np.testing.assert_array_equal(table.channels, shipped.channels)
        np.testing.assert_array_equal(table.modules, shipped.modules)
        # Rounded to a nanometre: a sine's last bit may tip one, and that is all.
        np.testing.assert_allclose(table.positions, shipped.positions, rtol=0, atol=1.01e-9)
        np.testing.assert_allclose(table.normals, shipped.normals, rtol=0, atol=1.01e-9)


def test_generator_makes_the_meshes_that_ship(name, generator):
    for link, mesh in generator.meshes().items():
        path = data_folder() / FOLDERS[name] / "meshes" / f"{link}.ply"
        shipped = trimesh.load_mesh(str(path), process=False)
        np.testing.assert_array_equal(shipped.faces, mesh.faces)
        # Single precision of coordinates below 0.3 m.
        np.testing.assert_allclose(shipped.vertices, mesh.vertices, rtol=0, atol=2e-8)


def test_bodies_are_closed_and_turned_outward(robot):
    for link in robot.body.visible_links:
        mesh = robot.mesh(link)
        solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
        assert solid.is_watertight, link
        assert solid.is_winding_consistent, link
        assert solid.volume > 0, link
        assert len(trimesh.graph.split(solid)) == 1, link


def test_counts_are_those_of_the_papers(robot, name):
    skins = [robot.skin(part) for part in robot.parts]
    taxels, modules = (1128, 94) if name == "kaspar" else (768, 70)
    assert sum(len(skin) for skin in skins) == taxels
    assert sum(len(np.unique(skin.modules)) for skin in skins) == modules


def test_boards_are_rigid_flat_and_of_the_layout(robot):
    for part in robot.parts:
        spec, report = robot.part(part), robot.repair(part)
        poses = fit_modules(report.table, spec.layout)
        assert len(poses) == len(np.unique(report.table.modules))
        # Nanometres of rounding, and nothing else, between the table and a flat board.
        assert max(pose.residual for pose in poses.values()) < 1e-9
        for module, pose in poses.items():
            rows = report.table.modules == module
            normals = report.table.normals[rows]
            np.testing.assert_allclose(normals @ pose.T_link_module[:3, 2], 1.0, atol=1e-6)


def test_boards_do_not_cut_each_other(robot):
    for part in robot.parts:
        spec, table = robot.part(part), robot.repair(part).table
        side = spec.layout.side * (1.0 - 1e-6)  # boards that share an edge touch
        corner = np.array([[-0.5, -0.5 / 3**0.5, 0], [0.5, -0.5 / 3**0.5, 0], [0, 1 / 3**0.5, 0]])
        boards = np.array(
            [
                transform_points(pose.T_link_module, side * corner)
                for pose in fit_modules(table, spec.layout).values()
            ]
        )
        for a, b in cKDTree(boards.mean(axis=1)).query_pairs(1.2 * side):
            assert separated(boards[a], boards[b]), (part, a, b)


def separated(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether an axis keeps two triangles apart (the separating axis theorem)."""
    edges = [np.roll(triangle, -1, axis=0) - triangle for triangle in (one, other)]
    normals = [np.cross(e[0], e[1]) for e in edges]
    axes = [np.cross(a, b) for a in edges[0] for b in edges[1]]
    axes += [np.cross(n, a) for n, e in zip(normals, edges, strict=True) for a in e] + normals
    for axis in axes:
        length = np.linalg.norm(axis)
        if length > 1e-9 * np.abs(edges[0]).max() ** 2:
            p, q = one @ axis, other @ axis
            if max(p.min(), q.min()) - min(p.max(), q.max()) > 1e-10 * length:
                return True
    return False


def test_separated_tells_cutting_triangles():
    flat = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    assert separated(flat, flat + [0, 0, 0.1])
    assert not separated(flat, flat + [0.2, 0.2, 0])
    assert not separated(flat, np.array([[0.2, 0.2, -1], [0.2, 0.2, 1], [0.9, 0.9, 1]]))


def test_taxels_lie_on_the_body_and_look_outward(robot):
    for part in robot.parts:
        skin, mesh = robot.skin(part), robot.mesh(robot.part(part).link)
        solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
        distance = trimesh.proximity.signed_distance(solid, skin.positions)  # inside positive
        # Boards are tangent at their centres and the body is convex: none lies under the cover,
        # but for facets (0.2 mm under the smooth one) and the cover's own thickness at corners.
        assert distance.max() < 0.6e-3, part
        assert distance.min() > -2.6e-3, part
        stored = robot.repair(part).table.normals
        assert np.einsum("ij,ij->i", skin.normals, stored).min() > 0.7, part
        _, face, _ = igl.point_mesh_squared_distance(skin.positions, mesh.vertices, mesh.faces)
        assert np.einsum("ij,ij->i", solid.face_normals[face], stored).min() > 0.8, part


def test_pitch_is_the_papers(robot, name):
    for part in robot.parts:
        skin = robot.skin(part)
        nearest = []
        for module in np.unique(skin.modules):
            points = skin.positions[skin.modules == module]
            nearest.append(cKDTree(points).query(points, k=2)[0][:, 1])
        pitch = 5e-3 if name == "kaspar" else 8e-3
        # The 11-pad layout is nominal: to 1 %. The 12-pad pitch is exact.
        assert np.median(np.concatenate(nearest)) == pytest.approx(pitch, rel=0.01)


def test_all_taxels_are_in_one_sheet_per_part(robot):
    for part in robot.parts:
        mesh = build_surface(robot.skin(part))
        assert (mesh.taxel_patches == 0).all(), part


def test_left_parts_mirror_right_ones():
    robot = skinmap.load_robot("kaspar")
    for part in ("arm", "hand", "foot", "cheek"):
        right = robot.repair(f"right_{part}").table.positions
        left = robot.repair(f"left_{part}").table.positions * [1, -1, 1]
        assert cKDTree(left).query(right)[0].max() < 2e-9  # both rounded to a nanometre


def test_forearm_is_uneven():
    skin = skinmap.load_robot("baxter-forearm").skin("forearm")
    centres = np.array([skin.positions[skin.modules == m].mean(axis=0) for m in range(70)])
    gap = cKDTree(centres).query(centres, k=2)[0][:, 1]
    assert gap.max() > 1.15 * gap.min()


def test_readme_lists_the_hashes_of_all_files(name):
    folder = data_folder() / FOLDERS[name]
    listed = dict(
        re.findall(r"\| `([^`]+)` \|.*\| `([0-9a-f]{64})` \|", (folder / "README.md").read_text())
    )
    files = [*folder.glob("taxels/*.csv"), *folder.glob("meshes/*.ply")]
    assert listed == {
        str(file.relative_to(folder)): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in files
    }
