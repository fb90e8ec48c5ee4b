"""Recordings as a bag of ROS 2: one MCAP file, with a cloud for every sample, and its metadata."""

from __future__ import annotations

from pathlib import Path

from skinmap.errors import DataFormatError
from skinmap.io.mcap.writing import McapRecording
from skinmap.io.recordings.recorded_stream import RecordedStream
from skinmap.io.robots.manifest import load_robot
from skinmap.io.ros2.bag import METADATA
from skinmap.skin.robot import Robot

FILE = "recording.mcap"


def write_rosbag2(track: RecordedStream, folder: Path) -> None:
    """Write a bag; where the recording names its robot, with all that shows it.

    Raises
    ------
    OutputError
        The folder cannot be written to.
    """
    robot: Robot | None = load_robot(track.manifest) if track.manifest else None
    if len(track.times) and track.times[0] < 0:
        raise DataFormatError("its times begin before zero", folder)
    recording = McapRecording(
        folder / FILE,
        parts=track.parts,
        widths={track.kind: track.info.widths},
        rate=track.info.rate,
        name=track.info.name,
        robot=track.info.robot,
        manifest=track.manifest,
        clock=track.info.clock,
        fingerprints=track.info.fingerprints,
        skins={} if robot is None else {part: robot.skin(part) for part in track.parts},
        samples=track.samples,
        model=robot,
        points_hz=float("inf"),
    )
    recording.add_all(track)
    (folder / METADATA).write_text(recording.bag_metadata())
