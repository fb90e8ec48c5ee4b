"""Recording: queue, thread, rotation, a full disk, and a process that is killed."""

from __future__ import annotations

import errno
import io
import resource
import threading
from itertools import chain
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from mcap.reader import make_reader

import skinmap
from benchmarks.live import recordings
from skinmap.errors import InvalidArrayError, OutputError, SkinMismatchError, SkinWarning
from skinmap.io.mcap.reading import read_track
from skinmap.io.mcap.writing import McapRecording, McapWriter
from skinmap.io.recordings.recorded_stream import RecordedStream, nanoseconds_of, rate_by_times
from skinmap.live.recording import recorder as module
from skinmap.live.recording import recorder as tap_module
from skinmap.live.recording.recorder import Recorder, RecordingTap
from skinmap.live.response.sample_checks import SampleChecks
from skinmap.live.sources.playback import Playback
from skinmap.live.sources.source import Block, Counts, Source, SourceEnded, StreamInfo, blocks

ROOT = Path(__file__).parents[2]
N = 300
DEADLINE = 60.0  # of waiting for an event that comes at once


@pytest.fixture
def info() -> StreamInfo:
    return StreamInfo("t", ("a",), (N,), 50.0, "raw")


@pytest.fixture(scope="module")
def values() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (600, N)).astype(np.uint8)


def block(values: np.ndarray, first: int, count: int = 1) -> Block:
    rows = np.arange(first, first + count)
    return Block(rows / 50, values[rows], 0.0)


def test_what_is_put_is_in_the_file(tmp_path, info, values):
    recorder = Recorder(tmp_path / "t.mcap", info)
    for first in range(0, 600, 20):
        recorder.put(block(values, first, 20))
    recorder.mark("a", 7, "poke", began=0.2, ended=0.4)
    recorder.put_angles(1.0, {"elbow": 0.5})
    recorder.close()
    recorder.close()
    track = read_track(tmp_path / "t.mcap")
    np.testing.assert_array_equal(track.values[:], values)
    (touch,) = track.touches
    assert (touch.event, touch.label, touch.first, touch.last) == (7, "poke", 10, 20)
    assert np.isnan(track.angles[49, 0])
    assert track.angles[50:, 0].tolist() == [0.5] * 550
    assert recorder.counts.written == 600
    assert recorder.counts.waiting == recorder.counts.dropped == 0


def test_joint_angles_of_a_source_are_recorded_where_they_change(tmp_path, info, values):
    angles = np.repeat([[0.1, np.nan], [0.2, 1.0]], 300, axis=0)
    times = np.arange(600) / 50
    played = Playback(
        RecordedStream(info, times, values, joints=("elbow", "wrist"), angles=angles),
        speed=float("inf"),
    )
    recorder = Recorder(tmp_path / "t.mcap", info)
    for _ in blocks(RecordingTap(played, recorder)):
        pass
    recorder.close()
    track = read_track(tmp_path / "t.mcap")
    wanted = dict(zip(("elbow", "wrist"), angles.T, strict=True))
    assert set(track.joints) == set(wanted)
    for joint, column in zip(track.joints, track.angles.T, strict=True):
        np.testing.assert_array_equal(column, wanted[joint])


def test_files_rotate_by_size_and_each_explains_itself(tmp_path, icub):
    width = len(icub.skin("left_hand"))
    info = StreamInfo("t", ("left_hand",), (width,), 50.0)
    values = np.random.default_rng(0).integers(0, 256, (2000, width)).astype(np.uint8)
    recorder = Recorder(tmp_path / "t.mcap", info, robot=icub, rotate_bytes=40_000)
    for first in range(0, 2000, 10):
        recorder.put(block(values, first, 10))
    recorder.close()
    assert [file.name for file in recorder.files[:3]] == ["t.mcap", "t_0002.mcap", "t_0003.mcap"]
    tracks = [read_track(file) for file in recorder.files]
    np.testing.assert_array_equal(np.concatenate([one.values[:] for one in tracks]), values)
    # Another file begins at the next block: one chunk of 0.1 s and the file's end come on top, and
    # what explains the robot to other tools, however few samples there are.
    sizes = []
    for name, shown in (("shown", icub), ("bare", None)):
        one = Recorder(tmp_path / f"{name}.mcap", info, robot=shown)
        one.put(block(values, 0))
        one.close()
        sizes.append((tmp_path / f"{name}.mcap").stat().st_size)
    assert max(file.stat().st_size for file in recorder.files) < 50_000 + sizes[0] - sizes[1]
    for track in tracks:
        assert len(track.tables["left_hand"]) == width
        assert not track.loss.recovered


def test_files_rotate_by_time(tmp_path, info, values, monkeypatch):
    now = [100.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    recorder = Recorder(tmp_path / "t.mcap", info, rotate_seconds=10)
    for first in range(3):
        recorder.put(block(values, first))
        with recorder._jobs._changed:
            assert recorder._jobs._changed.wait_for(lambda: recorder.counts.waiting == 0, DEADLINE)
        now[0] += 6.0
    recorder.close()
    assert [len(read_track(file).times) for file in recorder.files] == [2, 1]


def test_time_that_starts_again_gets_a_file_of_its_own(tmp_path, info, values):
    source = Playback(
        RecordedStream(info, np.arange(100) / 50, values[:100]), speed=np.inf, loop=True
    )
    recorder = Recorder(tmp_path / "t.mcap", info)
    for _ in range(3):
        recorder.put(source.read(1.0))
    recorder.close()
    assert [len(read_track(file).times) for file in recorder.files] == [100, 100, 100]


def test_samples_are_in_the_file_also_where_the_thread_has_no_turn(
    tmp_path, info, values, monkeypatch
):
    """On a busy machine what came in a second was put at once, and lost at once."""
    monkeypatch.setattr(Recorder, "_work", lambda self: None)
    recorder, path = Recorder(tmp_path / "t.mcap", info), tmp_path / "t.mcap"
    for first in range(120):
        recorder.put(block(values, first))
        assert first + 1 - len(read_track(path).times) <= module.BEHIND * info.rate + 1
    recorder.put(block(values, 120, 50))
    assert len(read_track(path).times) == 170
    monkeypatch.setattr(module, "BEHIND", 1e6)  # the control: what only the thread would write
    other = Recorder(tmp_path / "u.mcap", info)
    for first in range(120):
        other.put(block(values, first))
    assert len(read_track(tmp_path / "u.mcap").times) == 0
    for one in (recorder, other):
        one._file.close()


def test_samples_that_come_in_their_time_never_wait_for_the_disk(
    tmp_path, info, values, monkeypatch
):
    monkeypatch.setattr(Recorder, "_work", lambda self: None)
    recorder = Recorder(tmp_path / "t.mcap", info)
    recorder._clock = iter(np.arange(200) / 50).__next__
    for first in range(120):
        recorder.put(block(values, first))
    assert len(read_track(tmp_path / "t.mcap").times) == 0
    recorder._file.close()


def test_a_disk_that_hangs_is_waited_for_once(tmp_path, info, values, monkeypatch):
    """Who gives samples goes on: they wait in memory until the disk has caught up."""
    asked = []

    class Taken:
        def acquire(self, timeout):
            asked.append(timeout)
            return False

    monkeypatch.setattr(Recorder, "_work", lambda self: None)
    recorder = Recorder(tmp_path / "t.mcap", info)
    recorder._turn = Taken()
    for first in range(100):
        recorder.put(block(values, first), patience=0.5)
    assert asked == [0.5]
    assert recorder.counts.dropped == 0
    recorder._file.close()


def test_slow_disk_drops_samples_counts_them_and_keeps_memory_bounded(
    tmp_path, info, values, monkeypatch
):
    entered, free = threading.Event(), threading.Event()
    add = McapRecording.add

    def slow(self, *args):
        entered.set()
        assert free.wait(DEADLINE)
        add(self, *args)

    monkeypatch.setattr(McapRecording, "add", slow)
    recorder = Recorder(tmp_path / "t.mcap", info, most_bytes=10 * N)
    recorder.put(block(values, 0))
    assert entered.wait(DEADLINE)
    for first in range(1, 30):
        recorder.put(block(values, first), patience=0.0)
    assert recorder.counts.waiting <= 10 * N
    assert recorder.counts.dropped == 20
    free.set()
    recorder.close()
    np.testing.assert_array_equal(read_track(tmp_path / "t.mcap").values[:], values[:10])


def test_put_refuses_another_number_of_channels(tmp_path, info):
    recorder = Recorder(tmp_path / "t.mcap", info)
    with pytest.raises(SkinMismatchError, match="7 raw values in a sample, stream 't' has 300"):
        recorder.put(Block(np.zeros(1), np.zeros((1, 7), np.uint8), 0.0))
    recorder.close()


def test_bad_time_ends_the_recording_with_an_error_and_a_whole_file(tmp_path, info, values):
    recorder = Recorder(tmp_path / "t.mcap", info)
    recorder.put(block(values, 0, 5))
    recorder.put(Block(np.array([-3.0]), values[:1], 0.0))
    with pytest.raises(ValueError, match="time must lie in"):
        recorder.close()
    track = read_track(tmp_path / "t.mcap")
    assert len(track.times) == 5
    assert not track.loss.recovered


def test_recorded_source_passes_on_what_it_records_and_ends_in_time(tmp_path, info, values):
    source = Playback(RecordedStream(info, np.arange(600) / 50, values), speed=np.inf)
    recorder = Recorder(tmp_path / "t.mcap", info)
    recorded = RecordingTap(source, recorder, seconds=6.0)
    passed = np.concatenate([one.values for one in blocks(recorded)])
    with pytest.raises(SourceEnded):
        recorded.read(1.0)
    assert recorded.speed == np.inf
    recorder.close()
    np.testing.assert_array_equal(passed, values[:300])
    np.testing.assert_array_equal(read_track(tmp_path / "t.mcap").values[:], passed)


class FullDisk(io.BytesIO):
    """A file that the system stops writing after so many bytes, in the middle of a piece."""

    def __init__(self, room: int) -> None:
        super().__init__()
        self.room = room

    def write(self, data) -> int:
        left = self.room - self.tell()
        if left <= 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        return super().write(bytes(data[:left]))


@pytest.mark.parametrize("room", [500, 700, 1000, 1500, 2500, 4000, 4050, 4100, 9000])
def test_full_disk_leaves_a_file_that_the_standard_reader_opens(room):
    file = FullDisk(room)
    payload = np.random.default_rng(0).integers(0, 256, (40, 100)).astype(np.uint8)
    writer, told = McapWriter(file, chunk_bytes=500), 0
    channel = writer.add_channel("/t", "", 0)
    try:
        for number, data in enumerate(payload):
            writer.add_message(channel, number, data.tobytes(), number)
        writer.finish()
    except OSError as error:
        told += error.errno == errno.ENOSPC
        writer.finish()
    reader = make_reader(io.BytesIO(file.getvalue()), validate_crcs=True)
    found = [message.data for _, _, message in reader.iter_messages()]
    assert found == [data.tobytes() for data in payload[: len(found)]]
    assert told == (room < 9000)
    # All but the chunk that did not fit, and one more where its end did not fit either.
    assert len(found) * 122 >= min(room, 4880) - 1000 - 300


def fill_disk(folder: Path, samples: np.ndarray, *, room: int):
    """Record until the system refuses; what it said, and what can be read then."""
    info = StreamInfo("simulated", ("all",), (samples.shape[1],), 50.0)
    path, message, sent = folder / "full.mcap", "", 0
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, before[1]))
    try:
        recorder = Recorder(path, info)
        try:
            for sent in range(100_000):
                row = samples[sent % len(samples)][None]
                recorder.put(Block(np.array([sent / 50.0]), row, 0.0))
        except OutputError as error:
            message = str(error)
        try:
            recorder.close()
        except OutputError as error:
            message = message or str(error)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    track = read_track(path)
    with path.open("rb") as file:
        standard = sum(1 for _ in make_reader(file).iter_messages())
    return {
        "error": message.replace(str(folder), ""),
        "readable": len(track.times),
        "readable_by_mcap": standard,
        "bytes": path.stat().st_size,
    }


def test_full_disk_is_said_and_what_was_written_stays_readable(tmp_path, values):
    told = fill_disk(tmp_path, values, room=60_000)
    assert "File too large; the written part stays readable" in told["error"]
    assert told["readable"] == told["readable_by_mcap"]
    # 300 random bytes a sample: all but the last chunk and the ends of the file.
    assert told["readable"] > (60_000 - 7_000) / 400
    assert told["bytes"] <= 60_000


def test_two_recorders_on_one_file_are_one_recorder_and_a_line(tmp_path, info, values):
    first = Recorder(tmp_path / "t.mcap", info)
    first.put(block(values, 0, 5))
    with pytest.raises(OutputError, match=r"t\.mcap': another recorder writes it"):
        Recorder(tmp_path / "t.mcap", info)
    first.close()
    assert len(read_track(tmp_path / "t.mcap").times) == len(block(values, 0, 5))
    again = Recorder(tmp_path / "t.mcap", info)  # nobody any more: replaced, as ever
    again.close()
    assert len(read_track(tmp_path / "t.mcap").times) == 0


def test_failed_recorder_tells_everybody_who_comes_after(tmp_path, info, values, monkeypatch):
    def fail(self, *args):
        raise OutputError("no room")

    monkeypatch.setattr(McapRecording, "add", fail)
    recorder = Recorder(tmp_path / "t.mcap", info)
    recorder.put(block(values, 0))
    recorder._thread.join(DEADLINE)
    for _ in range(2):
        with pytest.raises(OutputError, match="no room"):
            recorder.put(block(values, 1))
    with pytest.raises(OutputError, match="no room"):
        recorder.close()


def test_killed_process_loses_a_fifth_of_a_second_at_most(tmp_path):
    # 4,326 channels at 50 Hz; the full form with 50 kills is `make soak`.
    noise = np.random.default_rng(0).normal(0, 1.2, (100, 4326))
    samples = np.rint(noise).clip(0, 255).astype(np.uint8)
    losses = recordings.kill_many(tmp_path, samples, 3, rng=np.random.default_rng(1), most=40)
    for one in losses:
        assert one["opened"]
        assert one["found"] > 0
        assert one["lost_s"] <= 0.2


def test_a_recording_that_goes_on_overwrites_nothing(tmp_path):
    """Time starts again, or a file is full: the next one takes a number that is free."""
    info = StreamInfo("t", ("a",), (3,), 50.0)
    earlier = tmp_path / "t_0002.mcap"
    earlier.write_bytes(b"of yesterday")
    recorder = Recorder(tmp_path / "t.mcap", info)
    for start in (5000.0, 1000.0):
        recorder.put(Block(np.array([start]), np.zeros((1, 3)), 0.0))
    recorder.close()
    assert earlier.read_bytes() == b"of yesterday"
    assert [file.name for file in recorder.files] == ["t.mcap", "t_0003.mcap"]


def test_record_replaces_a_longer_recording_whole_and_nothing_else(tmp_path):
    """Files that a recorder went on with belong to the first one; `t_2024` and others do not."""
    info = StreamInfo("t", ("a",), (3,), 50.0)
    others = [tmp_path / f"t_{number}.mcap" for number in ("0001", "2024")]
    others[0].write_bytes(b"of yesterday")
    recorder = Recorder(tmp_path / "t.mcap", info)
    for start in (5000.0, 1000.0):
        recorder.put(Block(np.array([start]), np.zeros((1, 3)), 0.0))
    recorder.close()
    others[1].write_bytes((tmp_path / "t.mcap").read_bytes())
    went_on = tmp_path / "t_0002.mcap"
    assert recorder.files == [tmp_path / "t.mcap", went_on]
    (tmp_path / "t.mcap").unlink()

    def again(**how):
        source = skinmap.open_source("sim", robot="kaspar", parts=["torso"], speed=np.inf)
        try:
            return skinmap.record(source, tmp_path / "t.mcap", seconds=0.2, **how)
        finally:
            source.close()

    with pytest.raises(OutputError, match=r"t_0002\.mcap' exists already"):
        again()
    assert went_on.exists()
    assert again(replace=True).samples == 10
    assert not went_on.exists()
    assert all(one.exists() for one in others)


@pytest.mark.parametrize("fall", [503.0, 1.5, 0.5])
def test_touch_is_marked_in_the_file_of_its_samples_where_time_falls(tmp_path, info, values, fall):
    """The mark comes once the touch is over: by then a new file may have begun."""
    recorder = Recorder(tmp_path / "t.mcap", info)
    times = 500.0 + np.arange(150) / 50
    recorder.put(Block(times, values[:150], 0.0))
    recorder.put(Block(times[:20] - fall + 3.0, values[:20], 0.0))
    recorder.mark("a", 1, "poke", began=502.2, ended=502.96)
    recorder.put(Block(times[20:90] - fall + 3.0, values[:70], 0.0))
    recorder.mark("a", 2, "tap", began=500.6 - fall + 3.0, ended=500.8 - fall + 3.0)
    recorder.close()
    first, second = (read_track(file).touches for file in recorder.files)
    assert [(one.label, one.first, one.last) for one in first] == [("poke", 110, 148)]
    assert [(one.label, one.first, one.last) for one in second] == [("tap", 30, 40)]


def test_touch_over_the_end_of_a_file_is_marked_in_both(tmp_path, info, values, monkeypatch):
    now = [100.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    recorder = Recorder(tmp_path / "t.mcap", info, rotate_seconds=10)
    for first in (0, 50):
        recorder.put(block(values, first, 50))
        with recorder._jobs._changed:
            assert recorder._jobs._changed.wait_for(lambda: recorder.counts.waiting == 0, DEADLINE)
        now[0] += 0.0 if first else 20.0
    recorder.mark("a", 1, "poke", began=0.8, ended=1.2)
    recorder.close()
    before, after = (read_track(file).touches for file in recorder.files)
    assert [(one.first, one.last) for one in before] == [(40, 49)]
    assert [(one.first, one.last) for one in after] == [(0, 10)]


class Planned(Source):
    """A live source of one part that gives planned blocks, and None once they are over."""

    def __init__(self, *planned: Block) -> None:
        super().__init__(StreamInfo("planned", ("a",), (N,), 50.0, "raw"))
        self._planned = list(planned)

    def read(self, timeout: float) -> Block | None:
        return self._planned.pop(0) if self._planned else None

    def close(self) -> None:
        pass


def test_times_in_milliseconds_end_a_recording_with_a_word(tmp_path):
    source = Planned(Block(np.array([5000.0]), np.zeros((1, N)), 0.0),
                     Block(np.array([5020.0]), np.zeros((1, N)), 0.02))  # fmt: skip
    with pytest.warns(SkinWarning, match="look like milliseconds"):
        tapped(tmp_path, source, seconds=6.0)


def test_a_time_beyond_all_years_names_the_unit_that_it_may_be_in():
    with pytest.raises(InvalidArrayError, match="are these milliseconds"):
        nanoseconds_of(1.7e12)
    with pytest.raises(InvalidArrayError, match="are these nanoseconds"):
        nanoseconds_of(1.7e18)


def tapped(tmp_path, source: Source, seconds: float) -> tuple[RecordingTap, Recorder, list[Block]]:
    recorder = Recorder(tmp_path / "t.mcap", source.info)
    tap = RecordingTap(source, recorder, seconds=seconds)
    given = list(blocks(tap, timeout=0.0))
    recorder.close()
    return tap, recorder, given


def test_recording_of_a_time_ends_where_the_source_dies(tmp_path, values, monkeypatch):
    now = [50.0]
    clock = SimpleNamespace(monotonic=lambda: now.append(now[-1] + 0.5) or now[-1])
    monkeypatch.setattr(tap_module, "time", clock)
    _, recorder, _ = tapped(tmp_path, Planned(block(values, 0, 20)), seconds=5.0)
    assert recorder.counts.written == 20
    assert 55.0 < now[-1] < 60.0


def test_a_clock_that_falls_does_not_make_a_recording_longer(tmp_path, values):
    planned = [Block(500.0 + np.arange(50) / 50, values[:50], 0.0)]
    planned += [Block(first + np.arange(50) / 50, values[:50], 0.0) for first in range(5)]
    _, recorder, _ = tapped(tmp_path, Planned(*planned), seconds=3.0)
    assert recorder.counts.written == 150 + 1


def test_a_clock_that_jumps_ahead_does_not_end_a_recording(tmp_path, values):
    steps = np.repeat([0.0, 500.0], [50, 150])
    planned = [Block(np.array([10.0 + k / 50 + steps[k]]), values[k : k + 1], 10.0 + k / 50)
               for k in range(200)]  # fmt: skip
    with pytest.warns(SkinWarning, match="went on by 500 s that did not pass"):
        _, recorder, _ = tapped(tmp_path, Planned(*planned), seconds=3.0)
    assert recorder.counts.written == 150 + 1


def test_a_tap_that_looks_counts_what_a_loop_counts(tmp_path, values):
    bad = values[:20].astype(np.float32)
    bad[3, 7], bad[5:7, 0] = np.nan, -30.0
    source = Planned(Block(np.arange(20) / 50, bad, 0.0))
    recorder = Recorder(tmp_path / "t.mcap", source.info)
    tap = RecordingTap(source, recorder, seconds=0.4, looks=True)
    list(blocks(tap, timeout=0.0))
    recorder.close()
    assert tap.unfit.faults() == "1 with NaN, 2 out of 0 to 255 counts"


def test_times_are_believed_where_they_contradict_the_stated_rate(tmp_path, values):
    info, counts = StreamInfo("t", ("a",), (N,), 100.0, "raw"), Counts()
    checks = SampleChecks(info, counts, seekable=False)
    recorder = Recorder(tmp_path / "t.mcap", info)
    came = [block(values, first, 10) for first in range(0, 200, 10)]
    for one in came:
        recorder.put(one)
    recorder.close()
    with pytest.warns(SkinWarning, match="states 100 samples a second, its times give 50"):
        list(chain.from_iterable(map(checks.look, came)))
    assert counts.lost == 0
    assert read_track(tmp_path / "t.mcap").info.rate == pytest.approx(50.0)


@pytest.mark.parametrize("seed", range(5))
def test_lost_and_late_samples_do_not_contradict_the_stated_rate(seed):
    rng = np.random.default_rng(seed)
    times = np.arange(2000) / 50
    lossy = times[rng.random(2000) < 0.4]
    uneven = np.sort(times + rng.uniform(0, 0.016, 2000))
    together = np.floor(times / 0.2) * 0.2 + 1e-4 * (np.arange(2000) % 10)
    for one in (times, lossy, uneven, together, times * 1.05):
        assert rate_by_times(one, 50.0) == 50.0


def test_milliseconds_that_come_at_once_are_not_lost_samples(info, values):
    counts = Counts()
    checks = SampleChecks(info, counts, seekable=False)
    with pytest.warns(SkinWarning, match="look like milliseconds"):
        list(checks.look(Block(np.array([8e4, *20.0 * np.arange(9)]), values[:10], 0.0)))
    assert counts.lost == 0


def test_numbers_with_their_bytes_turned_round_are_warned_of(info, values):
    turned = values[:150].astype(">f4").view("<f4")
    with pytest.warns(SkinWarning, match="like numbers with their bytes turned round"):
        list(
            SampleChecks(info, Counts(), seekable=False).look(
                Block(np.arange(150) / 50, turned, 0.0)
            )
        )


def test_samples_of_another_width_are_counted_and_end_no_recording(tmp_path, values):
    planned = [block(values, 0, 5), block(values[:, :-1], 5, 2), block(values, 7, 5)]
    tap, recorder, given = tapped(tmp_path, Planned(*planned), seconds=0.24)
    assert recorder.counts.written == 10
    assert (tap.unfit.short, tap.unfit.long) == (2, 0)
    assert len(given) == 3, "who follows is given them, and counts them too"
    assert tap.unfit.faults() == "2 with too few values"


def test_values_of_more_than_eight_bits_are_warned_of_once(info, values):
    checks = SampleChecks(info, Counts(), seekable=False)
    loud = [Block(k + np.arange(5) / 50, 16.0 * values[:5], 0.0) for k in range(3)]
    three = chain.from_iterable(checks.look(one) for one in loud)
    with pytest.warns(SkinWarning, match="sends values up to 4080: raw values are 0 to") as told:
        assert len(list(three)) == 3
    assert len(told) == 1
    noisy = Block(np.arange(5) / 50, values[:5].astype(np.float32) - 20.0, 0.0)
    list(SampleChecks(info, Counts(), seekable=False).look(noisy))  # a warning is an error here


def test_times_below_zero_are_recorded_later(tmp_path, values):
    source = Planned(Block(-0.9 + np.arange(50) / 50, values[:50], 0.0))
    with pytest.warns(SkinWarning, match=r"begin at -0.9 s: recorded 1 s later"):
        _, recorder, given = tapped(tmp_path, source, seconds=1.0)
    assert recorder.counts.written == 50
    times = read_track(tmp_path / "t.mcap").times
    np.testing.assert_allclose(times, 0.1 + np.arange(50) / 50, rtol=0, atol=1e-9)
    np.testing.assert_allclose(given[0].times, times, rtol=0, atol=1e-9)
