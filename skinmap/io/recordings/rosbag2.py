"""Recordings as a bag of ROS 2: one MCAP file, with a cloud for every sample, and its metadata."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skinmap.errors import DataFormatError
from skinmap.io.recordings.mcap_recording import McapRecording
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
    try:
        for row, time in enumerate(track.times.tolist()):
            if track.joints:
                angles = dict(zip(track.joints, track.angles[row].tolist(), strict=True))
                recording.add_angles(time, {k: v for k, v in angles.items() if np.isfinite(v)})
            recording.add(track.kind, time, track.values[row : row + 1][0])
        for touch in track.touches:
            if touch.first <= touch.last:
                recording.mark(
                    touch.part,
                    touch.event,
                    touch.label,
                    began=float(track.times[touch.first]),
                    ended=float(track.times[touch.last]),
                    subject=touch.subject,
                    owners=touch.owners,
                    motion=touch.motion,
                )
    finally:
        recording.close()
    (folder / METADATA).write_text(recording.bag_metadata())
