"""Recordings of a real robot, where they are at hand, with its chains from rows and from a URDF."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks import ROOT
from calibration.files.part_files import load_part_touches
from calibration.files.self_touch_files import SelfTouchData
from calibration.mount.robot_chains import robot_chain
from skinmap.arrays import FloatArray
from skinmap.io.robots.urdf import UrdfBody
from skinmap.skin.robot import Robot

NAO = Path(os.environ.get("SKINMAP_NAO", ROOT.parent / "shared" / "data" / "nao"))
PROBES = ROOT / "benchmarks" / "calibration" / "nao_probes.toml"
BASE, TURNS = "base", "continuous"


def real_data(paths: list[Path]) -> SelfTouchData:
    """Recordings with the chains of their parts' rows."""
    return load_part_touches(paths, PROBES)


def as_urdf(data: SelfTouchData, folder: Path, urdf: Path) -> SelfTouchData:
    """The same, with chains from a URDF that is written from the rows in `folder`."""
    text, moving = ['<robot name="rows">', f'<link name="{BASE}"/>'], set[str]()
    for part in dict.fromkeys(data.links.values()):
        with np.load(folder / f"part_{part}.npz") as arrays:
            names = [data.joints[column] for column in arrays["joint_cols"].tolist()]
            text += _branch(part, arrays["dh"], names)
            moving |= set(names)
    for joint in sorted(set(data.joints) - moving):  # of arms that touch nothing
        text += [f'<link name="{joint}_end"/>', _joint(joint, TURNS, BASE, f"{joint}_end", "", "")]
    urdf.write_text("\n".join([*text, "</robot>"]))
    robot = Robot("rows", UrdfBody(urdf), {})
    chains = {}
    for name, chain in data.chains.items():
        own = robot_chain(robot, f"{data.links[name]}_end", data.joints, base=BASE, name=name)
        chains[name] = replace(
            own, mount=chain.mount, taxels=chain.taxels, normals=chain.normals, radius=chain.radius
        )
    return replace(data, chains=chains)


def _branch(part: str, dh: FloatArray, joints: list[str]) -> Iterator[str]:
    """Links and joints of one part: a turn about z for each row that moves, then what is fixed."""
    parent, fixed = BASE, len(dh) - len(joints)
    for row, (a, d, alpha, offset) in enumerate(dh):
        if row >= fixed:
            turned = f"{part}_{row}_turned"
            yield f'<link name="{turned}"/>'
            yield _joint(joints[row - fixed], TURNS, parent, turned, "", "")
            parent = turned
        child = f"{part}_{row}"
        turn = Rotation.from_euler("z", offset) * Rotation.from_euler("x", alpha)
        place = np.array([a * np.cos(offset), a * np.sin(offset), d])
        yield f'<link name="{child}"/>'
        xyz, rpy = (" ".join(map(repr, v.tolist())) for v in (place, turn.as_euler("xyz")))
        yield _joint(f"{child}_fixed", "fixed", parent, child, xyz, rpy)
        parent = child
    yield f'<link name="{part}_end"/>'
    yield _joint(f"{part}_end_fixed", "fixed", parent, f"{part}_end", "", "")


def _joint(name: str, kind: str, parent: str, child: str, xyz: str, rpy: str) -> str:
    origin = f'<origin xyz="{xyz or "0 0 0"}" rpy="{rpy or "0 0 0"}"/>'
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{origin}<axis xyz="0 0 1"/></joint>'
