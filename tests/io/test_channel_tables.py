"""Recordings of others: tables, arrays and CySkin's text give the same as was written."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

import skinmap
from skinmap.cli.main import cli
from skinmap.errors import DataFormatError, MissingFileError, SkinWarning
from skinmap.io.recordings.touch_files import read_recordings, recording_readers
from skinmap.soundness.track import read_track
from skinmap.touch.recording import Recording

ROBOT, PART = "kaspar", "left_hand"
MAPPING = f'robot = "{ROBOT}"\npart = "{PART}"\n'
SAMPLES = 40


@pytest.fixture(scope="module")
def channels():
    return skinmap.load_robot(ROBOT).skin(PART).channels


@pytest.fixture(scope="module")
def values(channels):
    """Whole counts of every channel of the skin."""
    return np.random.default_rng(0).integers(0, 256, (SAMPLES, len(channels)))


def write_csv(path, channels, values, *, times=None, extra=()):
    """A table as people have it; `extra` are (name, column) pairs."""
    times = np.arange(len(values)) / 10 if times is None else times
    head = ["time", *(f"ch{k}" for k in channels), *(name for name, _ in extra)]
    rows = [
        [f"{t}", *map(str, row), *(str(column[k]) for _, column in extra)]
        for k, (t, row) in enumerate(zip(times, values, strict=True))
    ]
    path.write_text("\n".join(",".join(row) for row in [head, *rows]))


def written(folder, form, channels, values):
    """The same values in one of the forms, marked as one touch `poke`."""
    mapping = MAPPING + 'label = "poke"\n'
    if form == "csv":
        write_csv(folder / "t.csv", channels, values)
        path = folder / "t.csv"
    elif form == "npz":
        path = folder / "t.npz"
        np.savez(path, values=values, times=np.arange(len(values)) / 10, channels=channels)
    else:
        path = folder / "t.txt"
        pairs = form == "cyskin-pairs"
        rows = [
            f"{k} {k / 10:.6f} "
            + " ".join(f"{c} {x}" if pairs else str(x) for c, x in zip(channels, row, strict=True))
            for k, row in enumerate(values)
        ]
        path.write_text("\n".join(rows if pairs else [" ".join(map(str, channels)), *rows]))
    path.with_suffix(".toml").write_text(mapping)
    return path


@pytest.mark.parametrize("form", ["csv", "npz", "cyskin-ids", "cyskin-pairs"])
def test_every_form_gives_what_was_written(tmp_path, channels, values, form):
    """The contract of a reader: our recording of the skin, its times, its values, its label."""
    (one,) = read_recordings(written(tmp_path, form, channels, values))
    assert isinstance(one, Recording)
    assert (one.part, one.robot, one.labels) == (PART, ROBOT, ("poke",))
    np.testing.assert_array_equal(one.pressures, values)
    np.testing.assert_allclose(one.times, np.arange(SAMPLES) / 10, rtol=0, atol=1e-9)
    assert (one.events == 0).all()


def test_readers_are_plug_ins_by_name(tmp_path, channels, values):
    assert {"table", "arrays", "cyskin"} <= set(recording_readers.names())
    path = written(tmp_path, "cyskin-ids", channels, values)
    data = path.rename(tmp_path / "t.dat")
    (one,) = read_recordings(data, format="cyskin")
    np.testing.assert_array_equal(one.pressures, values)


def test_rest_is_taken_away_and_saturation_cut_off(tmp_path, channels):
    raw = np.full((SAMPLES, len(channels)), 300)
    raw[10:14] += 20_002
    raw[20:24, 0] = 43_500  # an error code of one sensor
    path = written(tmp_path, "cyskin-ids", channels, raw)
    path.with_suffix(".toml").write_text(MAPPING + "rest_percentile = 25\nfull_scale = 10000\n")
    (one,) = read_recordings(path)
    assert (one.pressures[10:14] == 255).all()
    assert not one.pressures[:10].any()
    assert not one.pressures[20:24].any()


def test_channels_and_places_that_do_not_meet_are_told_and_left_out(tmp_path, channels, values):
    path = tmp_path / "t.csv"
    strange = np.concatenate([channels[5:], channels.max() + np.arange(1, 4)])
    write_csv(path, strange, np.column_stack([values[:, 5:], values[:, :3]]))
    path.with_suffix(".toml").write_text(MAPPING)
    with pytest.warns(SkinWarning, match="3 channels without a place were left out, 5 places"):
        (one,) = read_recordings(path)
    assert not one.pressures[:, :5].any()
    np.testing.assert_array_equal(one.pressures[:, 5:], values[:, 5:])


def test_labels_of_samples_become_touches(tmp_path, channels, values):
    words = ["", "poke", "poke", "", "rub", "rub", "rub", "poke"] + [""] * (SAMPLES - 8)
    people = ["ada"] * 4 + ["ben"] * (SAMPLES - 4)
    write_csv(tmp_path / "t.csv", channels, values, extra=[("gesture", words), ("who", people)])
    (tmp_path / "mapping.toml").write_text(
        MAPPING + 'label_column = "gesture"\nperson_column = "who"\nsession = "day"\n'
    )
    (one,) = read_recordings(tmp_path / "t.csv")
    assert one.events[:9].tolist() == [-1, 0, 0, -1, 1, 1, 1, 2, -1]
    assert one.labels == ("poke", "rub", "poke")
    assert (one.people, one.sessions) == (("ada", "ben", "ben"), ("day",) * 3)


def test_files_joined_in_an_npz_have_a_rest_and_a_time_of_their_own(tmp_path, channels):
    first, second = (np.full((10, len(channels)), level) for level in (40, 90))
    first[4:6] += 100
    np.savez(tmp_path / "t.npz", values=np.concatenate([first, second]), taxel_ids=channels,
             times=np.tile(np.arange(10) / 10, 2), file_index=np.repeat([0, 1], 10),
             file_class=np.array([1, 0]))  # fmt: skip
    (tmp_path / "t.toml").write_text(MAPPING + "rest_percentile = 25\n")
    (one,) = read_recordings(tmp_path / "t.npz")
    assert one.labels == ("1", "0")
    assert (np.diff(one.times) > 0).all()
    assert (one.pressures[4:6] == 100).all()
    assert not one.pressures[10:].any()


def refused(tmp_path, text, *, mapping=MAPPING, match=".", name="t.csv"):
    (tmp_path / name).write_text(text)
    (tmp_path / name).with_suffix(".toml").write_text(mapping)
    with pytest.raises(DataFormatError, match=match):
        read_recordings(tmp_path / name)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("time,ch0,ch0\n0,1,2\n", "columns given twice: ch0"),
        ("time,ch0,x0\n0,1,2\n", "channels given twice: 0"),
        ("time,ch0\n0,1\n0.2,1\n0.1,1\n", "out of order: sample 2 at 0.1 s comes after 0.2 s"),
        (
            "time,ch0\n1700000000.2,1\n1700000000.1,1\n",
            "at 1700000000.1 s comes after 1700000000.2 s",
        ),
        ("time,ch0\n0,nan\n", "sample 0 holds no number at channel 0"),
        ("time,ch0\n0,much\n", "sample 0 holds 'much', no number"),
        ("# made\n\ntime,ch0,ch1\n0,1,2\n1,2,\n", r"sample 1 holds '', .* 'ch1' \(line 5\)"),
        ("time,ch0\n0,1,2\n", "sample 0 has 3 values for 2 columns"),
        ("time,load\n0,1\n", "columns without a channel's number: load"),
        ("when,ch0\n0,1\n", "no column 'time'"),
        ("time,ch99999\n0,1\n", "another skin"),
        ("time,ch0\n", "no samples"),
    ],
)
def test_tables_that_do_not_fit_are_refused_in_one_line(tmp_path, text, match):
    mapping = MAPPING + 'label = "poke"\n'
    if text.startswith("when"):
        mapping += "channels = {ch0 = 0}\n"
    refused(tmp_path, text, mapping=mapping, match=match)


@pytest.mark.parametrize(
    ("mapping", "match"),
    [
        ('robot = "kaspar"\n', "part"),
        (MAPPING + "colour = 3\n", "colour"),
        (MAPPING + "full_scale = 0\n", "full_scale"),
        (MAPPING + 'label = "unknown"\n', "the answer of classifiers"),
        ("robot =", "not a mapping"),
    ],
)
def test_mappings_that_are_wrong_name_the_key(tmp_path, mapping, match):
    refused(tmp_path, "time,ch0\n0,1\n", mapping=mapping, match=match)


def test_a_table_without_a_mapping_says_what_it_needs(tmp_path):
    (tmp_path / "t.csv").write_text("time,ch0\n0,1\n")
    with pytest.raises(
        MissingFileError, match=r'the robot and the part .* robot = "icub" and part'
    ):
        read_recordings(tmp_path / "t.csv")


def test_arrays_of_others_are_told_from_ours_by_what_they_hold(tmp_path, channels, values):
    named = written(tmp_path, "npz", channels, values)
    named.with_suffix(".toml").rename(tmp_path / "mapping.toml")
    (one,) = read_recordings(named)
    assert one.labels == ("poke",)
    ours = tmp_path / "ours.npz"
    skinmap.save_recordings(one, ours)
    assert read_recordings(ours)[0].labels == ("poke",)
    ours.with_suffix(".toml").write_text((tmp_path / "mapping.toml").read_text())
    assert read_recordings(ours)[0].labels == ("poke",), "it needs no mapping"
    result = CliRunner().invoke(cli, ["classify", str(named), "--json"])
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["events"] == 1
    (tmp_path / "mapping.toml").unlink()
    with pytest.raises(MissingFileError, match=r"a mapping that names the robot and the part"):
        read_recordings(named)


def test_arrays_of_others_may_be_of_a_head(tmp_path, channels, values):
    named = written(tmp_path, "npz", channels, values)
    with np.load(named) as arrays:
        held = {**arrays, "head": np.zeros(3)}
    np.savez(named, **held)
    assert read_recordings(named)[0].labels == ("poke",)
    assert skinmap.load_recordings(named)[0].labels == ("poke",)
    assert len(skinmap.open_source(named, speed=float("inf")).read(1.0)) > 0


@pytest.mark.parametrize("read", [read_recordings, skinmap.load_recordings, skinmap.open_source])
def test_a_damaged_archive_is_what_the_mapping_beside_it_says(tmp_path, read):
    (tmp_path / "t.toml").write_text(MAPPING)
    (tmp_path / "t.npz").write_bytes(b"PK no archive")
    with pytest.raises(DataFormatError, match="not an NPZ of channels over time"):
        read(tmp_path / "t.npz")


def test_a_table_with_a_mapping_is_a_recording_to_every_command(tmp_path, channels, values):
    label = ["" if k < 20 else "poke" for k in range(SAMPLES)]
    quiet = np.where(np.arange(SAMPLES)[:, None] < 20, 0, values)
    write_csv(tmp_path / "t.csv", channels, quiet, extra=[("what", label)])
    (tmp_path / "mapping.toml").write_text(MAPPING + 'label_column = "what"\n')
    run = CliRunner().invoke
    named = run(cli, ["classify", str(tmp_path / "t.csv"), "--json"])
    assert json.loads(named.stdout)["events"] == 1
    examined = run(cli, ["examine", str(tmp_path / "t.csv"), "--json"])
    (file,) = json.loads(examined.stdout)["files"]
    assert file["channels"] == len(channels)
    table, folder = str(tmp_path / "t.csv"), str(tmp_path)
    for words in (
        ["export", folder, "--format", "touched", "-o", f"{folder}/o.csv"],
        ["export", table, "--format", "contacts", "-o", f"{folder}/c.csv"],
        ["view", table, "--screenshot", f"{folder}/t.png"],
    ):
        result = run(cli, words)
        assert result.exit_code == 0, result.output


def test_a_manifest_beside_a_table_is_no_mapping(tmp_path, channels, values):
    write_csv(tmp_path / "t.csv", channels, values)
    (tmp_path / "t.toml").write_text('[robot]\nname = "own"\nmesh = "t.stl"\n')
    run = CliRunner().invoke
    assert run(cli, ["examine", str(tmp_path / "t.csv")]).exit_code == 0
    (tmp_path / "mapping.toml").write_text(MAPPING + 'label = "poke"\n')
    assert read_recordings(tmp_path / "t.csv")[0].labels == ("poke",)


def test_a_table_is_examined_as_its_mapping_reads_it(tmp_path, channels, values):
    """Its own names of time and events, milliseconds of Unix, and a column that is no channel."""
    times = 1.7e12 + 100 * np.arange(SAMPLES)
    table = tmp_path / "t.csv"
    extra = [("heat", np.full(SAMPLES, 31)), ("touch_no", np.arange(SAMPLES) // 20)]
    write_csv(table, channels, values, extra=extra)
    table.write_text(table.read_text().replace("time", "stamp_ms", 1))
    lines = table.read_text().splitlines()
    rows = [f"{t:.0f},{line.split(',', 1)[1]}" for t, line in zip(times, lines[1:], strict=True)]
    table.write_text("\n".join([lines[0], *rows]))
    table.with_suffix(".toml").write_text(
        MAPPING + 'time = "stamp_ms"\ntime_unit = "ms"\nevent_column = "touch_no"\n[channels]\n'
        + "".join(f"ch{k} = {k}\n" for k in channels)
    )  # fmt: skip
    track = read_track(table)
    assert track.values.shape == values.shape
    assert track.unit == ""
    np.testing.assert_allclose(np.diff(track.times), 0.1, rtol=0, atol=1e-6)
    assert np.array_equal(track.events, np.arange(SAMPLES) // 20)


def test_a_recording_of_others_is_exported(tmp_path, channels, values):
    h5py = pytest.importorskip("h5py")
    path, out = written(tmp_path, "csv", channels, values), tmp_path / "t.h5"
    done = CliRunner().invoke(cli, ["export", str(path), "-o", str(out)])
    assert done.exit_code == 0, done.output
    with h5py.File(out) as file:
        rows = np.argsort(np.argsort(channels))
        held = file[f"{PART}/values"][()]
        assert held.shape == values.shape
        skin = skinmap.load_robot("kaspar").skin(PART)
        np.testing.assert_array_equal(file[f"{PART}/positions"][()], skin.positions)
        assert np.array_equal(held[:, np.argsort(rows)], values[:, np.argsort(channels)])


def test_arrays_without_times_need_a_rate(tmp_path, channels, values):
    path = tmp_path / "t.npz"
    np.savez(path, values=values, channels=channels)
    path.with_suffix(".toml").write_text(MAPPING)
    with pytest.raises(DataFormatError, match="no `times`"):
        read_recordings(path)
    path.with_suffix(".toml").write_text(MAPPING + 'rate_hz = 20\ntime_unit = "ms"\n')
    (recording,) = read_recordings(path)
    np.testing.assert_allclose(np.diff(recording.times), 0.05)


@pytest.mark.parametrize(
    ("scale", "more", "match"),
    [
        (-16.0, "", "no pressure lies above 0"),
        (1.0, "falling = true\n", "no pressure lies above 0"),
        (1 / 255, "", "the largest pressure is 1 of 255 counts"),
        (16.0, "", "values reach 4080, and 255 counts are the most"),
    ],
)
def test_a_mapping_that_loses_the_pressures_is_warned_of(tmp_path, channels, scale, more, match):
    values = np.tile(np.linspace(0, 255, SAMPLES)[:, None], (1, len(channels)))
    path = tmp_path / "t.npz"
    np.savez(path, values=scale * values, times=np.arange(SAMPLES) / 10, channels=channels)
    path.with_suffix(".toml").write_text(MAPPING + more)
    with pytest.warns(SkinWarning, match=match):
        read_recordings(path)


@pytest.mark.parametrize("rest", [40, 240])
def test_a_skin_that_never_reads_nothing_is_warned_of(tmp_path, channels, rest):
    rng = np.random.default_rng(3)
    values = np.rint(rest + rng.normal(scale=1.0, size=(400, len(channels)))).astype(int)
    path = tmp_path / "t.npz"
    np.savez(path, values=values, times=np.arange(400) / 50, channels=channels)
    path.with_suffix(".toml").write_text(MAPPING)
    with pytest.warns(SkinWarning, match=rf"never reads less than {rest - 2} .*rest_percentile"):
        read_recordings(path)


@pytest.mark.parametrize("split", [";", "\t"])
def test_decimal_commas_are_read_where_other_signs_separate_columns(tmp_path, channels, split):
    rows = [f"{k / 50:.2f}".replace(".", ",") + split + split.join(["7,0"] * len(channels))
            for k in range(8)]  # fmt: skip
    head = split.join(["time", *(f"ch{k}" for k in channels)])
    path = tmp_path / "t.csv"
    path.write_text("\n".join([head, *rows]))
    path.with_suffix(".toml").write_text(MAPPING)
    (one,) = read_recordings(path)
    assert (one.pressures == 7).all()
    np.testing.assert_allclose(one.times, np.arange(8) / 50)


def test_nanoseconds_since_1970_keep_their_steps(tmp_path, channels, values):
    path = tmp_path / "t.csv"
    write_csv(
        path, channels, values, times=1_764_378_000_000_000_000 + 20_000_000 * np.arange(SAMPLES)
    )
    path.with_suffix(".toml").write_text(MAPPING + 'time_unit = "ns"\n')
    np.testing.assert_allclose(np.diff(read_recordings(path)[0].times), 0.02, atol=1e-6)


def test_steps_of_any_length_have_no_gaps(tmp_path, channels, values):
    path = tmp_path / "t.csv"
    steps = np.random.default_rng(0).uniform(0.01, 0.04, SAMPLES)
    for times, gaps in ((np.cumsum(steps), None), (np.arange(SAMPLES) / 50, 0)):
        write_csv(path, channels, values, times=times)
        path.with_suffix(".toml").write_text(MAPPING)
        told = CliRunner().invoke(cli, ["info", str(path), "--json"])
        assert json.loads(told.stdout)["gaps"] == gaps
    late = np.arange(SAMPLES) / 50 + (np.arange(SAMPLES) >= SAMPLES // 2)
    write_csv(path, channels, values, times=late)
    assert "1 gap" in CliRunner().invoke(cli, ["info", str(path)]).stdout


def test_times_in_another_unit_and_channels_from_one_are_named(tmp_path, channels, values):
    path = tmp_path / "t.csv"
    write_csv(path, channels, values, times=20.0 * np.arange(SAMPLES))
    path.with_suffix(".toml").write_text(MAPPING)
    with pytest.warns(SkinWarning, match="a sample every 20 s; see time_unit"):
        read_recordings(path)
    write_csv(path, channels + 1, values)
    with pytest.warns(SkinWarning, match="may count from 1"):
        read_recordings(path)


def test_channels_are_matched_by_what_they_number(tmp_path):
    skin = skinmap.load_robot("ur10e-cyskin").skin("forearm_1")
    values = np.random.default_rng(1).integers(0, 200, (SAMPLES, len(skin)))
    path = tmp_path / "t.npz"
    path.with_suffix(".toml").write_text('robot = "ur10e-cyskin"\npart = "forearm_1"\n')
    for names in ({"channels": skin.channels}, {}):  # {}: in the order of the taxel table
        np.savez(path, values=values, times=np.arange(SAMPLES) / 10, **names)
        (one,) = read_recordings(path)
        np.testing.assert_array_equal(one.pressures, values)


def test_decimal_commas_need_no_header(tmp_path, channels):
    path = tmp_path / "t.csv"
    path.write_text("\n".join(f"0,{k};" + ";".join(["7,5"] * len(channels)) for k in range(3)))
    names = ", ".join(f'"ch{k}"' for k in channels)
    path.with_suffix(".toml").write_text(MAPPING + f'columns = ["time", {names}]\n')
    (one,) = read_recordings(path)
    assert (one.pressures == 8).all()
    np.testing.assert_allclose(one.times, [0.0, 0.1, 0.2])


def test_parts_that_lost_samples_play_beside_each_other(tmp_path):
    """A part that lost some samples was refused beside another."""
    from skinmap.live.sources.open_source import open_track
    from skinmap.touch.recording import Recording, save_recordings

    times, lost = np.arange(200) / 50, np.array([20, 90, 91])
    values = np.arange(200, dtype=np.uint8)[:, None].repeat(3, axis=1)
    whole = Recording("a", times, values, np.full(200, -1), ())
    few = Recording("b", np.delete(times, lost), np.delete(values, lost, axis=0),
                    np.full(197, -1), ())  # fmt: skip
    save_recordings([whole, few], tmp_path / "t.npz")
    track = open_track(tmp_path / "t.npz")
    expected = values[:, 0].copy()
    expected[[20, 90, 91]] = 19, 89, 89
    np.testing.assert_array_equal(track.values[:][:, 3], expected)


def test_a_mapping_beside_arrays_is_used_in_python_and_passed_over_in_a_pattern(
    tmp_path, channels, values
):
    named = written(tmp_path, "npz", channels, values)
    assert skinmap.load_recordings(named)[0].labels == ("poke",)
    result = CliRunner().invoke(cli, ["train", *map(str, sorted(tmp_path.glob("t.*")))])
    assert "two labels or more; marked are: 1 poke" in str(result.exception)
