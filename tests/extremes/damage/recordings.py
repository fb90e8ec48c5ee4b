"""Targets that hold samples or what was learnt from them: recordings, models, responses."""

from __future__ import annotations

import io
import shutil
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from calibration.files.mount_files import (
    read_arrays,
    read_plane_evidence,
    read_samples,
    read_wrenches,
)
from calibration.files.robot_touches import load_robot_touches
from calibration.files.self_touch_files import load_part_touches, read_probes
from calibration.files.tables import read_places
from calibration.response import ResponseCalibration, load_response, save_response
from skinmap import load_robot
from skinmap.cli.evaluate.protocol_real import read_grid
from skinmap.disk_cache import Cache
from skinmap.errors import DataFormatError
from skinmap.io.mcap.reading import read_track, write_repaired
from skinmap.io.mcap.writing import McapRecording
from skinmap.io.recordings.channel_table import read_arrays as read_channels
from skinmap.io.recordings.channel_table import read_cyskin_text, read_table
from skinmap.io.recordings.cyskin_arrays import read_pressed
from skinmap.io.recordings.dumper import read_log
from skinmap.io.recordings.image_files import read_images
from skinmap.io.recordings.learning import write_npz
from skinmap.io.recordings.load_evidence import read_evidence
from skinmap.io.recordings.marks import Marks, read_marks
from skinmap.io.recordings.touch_files import (
    load_recordings,
    read_mapping,
    read_recordings,
    read_streams,
)
from skinmap.io.recordings.xdf import read_xdf, read_xdf_parts
from skinmap.io.ros2.bag import read_bag, read_bag_mapping, read_bag_parts
from skinmap.io.ros2.messages import (
    Cloud,
    build,
    definition,
    full_name,
    joints_message,
    read_joints,
    write,
)
from skinmap.io.taxels.cyskin import CySkin, write_cyskin
from skinmap.live.network.zenoh_stream import CLOUD, values_of
from skinmap.memory_features import FEATURES
from skinmap.parallel import ResumeStore
from skinmap.recognition.check import planted_touches
from skinmap.recognition.classifier import classifiers
from skinmap.recognition.model_file import load_classifier, save_classifier
from skinmap.soundness.track import read_track as read_examined
from skinmap.touch import recording as archive
from skinmap.touch.load_calibration import LoadCalibration
from skinmap.touch.recording import Recording, save_recordings

from .layouts import written
from .target import Target

N, SAMPLES, RATE = 8, 30, 50.0


@cache
def values() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (SAMPLES, N)).astype(np.uint8)


def zipped(**arrays: Any) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


ROWS = b"time,a,b\n0.0,1,2\n0.02,3,4\n0.04,5,6\n"


def loaded() -> bytes:
    """Samples beside a pressure, as `calibrate load` and `examine` read them."""
    times = np.arange(SAMPLES) / RATE
    return zipped(samples=values(), times=times, pressure_bar=np.sin(times))


@cache
def loaded_bag() -> bytes:
    """The same in MCAP, as ROS 2 records it."""
    from mcap.writer import Writer

    buffer = io.BytesIO()
    writer = Writer(buffer)
    writer.start()
    layout = build("std_msgs/MultiArrayLayout", [], 0)
    for kind, topic, fields in (
        ("std_msgs/UInt8MultiArray", "/skin", [(layout, row) for row in values()]),
        ("std_msgs/Float64", "/pressure_bar", [(float(np.sin(k)),) for k in range(SAMPLES)]),
    ):
        schema = writer.register_schema(full_name(kind), "ros2msg", definition(kind))
        channel = writer.register_channel(topic, "cdr", schema)
        for row, one in enumerate(fields):
            stamp = int(1e9 * row / RATE)
            writer.add_message(channel, stamp, write(kind, *one), stamp)
    writer.finish()
    return buffer.getvalue()


def load_model() -> bytes:
    """A load calibration of two taxels."""
    each = np.ones(2)
    return LoadCalibration(
        np.zeros((2, FEATURES)), 0 * each, 200 * each, 0 * each, each, 0.005 * each, 0.01, 50.0,
        "linear", 0 * each, 0.0,
    ).to_bytes()  # fmt: skip


def recording() -> bytes:
    events = np.repeat([-1, 0, 1], SAMPLES // 3)
    owners = np.full((2, N), -1)
    one = Recording(
        "a", np.arange(SAMPLES) / RATE, values(), events, ("poke", "pat"), np.array([0, 1]), owners
    )
    return written(lambda path: save_recordings([one], path))


@cache
def mcap(kind: str = "raw") -> bytes:
    """30 samples in a few chunks, with a touch and an angle."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "t.mcap"
        file = McapRecording(path, parts=["a"], widths={kind: [N]}, rate=RATE)
        for row, sample in enumerate(values()):
            file.add(kind, row / RATE, sample)
        file.add_angles(0.1, {"elbow": 0.5})
        file.mark("a", 0, "poke", began=0.1, ended=0.3)
        file.close()
        return path.read_bytes()


def patch() -> bytes:
    """A CySkin file of taxels with the ids 32, 33, ..."""
    up = np.tile([0.0, 0.0, 1.0], (N, 1))
    places = np.column_stack([np.arange(N) % 4, np.arange(N) // 4, np.zeros(N)]) * 6e-3
    one = CySkin("patch", 32 + np.arange(N), places, up, np.zeros((0, 3), np.int64))
    return written(lambda path: write_cyskin(one, path))


def pressed() -> bytes:
    """Two files of samples on that patch."""
    return zipped(
        values=values().astype(np.uint16) * 70,
        times=np.arange(SAMPLES) / RATE,
        taxel_ids=32 + np.arange(N),
        file_index=np.repeat([0, 1], SAMPLES // 2),
        file_class=np.array([0, 3], np.int8),
        hand=np.arange(SAMPLES) % 2,
    )


def learning() -> bytes:
    """The same as arrays for machine learning."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "t.mcap"
        path.write_bytes(mcap("pressure"))
        write_npz(read_track(path), path.with_suffix(".npz"))
        return path.with_suffix(".npz").read_bytes()


def xdf() -> bytes:
    """What LabRecorder writes for one stream, by the rules of the format."""

    def chunk(tag: int, content: bytes) -> bytes:
        return b"\x04" + (len(content) + 2).to_bytes(4, "little") + bytes([tag, 0]) + content

    head = (
        '<?xml version="1.0"?><info><name>a</name><type>Tactile</type>'
        f"<channel_count>{N}</channel_count><nominal_srate>{RATE}</nominal_srate>"
        "<channel_format>float32</channel_format><created_at>1.0</created_at></info>"
    )
    stream = (1).to_bytes(4, "little")
    rows = b"".join(
        b"\x08" + np.float64(100 + row / RATE).tobytes() + sample.astype("<f4").tobytes()
        for row, sample in enumerate(values())
    )
    clock = np.array([100.0, -0.5]).tobytes()
    return b"".join([
        b"XDF:", chunk(1, b"<info><version>1.0</version></info>"), chunk(2, stream + head.encode()),
        chunk(3, stream + b"\x04" + SAMPLES.to_bytes(4, "little") + rows), chunk(4, stream + clock),
        chunk(6, stream + b"<info></info>"),
    ])  # fmt: skip


def dump() -> bytes:
    lines = [f"{row} {100 + row / RATE} {' '.join(map(str, v))}" for row, v in enumerate(values())]
    return ("\n".join(lines) + "\n").encode()


@cache
def model(name: str) -> bytes:
    rng = np.random.default_rng(0)
    found = classifiers.get(name)().fit(planted_touches(8, rng=rng), rng=rng)
    return written(lambda path: save_classifier(found, path))


def response() -> bytes:
    rng = np.random.default_rng(0)
    found = ResponseCalibration.fit(np.rint(20 + rng.normal(0, 1.2, (200, N))))
    return written(lambda path: save_response(found, path))


def self_touch() -> bytes:
    ids, ends = np.array([0, 1, 2, 1, 0]), np.array([0, 2, 3, 5])
    angles = np.random.default_rng(0).normal(size=(3, 2))
    return zipped(chain1="A", chain2="B", q=angles, ids_A=ids, ptr_A=ends, ids_B=ids, ptr_B=ends)


def part(column: int) -> bytes:
    return zipped(taxel_pos=0.01 * np.eye(3), mount=np.array([0.1, 0, 0, 0, 0.2, 0]),
                  dh=np.array([[0.1, 0, 1.5, 0]]), joint_cols=np.array([column]))  # fmt: skip


PROBES = b'[[probe]]\nname = "finger"\nlink = "base"\ntip_mm = [1.0, 2.0, 3.0]\n'
PLACES = b"touch,x,y,z,part,start_s,end_s\n0,0.1,0.2,0.3,forearm,1.0,2.0\n1,0.1,0,0,forearm,3,4\n"


@cache
def arm() -> Any:
    """The robot of the documents: one arm with one part."""
    return load_robot(str(Path(__file__).parents[3] / "docs/examples/robot/robot.toml"))


def presses() -> bytes:
    angles = np.linspace(0.1, 0.9, 4)[:, None]
    return zipped(joints=np.array(["elbow"]), angles=angles, ids_forearm=np.array([0, 1, 2, 3, 1]),
                  ptr_forearm=np.array([0, 1, 2, 4, 5]))  # fmt: skip


def robot_touches() -> bytes:
    return zipped(joint_names=np.array(["elbow"]), q=np.linspace(0.1, 0.9, 3)[:, None],
                  chain1="finger", chain2="forearm", ids_forearm=np.array([0, 1, 2, 1]),
                  ptr_forearm=np.array([0, 1, 2, 4]))  # fmt: skip


def wrenches() -> bytes:
    rng = np.random.default_rng(0)
    frames = np.tile(np.eye(4), (3, 1, 1))
    return zipped(points=rng.normal(size=(3, 3)), frames=frames, forces=rng.normal(size=(3, 3)),
                  moments=rng.normal(size=(3, 3)), taxels=rng.normal(size=(4, 3)))  # fmt: skip


MAPPING = b'robot = "kaspar"\npart = "left_hand"\nlabel = "poke"\nrest_percentile = 25\n'
MARKS = b"part,event,began_s,ended_s,label\na,0,0.1,0.2,poke\na,1,0.3,0.4,rub\n"


def channel_table() -> bytes:
    head = ["time", *(f"ch{k}" for k in range(N))]
    rows = [[f"{row / RATE:g}", *map(str, v)] for row, v in enumerate(values())]
    return "\n".join(",".join(row) for row in [head, *rows]).encode()


def cyskin(*, pairs: bool = False) -> bytes:
    rows = [
        f"{row} {row / 10:.6f} "
        + " ".join(f"{k} {x}" if pairs else f"{x}" for k, x in enumerate(v.tolist()))
        for row, v in enumerate(values())
    ]
    return "\n".join([*([] if pairs else [" ".join(map(str, range(N)))]), *rows]).encode()


def marks(path: Path) -> Any:
    return read_marks(path, Marks(()), np.arange(SAMPLES) / RATE, ["a"])


OWN_MAP = b"""[[part]]
name = "a"
topic = "/skin/raw"
"""
BAG_MAP = b"""[[part]]
name = "a"
topic = "/a"
field = "f"
channels = [0, 2]
"""


def bag_row(message: Path) -> Any:
    """A message of a foreign topic, as the bytes say."""
    data = message.read_bytes()
    return [values_of(kind, data, "f") for kind in (CLOUD,)]


def told(message: Path) -> Any:
    """Texts and joint angles."""
    return read_joints(message.read_bytes())


def cloud() -> bytes:
    return Cloud("hand", np.zeros((5, 3)), "f").message(10**9, np.arange(5.0))


def samples(path: Path) -> Any:
    """A track with all its values, which is where damage of its content shows."""
    track = read_track(path)
    return replace(track, values=track.values[:])


def repaired(path: Path) -> Any:
    """What the repaired file holds, with what the damaged one had lost."""
    track = write_repaired(path, path.with_suffix(".whole"))
    return replace(samples(path.with_suffix(".whole")), loss=track.loss)


def resumed(path: Path) -> Any:
    """A result that is kept to resume a sweep, or None where it must be computed again."""
    folder = path.with_name("sweep")
    shutil.rmtree(folder, ignore_errors=True)
    with ResumeStore(folder, "tests") as store:
        store.keep("ab", {"sum": 1.5, "array": np.arange(5.0)})
    next(folder.rglob("*.npz")).write_bytes(path.read_bytes())
    with ResumeStore(folder, "tests") as store:
        try:
            return store.recall("ab")
        except KeyError:
            raise DataFormatError("computed again", path) from None


def kept_result() -> bytes:
    """The file of such a result."""
    with tempfile.TemporaryDirectory() as name:
        with ResumeStore(Path(name) / "sweep", "tests") as store:
            store.keep("ab", {"sum": 1.5, "array": np.arange(5.0)})
        return next(Path(name).rglob("*.npz")).read_bytes()


def npy() -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, values())
    return buffer.getvalue()


def kept(path: Path) -> Any:
    """An entry of the cache: arrays, or dropped with a warning."""
    cache = Cache(path.parent / "cache")
    place = cache._path("wrap", "ab")
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_bytes(path.read_bytes())
    found = cache.get("wrap", "ab")
    if found is not None and not all(isinstance(one, np.ndarray) for one in found.values()):
        raise AssertionError("the cache gave what is no array")
    return found


def both(name: str, *rest: Any) -> list[Target]:
    """An archive damaged as a file, and inside."""
    return [Target(name, *rest), Target(f"{name}-inside", *rest, inside=True)]


PARTS = {"part_A.npz": lambda: part(0), "part_B.npz": lambda: part(1)}

TARGETS = [
    *both("recording", "t.npz", lambda: [recording()], load_recordings,
          ("skinmap.io.recordings.touch_files.load_recordings",
           "skinmap.touch.recording.load_recordings")),
    Target("recording-archive", "t.npz", lambda: [recording()], archive.load_recordings),
    *both("learning", "t.npz", lambda: [learning()], load_recordings),
    Target("mcap", "t.mcap", lambda: [mcap(), mcap("pressure")], samples,
           ("skinmap.io.mcap.reading.read_track",
            "skinmap.io.mcap.reading.read_head",
            "skinmap.io.mcap.mcap_scan.read_chunk")),
    Target("mcap-touches", "t.mcap", lambda: [mcap("pressure")], load_recordings),
    Target("bag-mapping", "t.map.toml", lambda: [BAG_MAP], read_bag_mapping,
           ("skinmap.io.ros2.bag.read_bag_mapping", "skinmap.io.text.read_toml")),
    Target("bag", "t.mcap", lambda: [mcap()], lambda p: read_bag(p).values[:],
           ("skinmap.io.ros2.bag.read_bag",), beside={"t.map.toml": lambda: OWN_MAP}),
    Target("ros2-cloud", "m", lambda: [cloud()], bag_row, ("skinmap.io.ros2.messages.read_cloud",)),
    Target("ros2-joints", "m", lambda: [joints_message(5, {"a": 1.0, "b": 2.0})], told,
           ("skinmap.io.ros2.messages.read_joints", "skinmap.io.ros2.messages.read_text")),
    Target("mcap-repair", "t.mcap", lambda: [mcap()], repaired),
    Target("xdf", "t.xdf", lambda: [xdf()], lambda p: read_xdf(p).values[:],
           ("skinmap.io.recordings.xdf.read_xdf",)),
    Target("dump", "data.log", lambda: [dump()], lambda p: read_streams(p).values[:],
           ("skinmap.io.recordings.dumper.read_dump",
            "skinmap.io.recordings.dumper.read_logs",
            "skinmap.io.recordings.touch_files.read_streams")),
    Target("xdf-parts", "t.xdf", lambda: [xdf()], read_xdf_parts,
           ("skinmap.io.recordings.xdf.read_xdf_parts",)),
    Target("bag-parts", "t.mcap", lambda: [mcap()], read_bag_parts,
           ("skinmap.io.ros2.bag.read_bag_parts",), beside={"t.map.toml": lambda: OWN_MAP}),
    Target("log", "data.log", lambda: [dump()], read_log,
           ("skinmap.io.recordings.dumper.read_log",)),
    *both("model", "t.skinmodel", lambda: [model("histogram"), model("contact-geometry")],
          load_classifier, ("skinmap.recognition.model_file.load_classifier",
           "skinmap.recognition.model_file.read_model")),
    *both("response", "t.npz", lambda: [response()], load_response,
          ("calibration.response.response.load_response",)),
    *both("self-touch", "A_B.npz", lambda: [self_touch()], lambda p: load_part_touches([p]),
          ("calibration.files.self_touch_files.load_part_touches",
           "calibration.files.self_touch_files.read_touches",
           "calibration.files.mount_files.read_arrays"), PARTS),
    *both("robot-touches", "t.npz", lambda: [robot_touches()],
          lambda p: load_robot_touches([p], arm(), p.with_name("probes.toml")),
          ("calibration.files.robot_touches.load_robot_touches",), {"probes.toml": lambda: PROBES}),
    Target("probes", "probes.toml", lambda: [PROBES], read_probes,
           ("calibration.files.self_touch_files.read_probes",)),
    *both("presses", "p.npz", lambda: [presses()], lambda p: read_plane_evidence([p], arm()),
          ("calibration.files.mount_files.read_plane_evidence",)),
    Target("places", "places.csv", lambda: [PLACES], lambda p: read_places(p, "forearm"),
           ("calibration.files.tables.read_places",)),
    *both("self-touch-part", "part_A.npz", lambda: [part(0)],
          lambda p: load_part_touches([p.with_name("A_B.npz")]), (),
          {"A_B.npz": self_touch, "part_B.npz": lambda: part(1)}),
    *both("wrenches", "w.npz", lambda: [wrenches()], read_wrenches,
          ("calibration.files.mount_files.read_wrenches",)),
    *both("arrays", "s.npz", lambda: [zipped(samples=values(), loads=values())],
          lambda p: read_samples(p, ("samples", "loads")),
          ("calibration.files.mount_files.read_samples",
           "calibration.files.mount_files.read_arrays")),
    *both("cache", "c.npz", lambda: [zipped(vertices=np.eye(3), faces=np.eye(3, dtype=int))], kept),
    Target("channel-table", "t.csv", lambda: [channel_table()], read_recordings,
           ("skinmap.io.recordings.channel_table.read_table",
            "skinmap.io.recordings.touch_files.read_recordings"), {"t.toml": lambda: MAPPING}),
    *both("channel-arrays", "t.npz",
          lambda: [zipped(values=values(), times=np.arange(SAMPLES) / RATE, channels=np.arange(N))],
          read_channels, ("skinmap.io.recordings.channel_table.read_arrays",),
          {"t.toml": lambda: MAPPING}),
    Target("channel-mapping", "t.toml", lambda: [MAPPING], read_mapping,
           ("skinmap.io.recordings.touch_files.read_mapping",)),
    Target("channel-mapping-used", "t.toml", lambda: [MAPPING],
           lambda p: read_table(p.with_suffix(".csv")), (), {"t.csv": channel_table}),
    *both("cyskin-arrays", "t.npz", lambda: [pressed()],
          lambda p: read_pressed(p, p.with_name("skin.json")),
          ("skinmap.io.recordings.cyskin_arrays.read_pressed",), {"skin.json": patch}),
    Target("cyskin-text", "t.txt", lambda: [cyskin(), cyskin(pairs=True)], read_cyskin_text,
           ("skinmap.io.recordings.channel_table.read_cyskin_text",), {"t.toml": lambda: MAPPING}),
    Target("marks", "t.csv", lambda: [MARKS], marks, ("skinmap.io.recordings.marks.read_marks",)),
    Target("resume", "r.npz", lambda: [kept_result()], resumed),
    *both("load", "l.npz", lambda: [loaded()], read_evidence,
          ("skinmap.io.recordings.load_evidence.read_evidence", "skinmap.archive.read_arrays")),
    Target("load-mcap", "l.mcap", lambda: [loaded_bag(), mcap()],
           lambda p: read_evidence(p, needed=False)),
    Target("load-csv", "l.csv", lambda: [ROWS], lambda p: read_evidence(p, needed=False)),
    *both("examined", "e.npz", lambda: [loaded()], read_examined,
          ("skinmap.soundness.track.read_track",)),
    Target("examined-csv", "e.csv", lambda: [ROWS], read_examined),
    *both("load-model", "load.npz", lambda: [load_model()], LoadCalibration.read),
    *both("images", "i.npz",
          lambda: [zipped(images=np.full((2, 3, 4), 9, np.uint8), labels=np.array(["a", "b"]))],
          read_images, ("skinmap.io.recordings.image_files.read_images",)),
    *both("grid", "g.npz",
          lambda: [zipped(readings=np.full((2, 3, 4), 9, np.int16), person=np.zeros(2, np.int64),
                          prints=np.ones((2, 24, 4), np.uint8))],
          read_grid, ("skinmap.cli.evaluate.protocol_real.read_grid",)),
    Target("samples-npy", "s.npy", lambda: [npy()], lambda p: read_arrays(p, "samples")),
]  # fmt: skip
