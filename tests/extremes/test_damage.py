"""Damaged files and messages of every kind: read, or refused with an error of ours."""

from __future__ import annotations

import ast
import dataclasses
import io
import warnings
import zipfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from damage import messages
from damage.catalogue import TARGETS
from damage.mutations import MEMBER, accidents, mutate, packed, spread
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calibration.files.mount_files import read_wrenches
from skinmap import archive
from skinmap.errors import DataFormatError, InvalidArrayError, MessageError
from skinmap.io.ros2.messages import points_of
from skinmap.live.network.network_messages import parse_address
from skinmap.touch.recording import Recording
from viewer.interaction.view_file import load_view
from viewer.web.hub import Client

ROOT = Path(__file__).parents[2]
FEW = 25  # examples of each target in the suite; `make fuzz` takes 5,000
# Nothing that is read comes from elsewhere, or it runs through one that is listed.
NO_READERS = {
    "skinmap.live.network.lsl_stream.load_lsl": "loads a library",
    "skinmap.live.response.pressures.load_responses": "load_response, by entry point",
    "skinmap.recognition.training.read_size": "a word of a profile, tested there",
    "skinmap.commands.options.read_radius": "words of a command line, tested with it",
    "skinmap.live.response.loads.load_calibrations": "LoadCalibration.read, by part",
    "skinmap.recognition.answering.read_groups": "words of a command line, tested with it",
    "calibration.commands.plane.read_planes": "words of a command line, tested with it",
    "skinmap.io.text.read_text": "under every reader of text",
    "skinmap.io.robots.manifest.load_fields": "under read_manifest",
    "viewer.inputs.read_token": "under read_text, and checked as a token",
}


@pytest.fixture(scope="module")
def folders(tmp_path_factory) -> dict[str, Path]:
    """A folder of each target with what stands beside the damaged file."""
    made = {}
    for name, target in TARGETS.items():
        made[name] = tmp_path_factory.mktemp(name)
        target.lay_out(made[name])
    return made


@pytest.mark.parametrize("name", TARGETS)
def test_originals_are_read(folders, name):
    target = TARGETS[name]
    for original in target.seeds():
        assert target.try_one(original, folders[name])


@pytest.mark.fuzz
@settings(
    max_examples=FEW if settings.default.max_examples <= 100 else settings.default.max_examples,
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(steps=accidents, which=st.integers(0, 7))
@pytest.mark.parametrize("name", TARGETS)
def test_damage_is_read_or_refused(folders, name, steps, which):
    seeds = TARGETS[name].seeds()
    TARGETS[name].try_one(mutate(seeds[which % len(seeds)], steps), folders[name])


def test_archives_survive_being_laid_side_by_side():
    seeds = TARGETS["response"].seeds()
    assert spread(packed(spread(seeds[0]))) == spread(seeds[0])
    assert spread(seeds[0]).count(MEMBER) == 4


def test_every_reader_is_a_target():
    covered = {reader for target in TARGETS.values() for reader in target.covers}
    found = set()
    for top in ("skinmap", "calibration", "viewer"):
        for file in (ROOT / top).rglob("*.py"):
            module = ".".join(file.relative_to(ROOT).with_suffix("").parts)
            found |= {
                f"{module}.{node.name}"
                for node in ast.parse(file.read_text()).body
                if isinstance(node, ast.FunctionDef) and node.name.startswith(("read_", "load_"))
            }
    assert not found - covered - set(NO_READERS), "readers without damaged input"
    assert not covered - found, "targets name readers that are gone"


def test_archives_that_unpack_to_too_much_are_refused_before_anything_is_read(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(archive, "LARGEST", 1000)
    np.savez_compressed(tmp_path / "bomb.npz", zeros=np.zeros(1000))
    with (
        pytest.raises(DataFormatError, match="at most 4 GB"),
        archive.open_arrays(tmp_path / "bomb.npz"),
    ):
        pass


def test_members_that_are_no_arrays_are_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "t.npz", "w") as whole:
        whole.writestr("head.npy", "not an array")
    with (
        pytest.raises(DataFormatError, match=r"'head\.npy', which is not an array"),
        archive.open_arrays(tmp_path / "t.npz"),
    ):
        pass


def test_arrays_that_python_2_wrote_are_read_without_a_warning(tmp_path):
    head = b"{'descr': '<f8', 'fortran_order': False, 'shape': (3L,), }\n"
    member = archive.MAGIC + b"\x01\x00" + len(head).to_bytes(2, "little") + head
    with zipfile.ZipFile(tmp_path / "t.npz", "w") as whole:
        whole.writestr("a.npy", member + np.arange(3.0).tobytes())
    with archive.open_arrays(tmp_path / "t.npz") as arrays:
        assert arrays["a"].tolist() == [0.0, 1.0, 2.0]


@pytest.mark.parametrize(
    "wish", ['{"do": "drawn", "samples": 1e999}', '{"do": "seek", "to": HUGE}']
)
def test_wishes_that_no_number_holds_are_answered(wish):
    client = Client("pressure")
    messages.grant(client, wish.replace("HUGE", "9" * 400))
    assert "asked for something unknown" in client.letters["problem"]


@pytest.mark.parametrize(("digits", "said"), [(5000, "too many digits"), (400, "out of range")])
def test_views_with_huge_numbers_are_refused(tmp_path, digits, said):
    whole = TARGETS["view"].seeds()[0].replace(b"22.0", b"9" * digits)
    (tmp_path / "view.json").write_bytes(whole)
    with pytest.raises(DataFormatError, match=said):
        load_view(tmp_path / "view.json")


def test_old_names_of_types_are_read_without_a_word(tmp_path):
    buffer = io.BytesIO()
    np.save(buffer, np.array([b"ab"]))
    with zipfile.ZipFile(tmp_path / "t.npz", "w") as whole:
        whole.writestr("head.npy", buffer.getvalue().replace(b"|S2", b"|a2"))
    with archive.open_arrays(tmp_path / "t.npz") as arrays:
        assert arrays["head"].tolist() == [b"ab"]


def npy(shape: str) -> bytes:
    """The head of an array of some shape, and nothing else."""
    head = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}}}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head.encode()


CYSKIN = b"""{"info": {"file_version": 2}, "skin": {"taxels": [{"id": 1, "x": [0, 0, %s],
    "n": [%s, 0, 0]}]}}"""


@pytest.mark.parametrize(
    ("target", "content", "said"),
    [
        ("module-layout", b"slots_mm = " + b"[" * 2000, "not a module layout"),
        ("module-layout", b"slots_mm = [[0, 0]]\ncentre = inf", "not a module layout"),
        ("module-layout", b"slots_mm = [[0, 1e3], [%s, 0]]" % (b"9" * 400), "not a module layout"),
        ("module-layout-csv", b"slot,x_mm\n" + b"1" * 200_000, "not a module layout"),
        ("samples-npy", npy("(99999999999999999999, 2)"), "too large"),
        ("anchors", b"channel,x,y,z\n99999999999999999999,0,0,0\n", "whole numbers from 0"),
        ("taxels-cyskin", CYSKIN % (b"1e200", b"1"), "must be a number up to 1000000"),
        ("taxels-cyskin", CYSKIN % (b"0", b"-1e200"), "must be a number from -1000000"),
        ("channel-mapping", b"a = " + b"[" * 2000, "not a mapping of a recording"),
        ("channel-mapping", b"a = " + b"9" * 5000, "not a mapping of a recording"),
        (
            "marks",
            b"part,event,began_s,ended_s,label\na,%s,0,0.1,b\n" % (b"1" * 5000),
            "no touch has the number 1111",
        ),
        ("batch", b"name,layout,mesh,anchors\n" + b"a" * 200_000, "not CSV: field larger"),
    ],
)
def test_what_fuzzing_found_is_refused_with_a_line(folders, target, content, said):
    """No error of Python's own, no warning from a cast, no cell without end."""
    path = folders[target] / TARGETS[target].file
    path.write_bytes(content)
    with warnings.catch_warnings(), pytest.raises(DataFormatError, match=said):
        warnings.simplefilter("error")
        TARGETS[target].read(path)


@pytest.mark.parametrize(("name", "wrong"), [("events", 0.5), ("subjects", 1e300), ("times", 1j)])
def test_recordings_of_other_kinds_of_numbers_are_refused(name, wrong):
    arrays = {
        "times": np.arange(2.0), "events": np.zeros(2, int), "subjects": np.zeros(1, int),
        "pressures": np.zeros((2, 3), np.uint8),
    }  # fmt: skip
    Recording("a", labels=("poke",), **arrays)
    with pytest.raises(InvalidArrayError, match=f"{name} must be .*numbers"):
        Recording("a", labels=("poke",), **arrays | {name: arrays[name] + wrong})


@pytest.mark.parametrize(
    ("file", "member", "value", "said"),
    [
        ("A_B.npz", "ids_A", np.array([0.5] * 5), "ids_A must be whole numbers"),
        ("A_B.npz", "ptr_A", np.array(3), r"ptr_A must have shape \(n,\), got \(\)"),
        ("A_B.npz", "q", np.array(1.0), "q must have shape"),
        (
            "A_B.npz",
            "chain1",
            np.array([2**31 - 1], "<i4").view("<U1").reshape(()),
            "invalid Unicode",
        ),
        ("part_A.npz", "joint_cols", np.array([1e300]), "joint_cols must be whole"),
        ("part_A.npz", "joint_cols", np.array([-1]), "columns from 0"),
        ("part_A.npz", "taxel_pos", np.zeros((3, 2)), r"numbers of shape \(n, 3\)"),
        ("part_A.npz", "mount", 1j * np.zeros(6), "mount must be numbers"),
    ],
)
def test_self_touch_of_strange_arrays_is_refused_with_a_line(tmp_path, file, member, value, said):
    target = TARGETS["self-touch"]
    target.lay_out(tmp_path)
    (tmp_path / target.file).write_bytes(target.seeds()[0])
    with np.load(tmp_path / file) as whole:
        arrays = dict(whole)
    np.savez(tmp_path / file, **arrays | {member: value})
    with warnings.catch_warnings(), pytest.raises(DataFormatError, match=said):
        warnings.simplefilter("error")
        target.read(tmp_path / target.file)


@pytest.mark.parametrize(
    "forces",
    [
        pytest.param(
            np.full((3, 3), np.longdouble("1e400")),
            marks=pytest.mark.skipif(
                np.finfo(np.longdouble).bits == 64, reason="no longer floats on this machine"
            ),
        ),
        np.full((3, 3), 1j),
        np.full((3, 3), np.frombuffer(b"\1\0\x80\x7f", "<f4")[0]),  # NaN that stops a machine
        np.array([["a"] * 3] * 3),
    ],
    ids=["too long", "complex", "signalling", "text"],
)
def test_wrenches_that_no_float_holds_are_refused_with_a_line(tmp_path, forces):
    arrays = {"points": np.eye(3), "frames": np.tile(np.eye(4), (3, 1, 1)), "moments": np.eye(3)}
    np.savez(tmp_path / "w.npz", forces=forces, **arrays)
    with warnings.catch_warnings(), pytest.raises(DataFormatError, match="must be numbers"):
        warnings.simplefilter("error")
        read_wrenches(tmp_path / "w.npz")


def cloud(fields, step, row_step, shape, data) -> SimpleNamespace:
    """A cloud as rosbags reads it."""
    kinds = [
        SimpleNamespace(**dict(zip(("name", "offset", "datatype", "count"), one, strict=True)))
        for one in fields
    ]
    return SimpleNamespace(
        fields=kinds, is_bigendian=False, point_step=step, row_step=row_step,
        height=shape[0], width=shape[1], data=np.frombuffer(data, np.uint8),
    )  # fmt: skip


@pytest.mark.parametrize("fields", [[("f", 0, 7, 1)], []])
@pytest.mark.parametrize("step", [0, 4])
@pytest.mark.parametrize("row_step", [0, 4, 2**32 - 1])
def test_clouds_of_billions_of_rows_in_a_few_bytes_are_refused_at_once(row_step, step, fields):
    """Rows that lie on each other took a minute and all memory."""
    with pytest.raises(MessageError, match="contradicts itself"):
        points_of(cloud(fields, step, row_step, (2**32 - 1, 1), bytes(4)))
    rows = np.arange(6, dtype="<f4").tobytes()  # of two points, and four bytes of nothing behind
    made = points_of(cloud([("f", 0, 7, 1)], 4, 12, (2, 2), rows[:20]))
    with pytest.raises(MessageError, match="2 rows of 4 bytes for 2 points of 4 bytes in 20 bytes"):
        points_of(cloud([("f", 0, 7, 1)], 4, 4, (2, 2), rows[:8] + bytes(12)[:12]))
    assert made["f"].tolist() == [0.0, 1.0, 3.0, 4.0]


@pytest.mark.parametrize("name", ["points", "forces", "moments", "taxels"])
def test_numbers_that_stop_a_machine_are_quiet_ones_in_wrenches_of_doubles(tmp_path, name):
    stop = np.frombuffer(b"\1\0\0\0\0\0\xf0\x7f", "<f8")[0]
    arrays = {one: np.eye(3) for one in ("points", "forces", "moments", "taxels")}
    arrays[name] = np.full((3, 3), stop)
    np.savez(tmp_path / "w.npz", frames=np.tile(np.eye(4), (3, 1, 1)), **arrays)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = read_wrenches(tmp_path / "w.npz")
    values = [getattr(found, one.name) for one in dataclasses.fields(found)]
    assert sum(np.isnan(one).all() for one in values if one is not None) == 1


def test_ports_of_thousands_of_digits_are_no_addresses():
    with pytest.raises(InvalidArrayError, match="is not an address"):
        parse_address("1" * 5000)
