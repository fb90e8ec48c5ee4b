"""Bags that others wrote, by the writer of the package rosbags, read by a mapping file."""

from __future__ import annotations

import numpy as np
import pytest
from click.testing import CliRunner
from rosbags import rosbag2, typesys

import skinmap
from skinmap.cli.collection import files_of
from skinmap.cli.main import cli
from skinmap.errors import DataFormatError, MissingFileError, SkinWarning, UnknownNameError
from skinmap.io.recordings.touch_files import read_recordings, recorded_robot
from skinmap.io.ros2.messages import Cloud
from skinmap.live.sources.open_source import open_track

STEPS = 20
MAPPING = """kind = "raw"
[[part]]
name = "palm"
topic = "/palm"
field = "force"
[[part]]
name = "finger"
topic = "/finger"
[[part]]
name = "arm"
topic = "/arm"
channels = [3, 1]
scale = 2.0
offset = 1.0
"""


@pytest.fixture(params=["SQLITE3", "MCAP"])
def bag(request, tmp_path):
    """A folder with a cloud, an image and an array a step, the image at half the rate."""
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    types = store.types
    folder = tmp_path / "run1"
    rng = np.random.default_rng(0)
    truth = {
        "palm": rng.normal(size=(STEPS, 6)).astype(np.float32),
        "finger": rng.integers(0, 65536, (STEPS, 4)).astype(np.uint16),
        "arm": rng.integers(0, 99, (STEPS, 5)).astype(np.float32),
    }
    fields = [("x", 0, 7), ("force", 8, 8)]

    def header(stamp):
        time = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
        return types["std_msgs/msg/Header"](stamp=time, frame_id="hand")

    def cloud(stamp, row):
        packed = np.zeros(6, np.dtype({"names": ["x", "force"], "offsets": [0, 8],
                                       "formats": ["<f4", "<f8"], "itemsize": 20}))  # fmt: skip
        packed["force"] = row
        point = types["sensor_msgs/msg/PointField"]
        return types["sensor_msgs/msg/PointCloud2"](
            header=header(stamp), height=2, width=3,
            fields=[point(name=n, offset=o, datatype=d, count=1) for n, o, d in fields],
            is_bigendian=False, point_step=20, row_step=60,
            data=np.frombuffer(packed.tobytes(), np.uint8), is_dense=True,
        )  # fmt: skip

    def image(stamp, row):
        pixels = np.zeros((2, 6), np.uint8)  # two bytes more in a row than it has pixels
        pixels[:, :4] = row.reshape(2, 2).astype(">u2").view(np.uint8).reshape(2, 4)
        return types["sensor_msgs/msg/Image"](
            header=header(stamp), height=2, width=2, encoding="mono16", is_bigendian=1, step=6,
            data=pixels.ravel(),
        )  # fmt: skip

    def array(stamp, row):
        layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
        return types["std_msgs/msg/Float32MultiArray"](layout=layout, data=row)

    kinds = {
        "palm": ("sensor_msgs/msg/PointCloud2", cloud, 1),
        "finger": ("sensor_msgs/msg/Image", image, 2),
        "arm": ("std_msgs/msg/Float32MultiArray", array, 1),
    }
    with rosbag2.Writer(
        folder, version=8, storage_plugin=rosbag2.StoragePlugin[request.param]
    ) as writer:
        for part, (kind, make, every) in kinds.items():
            connection = writer.add_connection(f"/{part}", kind, typestore=store)
            for step in range(0, STEPS, every):
                stamp = 5_000_000_000 + step * 20_000_000
                data = store.serialize_cdr(make(stamp, truth[part][step]), kind)
                writer.write(connection, stamp, data)
    (tmp_path / "run1.map.toml").write_text(MAPPING)
    return folder, truth


def test_every_value_comes_back(bag):
    folder, truth = bag
    track = open_track(folder)
    assert (track.parts, track.info.widths, track.kind) == (("palm", "finger", "arm"), (6, 4, 2),
                                                            "raw")  # fmt: skip
    steps = np.arange(STEPS - 1)  # the image ends one step before
    np.testing.assert_allclose(track.times, 5.0 + steps / 50, rtol=0, atol=1e-9)
    got = track.values[:]
    np.testing.assert_array_equal(got[:, :6], truth["palm"][steps])
    np.testing.assert_array_equal(got[:, 6:10], truth["finger"][steps - steps % 2])
    np.testing.assert_array_equal(got[:, 10:], 2.0 * truth["arm"][steps][:, [3, 1]] + 1.0)


def test_a_link_to_a_bag_may_have_a_mapping_of_its_own(bag, tmp_path):
    """It was passed over without a word: values came by the mapping beside the bag."""
    folder, _ = bag
    link = tmp_path / "again"
    link.symlink_to(folder)
    before = open_track(link).values[:]
    link.with_name("again.map.toml").write_text(MAPPING.replace("scale = 2", "scale = 4"))
    after = open_track(link).values[:]
    np.testing.assert_allclose(after[:, 10:] - 1.0, 2.0 * (before[:, 10:] - 1.0))
    np.testing.assert_array_equal(after[:, :10], before[:, :10])


def test_bare_file_of_a_bag_is_read_by_the_mapping_of_its_name(bag, tmp_path):
    folder, _ = bag
    (file,) = [one for one in folder.iterdir() if one.suffix in (".db3", ".mcap")]
    bare = tmp_path / f"touch{file.suffix}"
    bare.write_bytes(file.read_bytes())
    with pytest.raises((MissingFileError, DataFormatError), match=r"touch\.map\.toml"):
        open_track(bare)
    (tmp_path / "touch.map.toml").write_text(MAPPING)
    assert open_track(bare).values[:].shape == (STEPS - 1, 12)


@pytest.mark.parametrize(
    ("before", "after", "error", "said"),
    [
        ('topic = "/arm"', 'topic = "/leg"', UnknownNameError, "/leg.*/arm.*/palm"),
        ('field = "force"', 'field = "stress"', UnknownNameError, "stress.*force"),
        ("[3, 1]", "[3, 7]", DataFormatError, "channel 7 of /arm, it has 5"),
        ('name = "arm"', 'name = "palm"', DataFormatError, "each part once"),
        ("scale = 2.0", "scale = nan", DataFormatError, "finite"),
        ("scale = 2.0", "scales = 2.0", DataFormatError, "scales"),
        ("kind =", "kind", DataFormatError, "TOML"),
    ],
)
def test_wrong_mapping_is_named(bag, tmp_path, before, after, error, said):
    folder, _ = bag
    assert before in MAPPING
    (tmp_path / "run1.map.toml").write_text(MAPPING.replace(before, after))
    with pytest.raises(error, match=said):
        open_track(folder)


def test_damaged_bag_is_refused(bag):
    folder, _ = bag
    (file,) = [one for one in folder.iterdir() if one.suffix in (".db3", ".mcap")]
    data = bytearray(file.read_bytes())
    file.write_bytes(bytes(data[: len(data) // 3]))
    with pytest.raises(DataFormatError, match="not a bag that rosbags reads"):
        open_track(folder)


N = 6
COUNTED = np.add.outer(np.arange(200), np.arange(N)) % 251  # each sample counts itself
SECONDS = np.arange(200) / 50


def clouds(folder, stamps, log=100.0 + SECONDS, values=COUNTED, other=None):
    """A bag of a cloud a row, with stamps of its headers and times of the log [s], and its map.

    `other` are times and values of a second topic of arrays.
    """
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    made = Cloud("hand", np.zeros((N, 3)), "force")
    rows = [
        (t, "/palm", made.message(round(s * 1e9), row))
        for s, t, row in zip(stamps, log, values, strict=True)
    ]
    kinds = {"/palm": "sensor_msgs/msg/PointCloud2"}
    text = '[[part]]\nname = "palm"\ntopic = "/palm"\nfield = "force"\n'
    if other is not None:
        kinds["/arm"] = kind = "std_msgs/msg/Float32MultiArray"
        text += '[[part]]\nname = "arm"\ntopic = "/arm"\n'
        for time, (begin, row) in zip(*other, strict=True):
            layout = store.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=begin)
            data = np.concatenate([np.full(begin, 99.0), row]).astype(np.float32)
            message = store.types[kind](layout=layout, data=data)
            rows.append((time, "/arm", bytes(store.serialize_cdr(message, kind))))
    with rosbag2.Writer(folder, version=8) as writer:
        topics = {name: writer.add_connection(name, k, typestore=store)
                  for name, k in kinds.items()}  # fmt: skip
        for time, name, data in sorted(rows, key=lambda one: one[0]):
            writer.write(topics[name], round(time * 1e9), data)
    folder.with_name(f"{folder.name}.map.toml").write_text(text)
    return folder


def test_samples_that_share_a_stamp_all_come_back(tmp_path):
    track = open_track(clouds(tmp_path / "coarse", 7.0 + np.floor(SECONDS * 10 + 1e-9) / 10))
    np.testing.assert_array_equal(track.values[:], COUNTED)


def test_messages_that_came_twice_are_one_sample(tmp_path):
    twice = np.repeat(np.arange(200), 2)
    bag = clouds(tmp_path / "b", 7.0 + SECONDS[twice], 100.0 + SECONDS[twice], COUNTED[twice])
    with pytest.warns(SkinWarning, match="200 of 400 messages of 'palm' repeat stamp and values"):
        track = open_track(bag)
    np.testing.assert_array_equal(track.values[:], COUNTED)
    assert track.info.rate == pytest.approx(50.0)


def test_a_clock_that_begins_anew_is_refused_and_a_late_message_put_in_order(tmp_path):
    anew = np.where(SECONDS < 2, SECONDS, SECONDS - 1.99)
    with pytest.raises(DataFormatError, match=r"clock of .palm. began anew: sample 100 is 1\.97"):
        open_track(clouds(tmp_path / "anew", 7.0 + anew))
    late = np.r_[:50, 51:55, 50, 55:200]
    bag = clouds(tmp_path / "late", 7.0 + SECONDS[late], values=COUNTED[late])
    np.testing.assert_array_equal(open_track(bag).values[:], COUNTED)


def test_a_part_that_falls_silent_leaves_a_gap(tmp_path):
    on = (SECONDS < 1) | (SECONDS > 3)
    other = 100.0 + SECONDS, [(0, np.full(2, 5.0))] * 200
    bag = clouds(tmp_path / "b", 100.0 + SECONDS[on], 100.0 + SECONDS[on], COUNTED[on], other)
    with pytest.warns(SkinWarning, match="'palm' sent nothing at 98 of 200 samples"):
        track = open_track(bag)
    assert track.gaps == 1
    assert np.diff(track.times).max() == pytest.approx(1.98)


@pytest.mark.parametrize("wrong", ["unset", "negative", "constant"])
def test_one_clock_is_that_of_a_whole_topic(tmp_path, wrong):
    stamps = {"unset": np.where(np.arange(200) % 10 == 5, 0.0, 7.0 + SECONDS),
              "negative": SECONDS - 3.0, "constant": np.full(200, 7.0)}[wrong]  # fmt: skip
    with pytest.warns(SkinWarning, match="headers of 'palm' give no times"):
        track = open_track(clouds(tmp_path / "b", stamps))
    np.testing.assert_allclose(track.times, 100.0 + SECONDS, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(track.values[:], COUNTED)


def test_padding_is_skipped_and_messages_without_their_values_are_named(tmp_path):
    rows = [(4, np.array([1.0, 2.0]))] * 200
    rows[100], rows[120] = (4, np.array([1.0, np.nan])), (4, np.array([1.0]))
    bag = clouds(tmp_path / "b", 100.0 + SECONDS, other=(100.0 + SECONDS, rows))
    with pytest.warns(SkinWarning, match=r"2 of 200 messages of .arm. .*message 100, 2\.00 s"):
        track = open_track(bag)
    np.testing.assert_array_equal(track.values[:][:, N:], np.tile([1.0, 2.0], (200, 1)))
    text = (tmp_path / "b.map.toml").read_text() + "channels = [1, 1]"
    (tmp_path / "b.map.toml").write_text(text)
    with pytest.raises(DataFormatError, match="a channel given twice"):
        open_track(bag)


def run(*words):
    return CliRunner().invoke(cli, [str(word) for word in words], input="w\n")


def test_a_bag_is_a_recording_for_every_command(tmp_path):
    robot = skinmap.load_robot("kaspar")
    made = skinmap.simulate(robot.skin("torso"), gestures=["poke"], per_gesture=2, rng=0)
    skinmap.save_recordings(made, tmp_path / "a.mcap", robot=robot)
    bag, named = tmp_path / "bags" / "b", tmp_path / "n.npz"
    bag.parent.mkdir()
    assert run("export", tmp_path / "a.mcap", "--format", "rosbag2", "-o", bag).exit_code == 0
    assert len(open_track(bag).touches) == 2  # our own needs no mapping
    text = 'kind = "KIND"\nrobot = "kaspar"\n[[part]]\nname = "torso"\ntopic = "/skin/pressure"\n'
    for kind in ("raw", "pressure"):
        bag.with_name("b.map.toml").write_text(text.replace("KIND", kind))
        found = run("label", bag, "--name", "poke", "-o", named)
        assert (found.exit_code == 0) == (kind == "pressure"), found.output
        assert ("raw values only" in str(found.exception)) == (kind == "raw")  # before any name
    assert recorded_robot(bag) == "kaspar"
    np.testing.assert_array_equal(read_recordings(bag)[0].pressures, made.pressures)
    assert set(read_recordings(named)[0].labels) == {"poke"}
    assert files_of(tmp_path / "bags") == [bag]  # and not the file in it
    assert run("merge", bag, "-o", tmp_path / "m.npz").exit_code == 0
    other = tmp_path / "other" / "robot.toml"
    bag.with_name("b.map.toml").write_text(
        text.replace("KIND", "raw").replace("kaspar", "../other/robot.toml")
    )
    assert recorded_robot(bag) == str(other)
    bag.with_name("b.map.toml").unlink()
    (bag / "recording.mcap").rename(bag / "other.mcap")
    with pytest.warns(SkinWarning, match="without a mapping file"), pytest.raises(MissingFileError):
        files_of(tmp_path / "bags")


def test_bursts_are_no_silence_and_one_wrong_stamp_is_no_restart(tmp_path):
    from skinmap.io.recordings.dumper import at_shared_times

    times = np.arange(3000) / 100
    bursts = np.repeat(np.arange(1, 121) * 0.25, 25) + np.tile(np.arange(25) * 1e-4, 120)
    wrong = times + 5.0 * (np.arange(3000) == 1000)
    values = np.zeros((3000, 2), np.uint8)
    read = {"a": (times, values, None), "b": (bursts, values, None), "c": (wrong, values, None)}
    shared, _ = at_shared_times(read, tmp_path)
    assert len(shared) == 3000
