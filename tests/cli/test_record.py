"""Commands that record, play, describe and export."""

from __future__ import annotations

import json
import socket
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from click.testing import CliRunner
from mcap.reader import make_reader

from skinmap.cli.main import cli
from skinmap.cli.record import _mark_ended
from skinmap.errors import SkinError, SkinWarning
from skinmap.io.mcap.reading import read_track
from skinmap.io.recordings.touch_files import load_recordings
from skinmap.live.sources.source import Source, SourceEnded, StreamInfo
from skinmap.touch.recording import Recording, save_recordings
from skinmap.touch.recording import load_recordings as load_archive


def run(*words: object) -> dict:
    result = CliRunner().invoke(cli, [*map(str, words), "--json"], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def refuse(*words: object) -> str:
    """The one line that a command says where it cannot go on."""
    result = CliRunner().invoke(cli, [*map(str, words)])
    assert isinstance(result.exception, SkinError | SystemExit)
    text = result.output if isinstance(result.exception, SystemExit) else str(result.exception)
    return " ".join(text.split())


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Six seconds of simulated touches on two parts, marked with one name."""
    path = tmp_path_factory.mktemp("record") / "t.mcap"
    told = run("record", "sim", "-o", path, "--part", "left_hand", "--part", "left_foot",
               "--seconds", 6, "--speed", "inf", "--label", "poke")  # fmt: skip
    assert told["samples"] == 300
    assert told["dropped"] == 0
    assert told["files"] == [str(path)]
    assert told["bytes"] == path.stat().st_size
    return path


def test_info_prints_exactly_the_promised_keys(recording, icub):
    told = run("info", recording)
    keys = [
        "samples",
        "seconds",
        "channels",
        "rate_hz",
        "gaps",
        "recovered",
        "lost_seconds",
        "skin",
    ]
    assert list(told) == keys
    taxels = len(icub.skin("left_hand")) + len(icub.skin("left_foot"))
    assert (told["samples"], told["seconds"], told["rate_hz"], told["gaps"]) == (300, 6.0, 50.0, 0)
    assert told["channels"] == told["skin"]["taxels"] == taxels
    assert (told["recovered"], told["lost_seconds"]) == (False, 0.0)
    assert told["skin"]["parts"] == ["left_hand", "left_foot"]
    assert told["skin"]["robot"] == "iCub"
    assert all(len(one) == 64 for one in told["skin"]["fingerprints"].values())


def test_info_recovers_a_cut_file_without_being_asked(recording, tmp_path):
    (tmp_path / "cut.mcap").write_bytes(recording.read_bytes()[:-60_000])
    told = run("info", tmp_path / "cut.mcap")
    assert 0 < told["samples"] < 300
    assert told["recovered"]
    assert told["lost_seconds"] > 0
    result = CliRunner().invoke(cli, ["info", str(tmp_path / "cut.mcap")])
    assert "recovered;" in result.output


def test_touches_are_marked_where_the_skin_was_touched(recording):
    track = read_track(recording)
    assert len(track.touches) >= 3
    assert {one.label for one in track.touches} == {"poke"}
    values = track.values[:]
    for one in track.touches:
        touched = values[one.first : one.last + 1, track.columns(one.part)]
        assert (touched > 12).any(axis=1).mean() > 0.5
    assert sum(len(one.labels) for one in load_recordings(recording)) >= 3


def test_record_of_raw_values_with_a_label_has_pressures_too(tmp_path):
    path = tmp_path / "t.mcap"
    run("record", "sim:raw", "-o", path, "--part", "left_hand", "--seconds", 5, "--speed", "inf",
        "--label", "rub")  # fmt: skip
    raw, pressure = read_track(path, kind="raw"), read_track(path)
    assert (raw.kind, pressure.kind) == ("raw", "pressure")
    assert len(raw.times) == len(pressure.times) == 250
    assert raw.values[:].mean() > 200  # 240 at rest, lower is harder
    assert pressure.values[:].mean() < 20


def test_a_recording_that_refused_every_sample_fails(tmp_path, monkeypatch, icub):
    class Refusing(Source):
        def read(self, timeout):
            self.counts.refused = 159
            raise SourceEnded

        def close(self):
            pass

    info = StreamInfo("t", ("left_hand",), (48,), 50.0)
    monkeypatch.setattr(
        "skinmap.commands.options.open_stream", lambda *_, **__: (icub, Refusing(info))
    )
    said = refuse("record", "zmq:5555", "-o", tmp_path / "t.mcap")
    assert said == "zmq:5555 sent nothing that can be recorded: 159 messages refused"
    assert not (tmp_path / "t.mcap").exists()


def test_record_replaces_files_only_with_force(tmp_path):
    """And then those of this recording alone: a name like those of its files is not enough."""
    for name in ("t.mcap", "t_0002.mcap"):
        (tmp_path / name).write_bytes(b"precious")
    words = ("record", "sim", "-o", tmp_path / "t.mcap", "--part", "torso", "--seconds", 1,
             "--speed", "inf")  # fmt: skip
    assert "is there already; --force replaces it" in refuse(*words)
    assert all(one.read_bytes() == b"precious" for one in tmp_path.iterdir())
    assert run(*words, "--force")["samples"] == 50
    assert (tmp_path / "t_0002.mcap").read_bytes() == b"precious"


def test_record_never_writes_into_what_it_plays(recording):
    before = recording.read_bytes()
    assert "it is the recording being played" in refuse(
        "record", recording, "-o", recording, "--force"
    )
    assert recording.read_bytes() == before


def test_touches_that_nobody_could_name_are_not_marked():
    heard, counted = [], []
    recorder = SimpleNamespace(mark=lambda *words, **_: heard.append(words))
    shown = SimpleNamespace(add=lambda label: counted.append(label), withdrawn=0)
    names = ["poke", "touch", "unknown", "no_contact"]
    over = [
        SimpleNamespace(
            part="a",
            identity=row,
            label=name,
            began=0.0,
            ended=1.0,
            channels=(7,),
            answers=None,
            unfinished=False,
        )
        for row, name in enumerate(names)
    ]
    loop = SimpleNamespace(finished=lambda: over, withdrawn=lambda: [object()])
    _mark_ended(loop, recorder, shown)
    assert shown.withdrawn == 1
    assert heard == [("a", 0, "poke")]
    assert counted == ["poke"]


def test_marks_are_the_touches_that_classify_sees(tmp_path):
    """A hand makes many contacts and is one touch; most contacts alone would be `no_contact`."""
    words = ["sim", "--part", "torso", "--seconds", 30, "--speed", "inf", "-o"]
    told = run("record", *words, tmp_path / "marked.mcap", "--label", "rub", "--person", "ada")
    run("record", *words, tmp_path / "plain.mcap")
    run("simulate", "icub", "--part", "torso", "--per-gesture", 12, "-o", tmp_path / "t.npz",
        "--variety", "none")  # fmt: skip
    run("train", tmp_path / "t.npz", "-o", tmp_path / "m.skinmodel")
    lines = [
        json.loads(line)
        for line in CliRunner()
        .invoke(
            cli, ["classify", str(tmp_path / "m.skinmodel"), str(tmp_path / "plain.mcap"), "--json"]
        )
        .stdout.splitlines()
    ]
    track = read_track(tmp_path / "marked.mcap")
    spans = [(track.times[one.first], track.times[one.last]) for one in track.touches]
    cut = [one for one in lines[:-1] if one["unfinished"]]  # by the end of the recording
    whole = [one for one in lines[:-1] if not one["unfinished"]]
    seen = [(one["start_s"], one["start_s"] + one["duration_s"]) for one in whole]
    assert len(cut) == 1
    np.testing.assert_allclose(sorted(spans), sorted(seen), rtol=0, atol=1e-9)
    assert told["touches"] == {"rub": len(seen)}
    assert len(seen) + len(cut) == lines[-1]["touches"] >= 10
    assert {(one.session, one.person) for one in track.touches} == {("", "ada")}
    again = run("classify", tmp_path / "m.skinmodel", tmp_path / "marked.mcap")
    assert again["events"] == len(seen)
    assert "no_contact" not in {one["label"] for one in again["touches"]}


@pytest.mark.parametrize("label", ["", "  ", "a\tb", "a\x00", "unknown", "poke+rub", "x" * 65])
def test_labels_that_nobody_can_use_are_refused_before_anything_is_written(tmp_path, label):
    message = refuse("record", "sim", "-o", tmp_path / "t.mcap", "--label", label)
    assert "label" in message or "classifiers" in message or "joins" in message
    assert not list(tmp_path.iterdir())


def test_export_makes_a_cut_file_whole_for_every_reader(recording, tmp_path):
    cut, whole = tmp_path / "cut.mcap", tmp_path / "whole.mcap"
    cut.write_bytes(recording.read_bytes()[:-60_000])
    told = run("export", cut, "-o", whole)
    before, after = run("info", cut), run("info", whole)
    assert told["samples"] == before["samples"] > 0
    assert after == before  # also that something was lost, and how much
    np.testing.assert_array_equal(read_track(whole).values[:], read_track(cut).values[:])
    assert read_track(whole).touches == read_track(cut).touches
    with whole.open("rb") as file:
        reader = make_reader(file)
        counts = reader.get_summary().statistics.channel_message_counts.values()
        assert sum(1 for _ in reader.iter_messages()) == sum(counts)


def test_export_of_a_whole_recording_changes_nothing(recording, tmp_path):
    run("export", recording, "-o", tmp_path / "copy.mcap")
    assert run("info", tmp_path / "copy.mcap") == run("info", recording)


def test_replay_publishes_all_samples(recording):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    told = run("replay", recording, "--speed", "inf", "--publish", f"zmq:{port}")
    assert told["samples"] == 300


def test_replay_of_a_loop_ends_when_it_is_told_to(recording):
    assert run("replay", recording, "--loop", "--speed", "inf", "--seconds", 1e-9)["samples"] == 0


@pytest.mark.parametrize("suffix", [".h5", ".npz"])
def test_export_gives_arrays_for_machine_learning(recording, tmp_path, icub, suffix):
    path = tmp_path / f"t{suffix}"
    told = run("export", recording, "-o", path)
    assert (told["kind"], told["samples"], told["format"]) == ("pressure", 300, suffix[1:])
    track = read_track(recording)
    arrays = h5py.File(path) if suffix == ".h5" else np.load(path)
    np.testing.assert_array_equal(arrays["times"][:], track.times)
    skin = icub.skin("left_foot")
    np.testing.assert_array_equal(arrays["left_foot/positions"][:], skin.positions)
    np.testing.assert_array_equal(
        arrays["left_foot/values"][:], track.values[:][:, track.columns("left_foot")]
    )
    one = next(each for each in load_recordings(recording) if each.part == "left_foot")
    np.testing.assert_array_equal(arrays["left_foot/events"][:], one.events)
    labels = arrays["left_foot/labels"]
    found = labels.asstr()[:].tolist() if suffix == ".h5" else labels.tolist()
    assert tuple(found) == one.labels
    arrays.close()


def test_simulate_train_and_classify_read_and_write_mcap(tmp_path):
    path, other = tmp_path / "t.mcap", tmp_path / "t.npz"
    words = ["simulate", "icub", "--part", "left_foot", "--per-gesture", 12, "--seed", 3, "-o"]
    run(*words, path)
    run(*words, other)
    (one,), (same,) = load_recordings(path), load_archive(other)
    np.testing.assert_array_equal(one.pressures, same.pressures)
    np.testing.assert_array_equal(one.events, same.events)
    model = tmp_path / "m.skinmodel"
    assert run("train", path, "-o", model)["touches"] > 10
    assert run("classify", model, path)["events"] == len(one.labels)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("record", "sim", "-o", "t.npz"), "files ending in '.npz'; the only format is .mcap"),
        (("record", "sim", "-o", "gone/t.mcap"), "cannot write 'gone/t.mcap'"),
        (("record", "nothing", "-o", "t.mcap"), "no source 'nothing'; the sources are"),
        (("record", "gone.mcap", "-o", "t.mcap"), "no file 'gone.mcap'"),
        (("record", "sim", "-o", "t.mcap", "--label", "a", "--model", "m"), "give one"),
        (("record", "sim", "-o", "t.mcap", "--model", "gone"), "no file 'gone'"),
        (("record", "sim", "-o", "t.mcap", "--part", "tail"), "no part 'tail'"),
        (("info", "gone.mcap"), "no file 'gone.mcap'; expected a recording"),
        (("info", "empty.mcap"), "empty.mcap: an empty file"),
        (("info", "text.mcap"), "text.mcap: not an MCAP file"),
        (("info", "text.wav"), "no reader of recordings for 'text.wav'"),
        (("replay", "text.mcap"), "text.mcap: not an MCAP file"),
        (("replay", "good.mcap", "--publish", "post:x"), "no way to publish 'post'"),
        (
            ("export", "good.mcap", "-o", "t.wav"),
            "files ending in '.wav'; the formats are: .h5, .hdf5",
        ),
        (("export", "good.mcap", "-o", "t.h5", "--part", "a"), "a recording is written whole"),
        (
            ("simulate", "icub", "-o", "t.wav"),
            "files ending in '.wav'; the recording formats are: .npz, .mcap",
        ),
        (("train", "text.mcap"), "text.mcap: not an MCAP file"),
        (("info", "good.mcap", "--robot", "kaspar"), "48 channels for 'left_hand'; its 144"),
    ],
)
def test_commands_say_what_is_wrong_and_leave_nothing(
    tmp_path, monkeypatch, recording, words, message
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty.mcap").touch()
    for name in ("text.mcap", "text.wav"):
        (tmp_path / name).write_text("no recording")
    (tmp_path / "good.mcap").write_bytes(recording.read_bytes())
    before = sorted(tmp_path.iterdir())
    assert message in refuse(*words)
    assert sorted(tmp_path.iterdir()) == before


def test_record_warns_in_a_line_of_a_fault_that_falsifies(tmp_path):
    rng = np.random.default_rng(0)
    values = rng.normal(100, 3, (400, 240))
    values[:, 7] = values[:, 5]
    own = Recording("torso", np.arange(400) / 50, values.astype(np.uint8), np.full(400, -1), ())
    save_recordings([own], tmp_path / "t.npz")
    words = ["record", str(tmp_path / "t.npz"), "--robot", "kaspar", "--part", "torso"]
    with pytest.warns(SkinWarning, match="5 and 7 carry the same signal.*skinmap examine"):
        result = CliRunner().invoke(cli, [*words, "-o", str(tmp_path / "t.mcap"), "--speed", "inf"])
    assert result.exit_code == 0, result.output


def test_info_of_a_gap_gives_the_seconds_of_samples_beside_those_of_the_clock():
    from skinmap.cli import info

    skin = info.RecordedSkin(robot="zoo", parts=["plate"], taxels=280, fingerprints={})
    told = info.RecordingInfo(
        samples=800, seconds=20.0, channels=280, rate_hz=50.0, gaps=1, recovered=False,
        lost_seconds=0.0, skin=skin,
    )  # fmt: skip
    (line, *_) = info._lines(told, info.Counter(), [])
    assert line.endswith("channels, 16.0 s of samples in 20.00 s (50 a second), 1 gap")
