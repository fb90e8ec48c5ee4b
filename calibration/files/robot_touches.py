"""Self-touch of a robot with a URDF: its parts, probes and joints, and the chains between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from calibration.files.self_touch_files import (
    Probe,
    SelfTouchData,
    TouchFile,
    check_angles,
    find_probes,
    read_touches,
    touch_files,
)
from calibration.mount.chains import Chain, TouchRecording, robot_chain
from skinmap.arrays import IntArray
from skinmap.errors import DataFormatError, InvalidArrayError, SkinMismatchError, UnknownNameError
from skinmap.skin.robot import Robot, check_link, common_ancestor
from skinmap.skin.skin import fingerprint

BEYOND = np.deg2rad(10.0)  # a limit: more than zeros of joints are off by


def load_robot_touches(
    paths: Sequence[Path], robot: Robot, probe_file: Path | None = None
) -> SelfTouchData:
    """Recordings of a robot, and chains to the parts and probes that they name.

    All chains begin at the deepest link that everything hangs on.

    Raises
    ------
    MissingFileError, DataFormatError
        A file that does not exist, or does not follow its format (names what it lacks).
    UnknownNameError
        A part, probe, link or joint that the robot lacks (names those that exist).
    SkinMismatchError
        A recording of another robot.
    """
    paths = touch_files(paths)
    probes = find_probes(probe_file, paths)
    links = {name: _link(robot, probe) for name, probe in probes.items()}
    files, notes = [], list[str]()
    for path in paths:
        found, left_out = read_touches(path, probes)
        files += [_own(one, robot, probes) for one in found]
        notes += left_out
    names = dict.fromkeys(name for one in files for name in one.touches.chains)
    links = {name: links.get(name) or robot.part(name).link for name in names}
    base = common_ancestor(robot.body.tree, list(links.values()))
    joints = _joints(files, links, robot)
    chains = {
        name: _chain(robot, name, links[name], base, joints, probes.get(name)) for name in names
    }
    recordings = [_ordered(one, joints) for one in files]
    notes += _beyond(recordings, joints, robot)
    return SelfTouchData(recordings, chains, joints, robot.name, base, links, tuple(notes))


def _link(robot: Robot, probe: Probe) -> str:
    if probe.part:
        return robot.part(probe.part).link
    try:
        return check_link(robot.body.links, probe.link)
    except UnknownNameError as error:
        raise UnknownNameError(f"link (probe {probe.name!r})", probe.link, error.known) from None


def _own(file: TouchFile, robot: Robot, probes: Mapping[str, Probe]) -> TouchFile:
    """A recording checked to be of the robot, its sides named as the robot names them."""
    if file.robot and file.robot.lower() != robot.name.lower():
        raise SkinMismatchError(f"{file.path}: a recording of {file.robot!r}, not {robot.name!r}")
    if not file.joints:
        raise DataFormatError("lacks 'joint_names', the joints of the angles in q", file.path)
    for joint in file.joints:
        if joint not in robot.body.joints:
            raise UnknownNameError(f"joint ({file.path})", joint, robot.body.joints)
    try:
        check_angles(file.touches.angles)
    except InvalidArrayError as error:
        raise DataFormatError(str(error), file.path) from None
    one = file.touches
    first, second = (_side(name, robot, probes, file.path) for name in one.chains)
    for name, touched in zip((first, second), one.touched, strict=True):
        if name in robot.parts and touched is None:
            raise DataFormatError(
                f"lacks 'ids_{name}', the taxels of part {name!r} in each event", file.path
            )
        theirs = file.skins.get(name)
        if theirs is not None and theirs != fingerprint(robot.skin(name)):
            raise SkinMismatchError(
                f"{file.path}: the layout of {name!r} is not that of {robot.name!r}"
            )
        if touched is not None:
            _check_ids(touched, robot, name, file.path)
    return replace(file, touches=replace(one, chains=(first, second)))


def _side(name: str, robot: Robot, probes: Mapping[str, Probe], path: Path) -> str:
    """The part or probe that a side's name means: its own, or that of the link it alone is on."""
    if name in robot.parts or name in probes:
        return name
    on_link = [part for part in robot.parts if robot.part(part).link == name]
    if len(on_link) == 1:
        return on_link[0]
    known = (*robot.parts, *probes)
    raise UnknownNameError(
        f"part or probe (of {path.name}; probes.toml beside it names probes)", name, known
    )


def _check_ids(touched: Sequence[IntArray], robot: Robot, part: str, path: Path) -> None:
    """Refuse channels that the part has not."""
    known = robot.skin(part).channels
    ids = np.unique(np.concatenate([np.zeros(0, np.int64), *touched]))
    wrong = ids[(ids < 0) | (ids > known.max())]
    if len(wrong):
        raise DataFormatError(
            f"taxel {int(wrong[0])} of {part!r}, whose channels are {int(known.min())} to "
            f"{int(known.max())}: ids are channels of its taxel table",
            path,
        )


def _joints(files: Sequence[TouchFile], links: Mapping[str, str], robot: Robot) -> tuple[str, ...]:
    """Joints of all recordings, each of which tells those between its own two links."""
    joints = tuple(dict.fromkeys(joint for one in files for joint in one.joints))
    every = tuple(robot.body.joints)
    for one in files:
        first, second = (links[name] for name in one.touches.chains)
        between = robot_chain(robot, second, every, base=first)
        needed = [every[column] for column in dict.fromkeys(between.joints.tolist())]
        if not needed:
            raise DataFormatError(
                f"no joint lies between {first!r} and {second!r}: they never touch anew", one.path
            )
        lacks = [joint for joint in needed if joint not in one.joints]
        if lacks:
            raise DataFormatError(
                f"lacks the angles of {', '.join(lacks)}, between {first!r} and {second!r}; it "
                f"has: {', '.join(one.joints)}",
                one.path,
            )
    return joints


def _chain(
    robot: Robot, name: str, link: str, base: str, joints: Sequence[str], probe: Probe | None
) -> Chain:
    # Joints that no recording tells lie above all that touches: they cancel out of every pair.
    held = {joint: 0.0 for joint in robot.body.joints if joint not in joints}
    if probe is not None:
        own = robot_chain(robot, link, joints, base=base, held=held, name=name, mount=probe.mount)
        return replace(own, radius=probe.radius)
    skin = robot.skin(name)
    taxels, normals = np.full((2, int(skin.channels.max()) + 1, 3), np.nan)
    taxels[skin.channels], normals[skin.channels] = skin.positions, skin.normals
    return robot_chain(
        robot, link, joints, base=base, held=held, name=name, taxels=taxels, normals=normals
    )


def _ordered(file: TouchFile, joints: Sequence[str]) -> TouchRecording:
    """The recording with columns for all joints; 0 for those that are not between its links."""
    angles = np.zeros((len(file.touches), len(joints)))
    for column, joint in enumerate(file.joints):
        angles[:, joints.index(joint)] = file.touches.angles[:, column]
    return replace(file.touches, angles=angles)


def _beyond(recordings: Sequence[TouchRecording], joints: Sequence[str], robot: Robot) -> list[str]:
    """A note on each recording whose angles leave the limits of joints."""
    notes = []
    limits = np.array([robot.body.joints[joint] for joint in joints])
    for one in recordings:
        over = np.maximum(limits[:, 0] - one.angles, one.angles - limits[:, 1])
        over[:, ~one.angles.any(axis=0)] = 0.0
        worst = int(np.argmax(over.max(axis=0)))
        most = float(over.max())
        if most > BEYOND:
            notes.append(
                f"{one.name}: {joints[worst]} is read {np.rad2deg(most):.0f} deg beyond its limits"
            )
    return notes
