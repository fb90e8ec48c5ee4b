"""Scans registered to meshes: planted poses, symmetric shapes, bad input."""

from __future__ import annotations

import re

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from calibration import Status, register_scan
from skinmap.errors import InvalidArrayError

pytest.importorskip("open3d", reason="scans are registered by Open3D (extra `scan`)")


@pytest.fixture(scope="module")
def bracket():
    """A link without symmetry: a box with a smaller one on a corner."""
    base = trimesh.creation.box((0.06, 0.09, 0.14))
    knob = trimesh.creation.box((0.04, 0.05, 0.05))
    knob.apply_translation([0.04, 0.03, 0.05])
    return trimesh.util.concatenate([base, knob])


def seen(mesh, rng, *, noise=0.7e-3, wrong=0.1, count=2500, way=(0.8, 0.5, 0.3)):
    """Half of a mesh as a scanner sees it, with noise and stray points."""
    points, face = trimesh.sample.sample_surface(mesh, 8 * count, seed=7)
    outside = ~mesh.ray.intersects_any(
        points[: 4 * count] + 1e-5 * np.array(way), np.tile(way, (4 * count, 1))
    )
    facing = mesh.face_normals[face[: 4 * count]] @ np.array(way) > 0
    points = np.asarray(points[: 4 * count][outside & facing][:count])
    points = points + rng.normal(0, noise, points.shape)
    stray = rng.random(len(points)) < wrong
    points[stray] = rng.uniform(points.min(axis=0), points.max(axis=0), (int(stray.sum()), 3))
    return points


def pose(degrees, shift, rng):
    way, side = rng.normal(size=(2, 3))
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(np.radians(degrees) * way / np.linalg.norm(way)).as_matrix()
    T[:3, 3] = shift * side / np.linalg.norm(side)
    return T


def moved(T, points):
    return points @ T[:3, :3].T + T[:3, 3]


def test_scan_is_found_from_15_degrees_and_15_mm(bracket, rng):
    scan = seen(bracket, rng)
    T = pose(15, 15e-3, rng)
    words = {"rng": np.random.default_rng(1)}
    found = register_scan(moved(T, scan), bracket.vertices, bracket.faces, **words)
    assert found.status is Status.OK
    back = moved(found.T_mesh_scan @ T, scan)
    # 0.7 mm of 2,500 points leave 0.03 mm; the wrapped edges of the boxes are round by 0.3 mm.
    assert np.linalg.norm(back - scan, axis=1).max() < 0.5e-3
    assert found.share > 0.8
    assert found.runner_up_cost > 1.02


def test_scan_is_found_from_anchors_far_away(bracket, rng):
    scan = seen(bracket, rng)
    T = pose(140, 0.3, rng)
    corners = np.array([[0.03, 0.045, 0.07], [0.03, -0.045, 0.07], [0.03, 0.045, -0.07]])
    there = corners + rng.normal(0, 2e-3, (3, 3))
    found = register_scan(
        moved(T, scan), bracket.vertices, bracket.faces, anchors=(moved(T, corners), there),
        rng=np.random.default_rng(1),
    )  # fmt: skip
    assert found.status is Status.OK
    assert np.linalg.norm(moved(found.T_mesh_scan @ T, scan) - scan, axis=1).max() < 0.5e-3


def test_scan_of_the_same_seed_gives_the_same_bits(bracket, rng):
    scan = seen(bracket, rng, count=800)
    one, two = (
        register_scan(scan, bracket.vertices, bracket.faces, rng=np.random.default_rng(1))
        for _ in range(2)
    )
    assert one.T_mesh_scan.tobytes() == two.T_mesh_scan.tobytes()


def test_bare_cylinder_is_unobservable_and_says_how(rng):
    tube = trimesh.creation.cylinder(radius=45e-3, height=0.2, sections=64)
    angle, height = rng.uniform(0, np.pi, 2000), rng.uniform(-0.04, 0.04, 2000)
    scan = np.column_stack([45e-3 * np.cos(angle), 45e-3 * np.sin(angle), height])
    scan += rng.normal(0, 0.7e-3, scan.shape)
    found = register_scan(scan, tube.vertices, tube.faces, rng=np.random.default_rng(1))
    assert found.status is Status.UNOBSERVABLE
    words = " ".join(found.free_directions)
    assert "slides along its long axis (0.00, 0.00, 1.00)" in words
    assert "turns about its long axis" in words


def test_box_that_looks_the_same_turned_is_ambiguous(rng):
    box = trimesh.creation.box((0.08, 0.08, 0.2))
    points, _ = trimesh.sample.sample_surface(box, 2500, seed=3)
    scan = np.asarray(points) + rng.normal(0, 0.7e-3, (2500, 3))
    found = register_scan(scan, box.vertices, box.faces, rng=np.random.default_rng(1))
    assert found.status is Status.AMBIGUOUS
    assert "another pose fits as well" in found.reasons[0]
    assert found.runner_up is not None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda p: p[:50], "at least 100 points, got 50"),
        (lambda p: np.where(p > 0.04, np.nan, p), "points holds NaN"),
        (lambda p: 1e3 * p, r"the scan in millimetres\? Multiply its lengths by 0.001"),
    ],
)
def test_register_scan_names_what_is_wrong(bracket, rng, change, message):
    with pytest.raises(InvalidArrayError, match=message):
        register_scan(change(seen(bracket, rng)), bracket.vertices, bracket.faces, rng=rng)


def test_register_scan_refuses_anchors_in_a_row(bracket, rng):
    scan = seen(bracket, rng)
    row = np.outer([0.0, 0.01, 0.03], [1.0, 0, 0])
    with pytest.raises(InvalidArrayError, match="in a row"):
        register_scan(scan, bracket.vertices, bracket.faces, anchors=(row, row), rng=rng)


def test_scan_command_writes_a_pose_and_a_report(tmp_path, bracket, rng):
    import json

    from click.testing import CliRunner

    from skinmap.cli.main import cli
    from skinmap.io.taxels.taxel_table import read_taxels

    points = 1e3 * moved(pose(10, 8e-3, rng), seen(bracket, rng, count=1500))
    rows = "\n".join(",".join(map(str, row)) for row in points.tolist())
    (tmp_path / "scan.csv").write_text(f"x,y,z\n{rows}\n")
    trimesh.Trimesh(1e3 * bracket.vertices, bracket.faces).export(tmp_path / "link.stl")
    words = ["calibrate", "scan", str(tmp_path / "scan.csv"), "--mesh"]
    words += [str(tmp_path / "link.stl"), "-o", str(tmp_path / "out"), "--json"]
    done = CliRunner().invoke(cli, [*words, "--units", "mm"])
    assert done.exit_code == 0, (done.output, done.exception)
    result = json.loads(done.stdout)
    assert result["status"] == "ok"
    assert result["files"] == ["pose.json", "report.html"]
    kept = json.loads((tmp_path / "out" / "pose.json").read_text())
    assert kept["T_mesh_scan"] == result["T_mesh_scan"]
    rows = [f"{k},{x!r},{y!r},{z!r},1" for k, (x, y, z) in enumerate(points[:9].tolist(), 1)]
    (tmp_path / "taxels.csv").write_text("channel,x,y,z,sigma\n" + "\n".join(rows) + "\n")
    seen_too = [*words, "--units", "mm", "--taxels", str(tmp_path / "taxels.csv")]
    done = CliRunner().invoke(cli, seen_too)
    files = ["pose.json", "taxels.csv", "report.html"]
    assert json.loads(done.stdout)["files"] == files
    table = read_taxels(tmp_path / "out" / "taxels.csv")
    T = np.array(kept["T_mesh_scan"])
    # The command prints six digits.
    wanted = 1e-3 * points[:9] @ T[:3, :3].T + T[:3, 3]
    np.testing.assert_allclose(table.positions, wanted, rtol=0, atol=3e-6)
    tube = trimesh.creation.cylinder(radius=45, height=200, sections=64)
    tube.export(tmp_path / "link.stl")
    angle, height = rng.uniform(0, np.pi, 800), rng.uniform(-40, 40, 800)
    rows = zip(45 * np.cos(angle), 45 * np.sin(angle), height, strict=True)
    text = "\n".join(",".join(repr(float(v)) for v in row) for row in rows)
    (tmp_path / "scan.csv").write_text(f"x,y,z\n{text}\n")
    done = CliRunner().invoke(cli, [*words, "--units", "mm"])
    assert done.exit_code == 3
    assert json.loads(done.stdout)["files"] == ["refused.html"]
    assert json.loads((tmp_path / "out" / "pose.json").read_text()) == kept


def test_covered_link_stands_off_its_mesh(bracket, rng):
    """A skin 2 mm thick all round: the pose of the whole scan is that of the bare link."""
    points, face = trimesh.sample.sample_surface(bracket, 3000, seed=7)
    scan = points + 2e-3 * bracket.face_normals[face] + rng.normal(0, 0.5e-3, points.shape)
    T = pose(10, 8e-3, rng)
    found = register_scan(moved(T, scan), bracket.vertices, bracket.faces, rng=1)
    assert found.status is Status.OK
    assert found.standoff == pytest.approx(2e-3, abs=0.2e-3)
    assert np.linalg.norm(moved(found.T_mesh_scan @ T, scan) - scan, axis=1).max() < 1e-3


def test_anchors_astray_are_named(bracket, rng):
    """Two rows exchanged, and a scan whose x has the other sign."""
    scan = seen(bracket, rng)
    corners = np.array([[3, 4.5, 7], [3, -4.5, 7], [3, 4.5, -7], [-3, 4.5, 7], [6, 5.5, 7.5]]) / 100
    image = [-1, 1, 1]
    for points, here, words in (
        (scan, corners[[1, 0, 2, 3, 4]], r"anchors 1 \(\d+ mm\), 2"),
        (scan * image, corners * image, "mirror the scan"),
    ):
        anchors = here, corners
        found = register_scan(points, bracket.vertices, bracket.faces, anchors=anchors, rng=1)
        assert found.status is Status.AMBIGUOUS
        assert re.search(words, " ".join(found.reasons)), found.reasons


def test_taxels_are_no_better_known_than_their_scan(tmp_path, bracket, rng):
    """Without the column `sigma`."""
    from click.testing import CliRunner

    from skinmap.cli.main import cli

    scan = seen(bracket, rng)
    np.savetxt(tmp_path / "scan.csv", scan, delimiter=",", header="x,y,z", comments="")
    rows = np.column_stack([np.arange(9), scan[:9]])
    head = "channel,x,y,z"
    np.savetxt(tmp_path / "t.csv", rows, fmt="%g", delimiter=",", header=head, comments="")
    bracket.export(tmp_path / "link.stl")
    words = ["scan.csv", "--mesh", "link.stl", "--taxels", "t.csv", "-o", "out"]
    words = [str(tmp_path / word) if "." in word or word == "out" else word for word in words]
    assert CliRunner().invoke(cli, ["calibrate", "scan", *words]).exit_code == 0
    table = np.genfromtxt(tmp_path / "out" / "taxels.csv", delimiter=",", names=True)
    # The scan strays by 0.7 mm.
    assert all((table[name] > 0.5e-3**2).all() for name in ("cxx", "cyy", "czz"))
