"""Scans of half a link of the iCub with noise and stray points, registered from afar."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from benchmarks.calibration.patches import Case
from calibration import register_scan
from calibration.patch.link_surface import OFFSET, make_target
from skinmap.arrays import FloatArray
from skinmap.geometry.proximity import closest_on_mesh

POINTS, NOISE, STRAY = 4000, 0.7e-3, 0.1
TURN, SHIFT = np.radians(15.0), 15e-3


def scan_rows(cases: list[Case], runs: int) -> list[dict[str, Any]]:
    """Registrations of scans of several links, and of a bare cylinder."""
    links = list({len(case.vertices): case for case in cases}.values())
    errors, seconds, statuses = [], [], []
    for run in range(runs):
        case = links[run % len(links)]
        rng = np.random.default_rng([run, 6])
        scan = _half(case.vertices, case.faces, rng)
        T = _away(scan, rng)
        start = time.process_time()
        found = register_scan(scan @ T[:3, :3].T + T[:3, 3], case.vertices, case.faces, rng=rng)
        seconds.append(time.process_time() - start)
        back = found.T_mesh_scan @ T
        errors.append(np.linalg.norm(scan @ back[:3, :3].T + back[:3, 3] - scan, axis=1).mean())
        statuses.append(str(found.status))
    tube = trimesh.creation.cylinder(radius=45e-3, height=0.2, sections=64)
    rng = np.random.default_rng(6)
    angle, height = rng.uniform(0, np.pi, POINTS), rng.uniform(-0.05, 0.05, POINTS)
    points = np.column_stack([45e-3 * np.cos(angle), 45e-3 * np.sin(angle), height])
    points += rng.normal(0, NOISE, points.shape)
    bare = register_scan(points, tube.vertices, tube.faces, rng=rng)
    return [
        {
            "what": "half a link, 0.7 mm noise, 10 % stray, from 15 degrees / 15 mm (simulated)",
            "runs": runs,
            "links": len(links),
            "median_mm": 1e3 * float(np.median(errors)),
            "max_mm": 1e3 * float(np.max(errors)),
            "below_1_mm": float(np.mean(np.array(errors) < 1e-3)),
            "statuses": {name: statuses.count(name) for name in sorted(set(statuses))},
            "seconds": float(np.mean(seconds)),
        },
        {
            "what": "bare cylinder (simulated)",
            "status": str(bare.status),
            "free_directions": list(bare.free_directions),
        },
    ]


def _half(vertices: FloatArray, faces: Any, rng: np.random.Generator) -> FloatArray:
    """The outer surface of a link as seen from one side."""
    # Visual meshes have inner sheets that no scanner sees: the wrap's surface less its offset.
    target = make_target(vertices, faces)
    mesh = trimesh.Trimesh(target.vertices, target.faces, process=False)
    points, face = trimesh.sample.sample_surface(mesh, 4 * POINTS, seed=int(rng.integers(2**30)))
    normals = mesh.face_normals[face]
    points = np.asarray(points - OFFSET * normals)
    distance, _, _ = closest_on_mesh(points, vertices, faces)
    # Where the wrap spans an opening there is nothing to scan.
    seen = np.flatnonzero((normals @ rng.normal(size=3) > 0) & (distance < 1e-3))[:POINTS]
    scan = points[seen]
    scan = scan + rng.normal(0.0, NOISE, scan.shape)
    stray = rng.random(len(scan)) < STRAY
    low, high = scan.min(axis=0) - 0.02, scan.max(axis=0) + 0.02
    scan[stray] = rng.uniform(low, high, (int(stray.sum()), 3))
    return scan


def _away(scan: FloatArray, rng: np.random.Generator) -> FloatArray:
    way, side = (vector / np.linalg.norm(vector) for vector in rng.normal(size=(2, 3)))
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(TURN * way).as_matrix()
    middle = scan.mean(axis=0)
    T[:3, 3] = middle - T[:3, :3] @ middle + SHIFT * side
    return T
