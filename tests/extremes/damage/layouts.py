"""Targets that say where taxels are: tables, drawings, robots, bodies, meshes."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from calibration.commands.batch import read_batch
from calibration.commands.calibration_options import PatchFiles
from calibration.commands.patch_task import PatchTask, load_link
from calibration.files.tables import (
    read_anchor_table,
    read_board,
    read_numbers,
    read_placed,
    read_points,
    read_touches,
)
from skinmap.geometry.triangles import TriangleMesh
from skinmap.io.flat_maps.drawing import read_drawing
from skinmap.io.flat_maps.seam_files import read_cuts, write_obj_with_uv
from skinmap.io.flat_maps.sources import read_tactile_maps
from skinmap.io.robots.manifest import data_folder, load_robot
from skinmap.io.robots.mesh_file import read_mesh, write_mesh
from skinmap.io.robots.urdf import UrdfBody
from skinmap.io.taxels.cyskin import (
    CySkin,
    TactileMap,
    file_faults,
    read_cyskin,
    read_cyskin_taxels,
    write_cyskin,
)
from skinmap.io.taxels.icub import read_icub, write_icub
from skinmap.io.taxels.tactile_urdf import (
    read_tactile_sensors,
    read_tactile_urdf,
    write_tactile_urdf,
)
from skinmap.io.taxels.taxel_table import COLUMNS, COVARIANCE, read_csv, read_skinware, read_taxels
from skinmap.skin.modules import module_layout
from skinmap.skin.taxels import TaxelTable
from skinmap.surface.surface_mesh import SurfaceMesh, build_surface

from .target import Target

HAND = data_folder() / "icub" / "taxels" / "left_hand.csv"
URDF = b"""<?xml version="1.0"?>
<robot name="one">
  <link name="base"><visual><origin xyz="0 0 0.1" rpy="0 0 1"/>
    <geometry><mesh filename="hand.ply" scale="0.001 0.001 0.001"/></geometry></visual></link>
  <link name="tip"><visual><geometry><mesh filename="hand.ply"/></geometry></visual></link>
  <link name="end"/>
  <joint name="turn" type="revolute"><parent link="base"/><child link="tip"/>
    <origin xyz="0 0 0.2" rpy="0 0.5 0"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="follow" type="revolute"><parent link="tip"/><child link="end"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="2" effort="1" velocity="1"/>
    <mimic joint="turn" multiplier="2" offset="0.1"/></joint>
</robot>
"""
PLY = b"""ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element face 4
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
0 0 1
3 0 2 1
3 0 1 3
3 1 2 3
3 0 3 2
"""
MANIFEST = b"""[robot]
name = "one"
urdf = "one.urdf"
[robot.pose_deg]
turn = 20
[[part]]
name = "hand"
link = "tip"
taxels = "left_hand.csv"
units = "m"
format = "csv"
cover_mm = 3
ring = true
[part.pose]
xyz_mm = [1, 2, 3.5]
rpy_deg = [0, 90, 10]
[[part]]
name = "two"
link = "tip"
cover = "hand.ply"
[[part.piece]]
taxels = "left_hand.csv"
ids = "hand.ids"
[[part.piece]]
taxels = "left_hand.csv"
ids = "hand.ids"
pose = { xyz_mm = [0, 0, 100] }
"""
BOARD = "channel,x,y\n" + "".join(f"{row},{row}.5,{row % 3}\n" for row in range(12))
ANCHORS = "channel,x,y,z,sigma\n" + "".join(f"{row},{row}.5,0,1e-3,0.1\n" for row in range(12))
TOUCHES = "touch,x,y,z,channel,value,sigma\n0,1,2,3,0,40,1\n0,1,2,3,1,30,1\n1,2,2,3,4,10,1\n"
POINTS = "x,y,z\n1,2,3\n4,5,6.5\n-1,0,1e-3\n"
DRAWING = b"""[SENSORS]
triangle_10pad 0 20.0 30.0 0 1 1 0
triangle_10pad 1 52.0 30.0 180 1 1 0
[TAXELS]
"""
LAYOUT = b"slots_mm = [[0, 0], [1.5, 2], [3, 4], [5, 0]]\nthermal = [1]\ncentre = 0\nside_mm = 30\n"
LAYOUT_CSV = b"slot,x_mm,y_mm,thermal\n0,0,0,0\n1,1.5,2,1\n2,3,4,0\n3,5,0,0\n"
BATCH = b"name,layout,mesh,anchors,units,mirror\n" + b"".join(
    b"%c,board.csv,m.ply,a.csv,mm,no\n" % letter for letter in b"abc"
)
MESHES = ("ply", "stl", "obj", "off", "glb", "dae")


@cache
def table() -> TaxelTable:
    return read_csv(HAND)


def written(write: Callable[[Path], object]) -> bytes:
    """What a writer of ours writes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "t"
        write(path)
        return path.read_bytes()


def skinware() -> bytes:
    """The hand as Skinware's cache: nanometres, one line a taxel."""
    one = table()
    rows = [
        " ".join(str(round(1e9 * float(value))) for value in (*position, *normal))
        for position, normal in zip(one.positions, one.normals, strict=True)
    ]
    lines = [f"0 {uid} {row} 1750000 3" for uid, row in zip(one.channels, rows, strict=True)]
    return ("\n".join([str(len(lines)), *lines]) + "\n").encode()


def cyskin() -> bytes:
    """The hand as a CySkin file with a map of it."""
    one = table()
    rows = np.arange(len(one))
    faces = np.stack([rows[:-2], rows[1:-1], rows[2:]], axis=1)
    maps = (TactileMap("hand_isomap", "isomap", one.channels, one.positions[:, :2], faces),)
    skin = CySkin("hand", one.channels + 16, one.positions, one.normals, faces, maps)
    return written(lambda path: write_cyskin(skin, path))


def walk_cyskin(path: Path) -> None:
    """Read a CySkin file in each of the ways, and look for its faults."""
    file_faults(read_cyskin(path), path.name)
    read_cyskin_taxels(path)
    read_tactile_maps([path])


def tactile() -> bytes:
    return written(lambda path: write_tactile_urdf({"palm": table()}, path))


def calibrated() -> bytes:
    """A table with covariances."""
    one, spread = table(), "1e-6,2e-6,1e-6,0,1e-8,0"
    rows = [
        f"{channel},0,{','.join(repr(float(value)) for value in (*place, *normal))},{spread}"
        for channel, place, normal in zip(one.channels, one.positions, one.normals, strict=True)
    ]
    return "\n".join([",".join((*COLUMNS, *COVARIANCE)), *rows, ""]).encode()


def mesh(kind: str) -> bytes:
    """A tetrahedron in one of the formats that are read."""
    import trimesh

    whole = trimesh.load_mesh(io.BytesIO(PLY), file_type="ply")
    content = whole.export(file_type=kind)
    return content.encode() if isinstance(content, str) else bytes(content)


def read_ply() -> tuple[np.ndarray, np.ndarray]:
    """The tetrahedron."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "t.ply"
        path.write_bytes(PLY)
        return read_mesh(path)


def walk_body(path: Path) -> object:
    """Read a body, pose it and read all its meshes."""
    body = UrdfBody(path)
    poses = body.poses(dict.fromkeys(body.joints, 0.5))
    return body.joints, poses, [body.mesh(link) for link in body.links]


def walk_robot(path: Path) -> object:
    """Read a manifest, its body and the tables of its parts."""
    robot = load_robot(path)
    return robot.name, robot.pose, {name: robot.part(name).read() for name in robot.parts}


def covariances(path: Path) -> object:
    from viewer.inputs import read_covariances

    return read_covariances([f"left_hand={path}"], _icub(), ["left_hand"])


def flat_map() -> bytes:
    """A mesh with texture coordinates, as `flatten` writes it."""
    places, faces = np.eye(3), np.array([[0, 1, 2]])
    return written(lambda path: write_obj_with_uv(path, places, faces, places[:, :2], faces))


@cache
def _icub() -> object:
    return load_robot("icub")


@cache
def hand_mesh() -> SurfaceMesh:
    return build_surface(load_robot("kaspar").skin("left_hand"))


def cuts(path: Path) -> object:
    return read_cuts(path, {"left_hand": hand_mesh()})


def by_board(read: Callable[..., object]) -> Callable[[Path], object]:
    return lambda path: read(path, read_board(path.with_name("board.csv")))


def own(path: Path) -> TaxelTable:
    """By its suffix, as a manifest would name it."""
    return read_taxels(path)


ROBOT = {
    "one.urdf": lambda: URDF,
    "hand.ply": lambda: PLY,
    "left_hand.csv": HAND.read_bytes,
    "hand.ids": lambda: b"\n".join(b"%d" % k for k in range(16, 64)),
}
ON_BOARD = {"board.csv": BOARD.encode}
CAL = "calibration.files.tables"

TARGETS = [
    Target("taxels-csv", "t.csv", lambda: [HAND.read_bytes(), calibrated()], own,
           ("skinmap.io.taxels.taxel_table.read_csv",
            "skinmap.io.taxels.taxel_table.read_taxels")),
    Target("taxels-icub", "t.txt", lambda: [written(lambda p: write_icub(table(), p, name="h"))],
           read_icub, ("skinmap.io.taxels.icub.read_icub",)),
    Target("taxels-cyskin", "t.json", lambda: [cyskin()], walk_cyskin,
           ("skinmap.io.taxels.cyskin.read_cyskin", "skinmap.io.taxels.cyskin.read_cyskin_taxels",
            "skinmap.io.flat_maps.sources.read_tactile_maps")),
    Target("taxels-skinware", "t", lambda: [skinware()], read_skinware,
           ("skinmap.io.taxels.taxel_table.read_skinware",)),
    Target("taxels-urdf", "t.urdf", lambda: [tactile()], read_tactile_urdf,
           ("skinmap.io.taxels.tactile_urdf.read_tactile_urdf",)),
    Target("sensors-urdf", "t.urdf", lambda: [tactile()], read_tactile_sensors,
           ("skinmap.io.taxels.tactile_urdf.read_tactile_sensors", "skinmap.io.safe_xml.read_xml")),
    Target("covariances", "t.csv", lambda: [calibrated()], covariances,
           ("viewer.inputs.read_covariances",)),
    Target("drawing", "d.ini", lambda: [DRAWING], read_drawing,
           ("skinmap.io.flat_maps.drawing.read_drawing",)),
    Target("seam", "s.txt", lambda: [b"0 9 40\n5,60 # back\n"], cuts,
           ("skinmap.io.flat_maps.seam_files.read_cuts",)),
    Target("module-layout", "m.toml", lambda: [LAYOUT], lambda p: module_layout(str(p))),
    Target("module-layout-csv", "m.csv", lambda: [LAYOUT_CSV], lambda p: module_layout(str(p))),
    Target("manifest", "one.toml", lambda: [MANIFEST], walk_robot,
           ("skinmap.io.robots.manifest.load_robot",
            "skinmap.io.robots.manifest.read_manifest"), ROBOT),
    Target("urdf", "damaged.urdf", lambda: [URDF], walk_body,
           ("skinmap.io.robots.urdf.read_urdf", "skinmap.io.robots.urdf.read_joints",
            "skinmap.io.robots.urdf.read_links"), ROBOT),
    Target("mesh-written", "m.ply",
           lambda: [written(lambda p: write_mesh(TriangleMesh(*read_ply()), p))], read_mesh),
    Target("flat-map", "m.obj", lambda: [flat_map()], read_mesh),
    *(Target(f"mesh-{kind}", f"m.{kind}", lambda kind=kind: [mesh(kind)], read_mesh,
             ("skinmap.io.robots.mesh_file.read_mesh",)) for kind in MESHES),
    Target("link", "m.stl", lambda: [mesh("stl")], lambda p: load_link(p, 1e-3),
           ("calibration.commands.patch_task.load_link",)),
    Target("board", "board.csv", lambda: [BOARD.encode()], read_board, (f"{CAL}.read_board",)),
    Target("placed", "p.csv", lambda: [ANCHORS.encode()], read_placed, (f"{CAL}.read_placed",)),
    Target("anchors", "a.csv", lambda: [ANCHORS.encode()], by_board(read_anchor_table),
           (f"{CAL}.read_anchor_table", f"{CAL}.read_table", f"{CAL}.read_cells"), ON_BOARD),
    Target("wrap", "a.csv", lambda: [ANCHORS.encode()],
           lambda p: PatchTask.load(PatchFiles(layout=p.with_name("board.csv"), units="mm",
                                               mesh=p.with_name("hand.ply"), anchors=p)),
           (), ON_BOARD | {"hand.ply": lambda: PLY}),
    Target("touches", "t.csv", lambda: [TOUCHES.encode()], by_board(read_touches),
           (f"{CAL}.read_touches",), ON_BOARD),
    Target("points", "p.csv", lambda: [POINTS.encode()], read_points, (f"{CAL}.read_points",)),
    Target("batch", "b.csv", lambda: [BATCH], read_batch,
           ("calibration.commands.batch.read_batch",)),
    Target("numbers", "n.csv", lambda: [b"1,2,3\n4,5,6\n"], lambda p: read_numbers(p, None),
           (f"{CAL}.read_numbers",)),
]  # fmt: skip
