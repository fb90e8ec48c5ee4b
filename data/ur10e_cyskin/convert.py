"""Assemble the UR10e with eight CySkin patches from the files of the University of Genoa.

    python data/ur10e_cyskin/convert.py FOLDER

FOLDER holds `ur10e_link1_patch1.json` ... and `stl/`, as the README says. Writes the shapes, ids,
meshes and the URDF beside this file and prints the hashes that the README lists.
"""

from __future__ import annotations

import hashlib
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from skinmap.geometry.triangles import TriangleMesh
from skinmap.io.robots.mesh_file import read_mesh, write_mesh
from skinmap.io.taxels.cyskin import CySkin, TactileMap, read_cyskin, write_cyskin

HERE = Path(__file__).resolve().parent
FACES = 4000  # of each link's mesh
CRACK = 2e-4  # vertices of the published meshes that are nearer than this are one [m]
DIGITS = 7  # of places: 0.1 micrometres
NORMAL_DIGITS = 5
# Public kinematics of the UR10e (Denavit and Hartenberg parameters) [m].
D1, A2, A3, D4, D5, D6 = 0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655
QUARTER = np.pi / 2
# Link, mesh file, where the mesh lies in the link's frame [m], how it is turned there [deg].
LINKS: tuple[tuple[str, str, tuple[float, float, float], str, list[float]], ...] = (
    ("base_link", "base", (0, 0, 0), "Z", [180]),
    ("shoulder_link", "shoulder", (0, 0, 0), "Z", [180]),
    ("upper_arm_link", "upperarm", (0, 0, 0.1762), "YZ", [-90, -90]),
    ("forearm_link", "forearm", (0, 0, 0.0393), "YZ", [-90, -90]),
    ("wrist_1_link", "wrist1", (0, 0, -0.135), "X", [90]),
    ("wrist_2_link", "wrist2", (0, 0, -0.12), "X", [0]),
    ("wrist_3_link", "wrist3", (0, 0, -0.1168), "ZYZ", [90, 90, 90]),
)
# Joint, its origin on the link before [m, rad about fixed axes], its range [rad].
JOINTS = (
    ("shoulder_pan", (0, 0, D1), (0, 0, 0), 2 * np.pi),
    ("shoulder_lift", (0, 0, 0), (QUARTER, 0, 0), 2 * np.pi),
    ("elbow", (A2, 0, 0), (0, 0, 0), np.pi),
    ("wrist_1", (A3, 0, D4), (0, 0, 0), 2 * np.pi),
    ("wrist_2", (0, -D5, 0), (QUARTER, 0, 0), 2 * np.pi),
    ("wrist_3", (0, D6, 0), (QUARTER, np.pi, np.pi), 2 * np.pi),
)


def main(folder: Path) -> None:
    """Write everything, and print the hashes."""
    (HERE / "taxels").mkdir(exist_ok=True)
    (HERE / "meshes").mkdir(exist_ok=True)
    for link, complete in (("link1", 1), ("link2", 2)):
        files = {k: read_cyskin(folder / f"ur10e_{link}_patch{k}.json") for k in range(1, 5)}
        for number, patch in files.items():
            assert np.array_equal(patch.positions, files[complete].positions)
            lines = "\n".join(map(str, patch.ids.tolist())) + "\n"
            (HERE / "taxels" / f"{link}_patch{number}.ids").write_text(lines)
        write_cyskin(shape(files[complete], f"UR10e_{link}"), HERE / "taxels" / f"{link}.json")
    for _, name, place, axes, angles in LINKS:
        turn = Rotation.from_euler(axes, angles, degrees=True)  # capitals: about moving axes
        vertices, faces = read_mesh(folder / "stl" / f"{name}.stl")
        mesh = decimated(turn.apply(vertices) + place, faces)
        write_mesh(mesh, HERE / "meshes" / f"{name}.ply")
    (HERE / "ur10e.urdf").write_text(urdf())
    for path in sorted([*HERE.glob("taxels/*"), *HERE.glob("meshes/*")]):
        print(f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.relative_to(HERE)}")


def shape(found: CySkin, name: str) -> CySkin:
    """The skin and its isomap alone, under a true name, rounded, without the placeholder frame."""
    maps = tuple(
        TactileMap(one.name, one.kind, one.ids, np.round(one.uv, DIGITS), one.faces)
        for one in found.maps
        if one.kind == "isomap"
    )
    return replace(
        found,
        name=name,
        positions=np.round(found.positions, DIGITS),
        normals=np.round(found.normals, NORMAL_DIGITS),
        maps=maps,
        frames=(),
    )


def decimated(vertices: np.ndarray, faces: np.ndarray) -> TriangleMesh:
    """A mesh with at most `FACES` triangles, by quadric edge collapse."""
    import pymeshlab

    work = pymeshlab.MeshSet()
    work.add_mesh(pymeshlab.Mesh(vertices, faces))
    # The parts of a cover were meshed apart: cracks between them would tear open.
    work.meshing_merge_close_vertices(threshold=pymeshlab.PureValue(CRACK))
    if len(faces) > FACES:
        work.meshing_decimation_quadric_edge_collapse(
            targetfacenum=FACES, preservenormal=True, preserveboundary=True, boundaryweight=3.0
        )
    found = work.current_mesh()
    return TriangleMesh(found.vertex_matrix(), np.asarray(found.face_matrix(), np.int64))


def urdf() -> str:
    """The arm as URDF; joint k hangs link k + 1 on link k."""
    lines = [
        '<?xml version="1.0"?>',
        "<!-- Universal Robots UR10e: public kinematics, decimated visual meshes (README.md). -->",
        '<robot name="ur10e">',
    ]
    for link, name, *_ in LINKS:
        lines += [
            f'  <link name="{link}">',
            f'    <visual><geometry><mesh filename="meshes/{name}.ply"/></geometry></visual>',
            "  </link>",
        ]
    for k, (name, place, turn, most) in enumerate(JOINTS):
        lines += [
            f'  <joint name="{name}" type="revolute">',
            f'    <parent link="{LINKS[k][0]}"/>',
            f'    <child link="{LINKS[k + 1][0]}"/>',
            f'    <origin xyz="{numbers(place)}" rpy="{numbers(turn)}"/>',
            '    <axis xyz="0 0 1"/>',
            f'    <limit lower="{-most:.10g}" upper="{most:.10g}" effort="330" velocity="2.0944"/>',
            "  </joint>",
        ]
    return "\n".join([*lines, "</robot>"]) + "\n"


def numbers(values: tuple[float, ...]) -> str:
    """Numbers with blanks between."""
    return " ".join(f"{value:.12g}" for value in values)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
