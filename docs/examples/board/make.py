"""Make the files of this folder: a board on a bent horn, and evidence of where it is.

    python docs/examples/board/make.py [FOLDER]

The truth is a formula (`benchmarks/calibration/links.py`), so what a calibration
finds can be compared with `truth.csv`. All evidence is simulated: anchors, touches and pairs have
errors of 1 mm in each coordinate, the scan of 0.7 mm. The files are the same with every run.
"""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[2]))

from scipy.spatial.transform import Rotation  # noqa: E402

from benchmarks.calibration import links  # noqa: E402
from benchmarks.calibration.links import Case, far_apart, simulate_touches  # noqa: E402
from skinmap.arrays import FloatArray, IntArray  # noqa: E402
from skinmap.geometry.triangles import face_normals  # noqa: E402

NOISE = 1e-3  # of a coordinate of an anchor, a touch or a pair [m]
SCAN = 0.7e-3  # of a coordinate of a point of the scan [m]
HEIGHT = 0.5e-3  # of the taxels above the mesh [m]
ANCHORS, TOUCHES, PRESSES, POINTS = 6, 24, 60, 2500
WRONG = 12e-3  # how far the misplaced anchor is off [m]
BOARD = links.Link(
    "bent horn",
    partial(links.tube, 0.3, taper=0.08),
    links.whole(35e-3),
    (-0.11, 0.11),
    "open",
    4,
    4,
    True,
)


def main(folder: Path) -> None:
    """Write all files."""
    folder.mkdir(parents=True, exist_ok=True)
    case = board_case()
    channels = 12 * case.modules + np.arange(len(case.layout)) % 10  # as on 12-channel modules
    board_files(folder, case, channels)
    rng = np.random.default_rng(15)
    anchor_files(folder, case, channels, rng)
    touch_file(folder, case, channels, rng)
    scan_files(folder, case, channels, rng)
    wrench_file(folder, case, rng)
    response_files(folder, rng)


def board_case() -> Case:
    """Sixteen rigid modules of ten taxels on a tube of 35 mm that widens, bent with 300 mm."""
    vertices, faces = links.link_mesh(BOARD, np.random.default_rng(0))
    vertices, first = np.unique(vertices.round(9), axis=0, return_inverse=True)  # closes the seam
    layout, truth, modules = links.rigid_board(BOARD, HEIGHT)
    return Case("bent horn", layout, truth, modules, vertices, first.ravel()[faces])


def board_files(folder: Path, case: Case, channels: IntArray) -> None:
    """The drawing from either side, the link, the truth, and a table for `calibrate batch`."""
    for name, side in (("board.csv", 1.0), ("board_back.csv", -1.0)):
        rows = np.column_stack([channels, case.modules, case.layout * [side, 1.0]])
        table(folder / name, "channel,module,x,y", rows, 2)
    table(folder / "truth.csv", "channel,x,y,z", np.column_stack([channels, case.truth]), 1)
    stl(folder / "link.stl", case.vertices, case.faces)
    (folder / "patches.csv").write_text(
        "name,layout,mesh,anchors,mirror\n"
        "front,board.csv,link.stl,anchors.csv,no\n"
        "back,board_back.csv,link.stl,anchors.csv,yes\n"
    )


def anchor_files(folder: Path, case: Case, channels: IntArray, rng: np.random.Generator) -> None:
    """Six anchors, and the same with one that is misplaced along the tube."""
    taxels = far_apart(case.layout, ANCHORS, rng)
    points = case.truth[taxels] + rng.normal(0.0, NOISE, (ANCHORS, 3))
    head = "channel,x,y,z"
    table(folder / "anchors.csv", head, np.column_stack([channels[taxels], points]), 1)
    points[2, 2] += WRONG
    table(folder / "anchors_wrong.csv", head, np.column_stack([channels[taxels], points]), 1)


def touch_file(folder: Path, case: Case, channels: IntArray, rng: np.random.Generator) -> None:
    """Touches with a probe, a row for each channel that felt one."""
    rows = [
        [number, *touch.point, channels[taxel], value]
        for number, touch in enumerate(simulate_touches(case, TOUCHES, rng, noise=NOISE))
        for taxel, value in zip(touch.channels, touch.values, strict=True)
    ]
    table(folder / "touches.csv", "touch,x,y,z,channel,value", np.array(rows), 1, whole=(0, 4))


def scan_files(folder: Path, case: Case, channels: IntArray, rng: np.random.Generator) -> None:
    """The side of the tube that carries the board, turned and moved; pairs, and taxels seen."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("xyz", [8.0, -12.0, 15.0], degrees=True).as_matrix()
    pose[:3, 3] = [12e-3, -8e-3, 15e-3]

    def seen(points: FloatArray, noise: float) -> FloatArray:
        """Points of the mesh's frame in that of the scan."""
        return (points - pose[:3, 3]) @ pose[:3, :3] + rng.normal(0.0, noise, points.shape)

    corners = case.vertices[case.faces]
    side = face_normals(case.vertices, case.faces)[:, 0] > 0.2
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    share = np.where(side, area, 0.0)
    chosen = rng.choice(len(corners), POINTS, p=share / share.sum())
    points = np.einsum("kc,kcd->kd", rng.dirichlet([1.0] * 3, POINTS), corners[chosen])
    table(folder / "scan.csv", "x,y,z", seen(points, SCAN), 0, digits=5)
    marks = points[[0, 500, 1000, 1500]]
    pairs = np.column_stack([seen(marks, NOISE), marks])
    table(folder / "pairs.csv", "x,y,z,mesh_x,mesh_y,mesh_z", pairs, 0)
    rows = np.column_stack([channels, seen(case.truth, SCAN)])
    table(folder / "scan_taxels.csv", "channel,x,y,z", rows, 1)


def wrench_file(folder: Path, case: Case, rng: np.random.Generator) -> None:
    """Presses of the board as one rigid patch, felt by a force/torque sensor behind a joint."""
    mount = np.eye(4)
    mount[:3, :3] = Rotation.from_euler("zyx", [40.0, 10.0, -25.0], degrees=True).as_matrix()
    mount[:3, 3] = [0.05, -0.02, 0.08]
    frames = np.tile(np.eye(4), (PRESSES, 1, 1))
    turns = np.radians(rng.uniform(-80.0, 80.0, (PRESSES, 1))) * [0.0, 0.0, 1.0]
    frames[:, :3, :3] = Rotation.from_rotvec(turns).as_matrix()
    pressed = case.truth[rng.integers(len(case.truth), size=PRESSES)]
    axis = np.column_stack([np.zeros((PRESSES, 2)), pressed[:, 2]])
    push = axis - pressed + rng.normal(0.0, 8e-3, pressed.shape)
    push *= (rng.uniform(2.0, 10.0, PRESSES) / np.linalg.norm(push, axis=1))[:, None]
    T = frames @ mount
    forces = np.einsum("mij,mj->mi", T[:, :3, :3], push)
    places = np.einsum("mij,mj->mi", T[:, :3, :3], pressed) + T[:, :3, 3]
    moments = np.cross(places, forces) + rng.normal(0.0, 5e-3, forces.shape)
    np.savez_compressed(
        folder / "wrench.npz",
        points=pressed + rng.normal(0.0, 2e-3, pressed.shape), frames=frames, forces=forces,
        moments=moments, taxels=case.truth,
    )  # fmt: skip


def response_files(folder: Path, rng: np.random.Generator) -> None:
    """Ten seconds at rest of twenty channels, one of them stuck, and pushes under known loads."""
    rest = 20.0 + rng.normal(0.0, 1.2, (500, 20))
    rest[:, 7] = 33.0
    np.save(folder / "rest.npy", rest.round().astype(np.uint8))
    ramp = np.concatenate([np.linspace(0.0, 10.0, 100), np.linspace(10.0, 0.0, 100)])
    loads = np.tile(np.tile(ramp, 2)[:, None], (1, 20))
    gain = np.exp(rng.normal(0.0, 0.25, 20))
    samples = 20.0 + 12.0 * gain * loads + rng.normal(0.0, 0.5, loads.shape)
    samples[:, 7] = 33.0
    np.savez_compressed(
        folder / "loads.npz", samples=samples.round().clip(0, 255).astype(np.uint8),
        loads=loads.astype(np.float32),
    )  # fmt: skip


def table(
    path: Path,
    head: str,
    rows: FloatArray,
    names: int,
    *,
    whole: tuple[int, ...] = (),
    digits: int = 6,
) -> None:
    """A CSV whose first columns, and some others, are whole numbers; lengths to a micrometre."""
    integers = {*range(names), *whole}
    lines = [
        ",".join(
            str(int(value)) if column in integers else f"{value:.{digits}f}"
            for column, value in enumerate(row)
        )
        for row in rows
    ]
    path.write_text("\n".join([head, *lines]) + "\n")


def stl(path: Path, vertices: FloatArray, faces: IntArray) -> None:
    """A binary STL file [m]."""
    import trimesh

    trimesh.Trimesh(vertices, faces, process=False).export(path)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE)
