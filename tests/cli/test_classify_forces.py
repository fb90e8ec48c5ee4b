"""`skinmap classify --calibration`: touches in newtons, of recordings and of what comes live."""

from __future__ import annotations

import csv
import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from skinmap.cli.main import cli
from skinmap.errors import SkinError
from skinmap.io.robots.manifest import load_robot
from skinmap.live.loop import TouchLoop
from skinmap.live.response.loads import ContactForce, PartLoads
from skinmap.live.sources.open_source import open_source
from skinmap.memory_features import FEATURES
from skinmap.touch.load_calibration import LoadCalibration
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.recording import load_recordings, save_recordings

PART = "left_forearm"
FULL = 0.5  # bar that 200 counts stand for


def straight(n: int, *, span: float = 200.0, age: float = 0.0) -> LoadCalibration:
    """A straight line from 0 counts to `span`."""
    weights = np.zeros((n, FEATURES))
    weights[:, 1] = FULL
    each = np.ones(n)
    return LoadCalibration(
        weights, 0 * each, span * each, 0 * each, FULL * each, 0.005 * each, 0.01, 50.0,
        "linear", 0 * each, time.time() - age,
    )  # fmt: skip


def write(path: Path, calibration: LoadCalibration) -> Path:
    path.mkdir()
    (path / "load.npz").write_bytes(calibration.to_bytes())
    return path


@pytest.fixture(scope="module")
def skin():
    return load_robot("icub").skin(PART)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, skin) -> Path:
    found = tmp_path_factory.mktemp("forces")
    write(found / "load", straight(len(skin), span=260.0))
    write(found / "narrow", straight(len(skin), span=30.0))
    words = ["simulate", "--part", PART, "--per-gesture", "2", "--variety", "none"]
    result = CliRunner().invoke(cli, [*words, "-o", str(found / "touches.npz")])
    assert result.exit_code == 0, result.output
    return found


def run(*words: object) -> str:
    result = CliRunner().invoke(cli, ["classify", *map(str, words)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout


def test_recorded_touches_have_forces_with_intervals(folder: Path, skin) -> None:
    touches = folder / "touches.npz"
    found = json.loads(run(touches, "--calibration", f"{PART}={folder / 'load'}", "--json"))
    loads = [one["load"] for one in found["touches"]]
    assert len(loads) >= 8
    for load in loads:
        assert load["refused"] == ""
        low, high = load["force_n_90"]
        assert 0.0 <= low < load["force_n"] < high
        assert load["area_mm2_90"][0] <= load["area_mm2"] <= load["area_mm2_90"][1]
        # The skin is pushed inwards, against its outward direction.
        assert np.dot(load["vector_n"], load["normal"]) < 0
        # A force of even pressure over the area, and no more than its peak could make.
        assert load["force_n"] <= 1e-3 * load["peak_kpa_90"][1] * load["area_mm2_90"][1]
    plain = json.loads(run(touches, "--json"))
    assert all(one.pop("load") is not None for one in found["touches"])
    assert all(one.pop("load") is None for one in plain["touches"])
    assert plain == found  # names do not depend on it
    table = run(touches, "--calibration", f"{PART}={folder / 'load'}")
    assert " N (" in table
    assert " N (" not in run(touches)


def test_forces_above_the_range_are_refused(folder: Path) -> None:
    words = (folder / "touches.npz", "--calibration", f"{PART}={folder / 'narrow'}", "--json")
    loads = [one["load"] for one in json.loads(run(*words))["touches"]]
    assert {load["refused"] for load in loads} == {"above the calibrated range"}
    assert all(load["force_n"] is None and load["force_n_90"] is None for load in loads)


@pytest.mark.usefixtures("hurried")
def test_live_touches_have_forces(folder: Path) -> None:
    words = ["sim", "--robot", "icub", "--part", PART, "--seconds", "6", "--json"]
    lines = run(*words, "--calibration", f"{PART}={folder / 'load'}").splitlines()
    touches = [one for one in map(json.loads, lines) if one["event"] == "touch"]
    assert touches
    assert any(one["load"]["force_n"] for one in touches)
    assert all(one["load"] is None for one in map(json.loads, run(*words).splitlines())
               if one["event"] == "touch")  # fmt: skip


def test_loop_refuses_a_zero_of_another_day(skin) -> None:
    robot = load_robot("icub")
    source = open_source("sim", robot=robot, parts=[PART], speed=float("inf"))
    old = {PART: straight(len(skin), span=260.0, age=3 * 86400.0)}
    loop = TouchLoop(robot, source, calibrations=old)
    loop._loads[PART]._needed = 10**9  # no rest that would be long enough
    moment = next(one for one in loop if one.touches)
    loop.close()
    assert moment.touches[0].load.refused.startswith("its zero is 72 h old")
    source = open_source("sim", robot=robot, parts=[PART], speed=float("inf"))
    loop = TouchLoop(robot, source, calibrations=old)
    moments = (one for one in loop if one.touches and one.time > 2.0)
    found = [next(moments).touches[0].load for _ in range(20)]
    loop.close()  # with a rest of its own the age does not matter
    assert any(not one.refused for one in found)


def pressed(skin, rest: float, seconds: float = 2.0) -> np.ndarray:
    """Samples (t, n) of 50 a second: so long at rest, and a second with a fingertip on it."""
    away = np.linalg.norm(skin.positions - skin.positions[60], axis=1)
    touch = 130.0 * np.exp(-0.5 * (away / 0.01) ** 2)
    return rest + np.outer(np.arange(round(50 * seconds) + 50) >= round(50 * seconds), touch)


def weighed(loads: PartLoads, samples: np.ndarray) -> ContactForce:
    """Force of the touch of the last second; nothing touches before."""
    loads.take(samples[:-50], touched=False)
    loads.take(samples[-50:], touched=True)
    return loads.force(np.flatnonzero(samples[-1] > samples[0] + 40.0))


def test_a_rest_far_off_the_calibration_refuses_the_force(skin) -> None:
    part, model = PreparedSkin(skin), straight(len(skin))
    assert not weighed(PartLoads(part, model, 50.0), pressed(skin, 20.0)).refused
    loads = PartLoads(part, model, 50.0)
    found = weighed(loads, pressed(skin, 32.0))
    assert found.refused == "rest lies 16 % of the range off: fit the calibration anew"
    assert not weighed(loads, pressed(skin, 0.0)).refused  # what pressed on all of it is off again


def test_pressures_have_no_force_by_a_calibration_of_raw_counts(
    folder: Path, skin, tmp_path: Path
) -> None:
    reason, model = "calibrated for raw counts, not for pressures", straight(len(skin))
    raw, part = replace(model, rest=model.rest + 60.0), PreparedSkin(skin)
    samples = pressed(skin, 0.0)
    assert weighed(PartLoads(part, raw, 50.0, "pressure"), samples).refused == reason
    assert not weighed(PartLoads(part, model, 50.0, "pressure"), samples).refused
    named = PartLoads(part, raw, 50.0, "pressure")  # raw counts by that name, until rest is heard
    assert weighed(named, pressed(skin, 60.0, 0.5)).refused == reason
    assert not weighed(named, pressed(skin, 60.0)).refused
    words = (folder / "touches.npz", "--calibration", write(tmp_path / "raw", raw), "--json")
    refused = {one["load"]["refused"] for one in json.loads(run(*words))["touches"]}
    assert refused == {reason}


def test_recorded_touches_have_the_reason_of_their_own_rest(folder: Path, skin, tmp_path) -> None:
    (own,) = load_recordings(folder / "touches.npz")
    up = replace(own, pressures=np.minimum(own.pressures.astype(int) + 10, 255).astype(np.uint8))
    narrow = write(tmp_path / "narrow", straight(len(skin), span=60.0))
    raised = replace(straight(len(skin), span=260.0), rest=np.full(len(skin), 40.0))
    touched = own.events >= 0
    cut = replace(
        up, pressures=up.pressures[touched], times=np.arange(touched.sum()) / own.rate,
        events=own.events[touched],
    )  # fmt: skip
    for one, model, words in ((up, narrow, "rest lies"), (cut, write(tmp_path / "up", raised), "")):
        save_recordings([one], tmp_path / "own.npz")
        found = json.loads(run(tmp_path / "own.npz", "--calibration", model, "--json"))["touches"]
        refused = [touch["load"]["refused"] for touch in found if touch["load"]]
        assert all(one.startswith(words) for one in refused)
        assert not any("pressures come" in one for one in refused)


@pytest.mark.parametrize("drift", [-0.02, 0.02])
def test_the_zero_follows_rest_between_touches(skin, drift: float) -> None:
    loads = PartLoads(PreparedSkin(skin), straight(len(skin)), 50.0)
    samples = pressed(skin, 10.0, 4.0)
    first = weighed(loads, samples)
    for now in range(100):  # another touch every four seconds
        found = weighed(loads, samples + 4 * now * drift)
    assert found.force.value == pytest.approx(first.force.value, rel=0.02)
    width = np.ptp(found.force) / found.force.value
    for now in range(100, 130):  # two minutes without any rest
        loads.take(samples[-1:].repeat(200, axis=0) + 4 * now * drift, touched=True)
    found = loads.force(np.flatnonzero(samples[-1] > 50.0))
    assert np.ptp(found.force) / found.force.value > width
    assert found.force.low < first.force.value < found.force.high


def test_a_thing_that_lies_still_for_minutes_is_not_the_zero_of_its_taxels(skin) -> None:
    loads = PartLoads(PreparedSkin(skin), straight(len(skin)), 50.0)
    samples = pressed(skin, 10.0, 4.0)
    first = weighed(loads, samples)
    lying = samples[:-50] + 60.0 * (samples[-1] > 50.0)
    for _ in range(100):  # its taxels are stuck for the contacts: untouched
        loads.take(lying, touched=False)
    assert weighed(loads, samples).force.value == pytest.approx(first.force.value, rel=0.02)


def test_calibrations_of_other_skins_are_refused(folder: Path, tmp_path: Path) -> None:
    small = write(tmp_path / "small", straight(7))
    touches = folder / "touches.npz"

    def refused(*words: object) -> str:
        result = CliRunner().invoke(cli, ["classify", str(touches), *map(str, words)])
        assert isinstance(result.exception, SkinError)
        return str(result.exception)

    assert "7 taxels are calibrated" in refused("--calibration", small)
    assert "no part to calibrate 'tail'" in refused("--calibration", f"tail={small}")
    assert "no file" in refused("--calibration", tmp_path / "nothing")


def test_contacts_of_a_recording_become_a_table(folder: Path, tmp_path: Path) -> None:
    touches, plain, loaded = folder / "touches.npz", tmp_path / "a.csv", tmp_path / "b.csv"
    words = ["export", str(touches), "--format", "contacts", "-o"]
    load = ["--calibration", f"{PART}={folder / 'load'}"]
    for file, more in ((plain, []), (loaded, load)):
        done = CliRunner().invoke(cli, [*words, str(file), *more], catch_exceptions=False)
        assert done.exit_code == 0, done.output
    with plain.open() as one, loaded.open() as other:
        rows, forces = list(csv.DictReader(one)), list(csv.DictReader(other))
    assert len(rows) == len(forces) > 100
    assert all(row["force_n"] == "" and row["area_mm2"] == "" for row in rows)
    assert all(0 < float(row["area_low_mm2"]) < float(row["area_high_mm2"]) for row in rows)
    told = [row for row in forces if row["force_n"]]
    assert len(told) > len(forces) / 2
    for row in told:
        assert float(row["force_low_n"]) < float(row["force_n"]) < float(row["force_high_n"])
        assert float(row["peak_kpa"]) > 0.0
    assert {row["part"] for row in rows} == {PART}
    assert [row["time"] for row in rows] == [row["time"] for row in forces]


@pytest.mark.parametrize(
    ("words", "answer"),
    [
        (["icub", "--part", PART, "--calibration", "x", "-o", "a.csv"], "needs --format contacts"),
        (
            ["icub", "--calibration", "x", "--format", "touched", "-o", "a.csv"],
            "needs --format con",
        ),
        (["icub", "--format", "contacts", "-o", "a.csv"], "contacts is for recordings"),
        (["t.npz", "--format", "contacts", "-o", "a.txt"], "ending in .csv or .parquet"),
    ],
)
def test_contacts_that_cannot_be_written_are_refused(words, answer) -> None:
    done = CliRunner().invoke(cli, ["export", *words])
    assert done.exit_code == 2
    assert answer in done.output


def test_recordings_keep_wrenches_with_covariance(folder: Path, tmp_path: Path) -> None:
    from mcap.reader import make_reader
    from rosbags.typesys import Stores, get_typestore

    file = tmp_path / "touch.mcap"
    words = ["record", "sim", "--part", PART, "--seconds", "12", "--speed", "inf", "-o", file]
    words += ["--label", "poke"]
    result = CliRunner().invoke(cli, [*map(str, words), "--calibration", str(folder / "load")])
    assert result.exit_code == 0, result.output
    store, held = get_typestore(Stores.ROS2_JAZZY), {}
    with file.open("rb") as opened:
        for schema, channel, message in make_reader(opened).iter_messages():
            if channel.topic.startswith("/skin/wrench"):
                kind = schema.name
                found = store.deserialize_cdr(message.data, kind)
                held.setdefault(channel.topic, []).append(found)
    wrenches, covariances = held["/skin/wrenches"], held["/skin/wrench_covariances"]
    assert len(wrenches) == len(covariances) > 10
    assert {one.header.frame_id for one in wrenches} == {load_robot("icub").part(PART).link}
    for wrench, covariance in zip(wrenches, covariances, strict=True):
        force = wrench.wrench.force
        size = np.linalg.norm([force.x, force.y, force.z])
        matrix = np.reshape(covariance.data, (6, 6))
        np.testing.assert_allclose(matrix, matrix.T)
        # What lies between taxels is in doubt by a tenth of the force at least.
        assert np.sqrt(np.trace(matrix[:3, :3])) > 0.1 * size > 0


def test_record_weighs_no_touches_without_names(folder: Path, tmp_path: Path) -> None:
    words = ["record", "sim", "-o", str(tmp_path / "a.mcap"), "--calibration", str(folder / "load")]
    assert "--label or --model" in CliRunner().invoke(cli, words).output


def test_contact_tables_keep_times_of_any_clock(tmp_path: Path) -> None:
    """Seconds of Unix have ten digits before the point, and samples are 10 ms apart."""
    from skinmap.live.moment_files import COLUMNS, _write_csv

    times = [1.7e9 + 0.01, 1.7e9 + 0.02, 123456.789]
    rows = ([time, 1, "torso", *[0.5] * (len(COLUMNS) - 3)] for time in times)
    assert _write_csv(rows, tmp_path / "c.csv") == 3
    with (tmp_path / "c.csv").open(newline="") as file:
        assert [float(row["time"]) for row in csv.DictReader(file)] == times


def test_contacts_have_newtons_where_a_calibration_is_given(folder: Path, skin) -> None:
    import skinmap

    mesh = skinmap.build_surface(skin)
    model = LoadCalibration.read(folder / "load")
    away = np.linalg.norm(skin.positions - skin.positions[60], axis=1)
    counts = 130.0 * np.exp(-0.5 * (away / 0.01) ** 2)
    plain = skinmap.find_contacts(mesh, counts)
    (weighed,) = skinmap.find_contacts(mesh, counts, calibration=model)
    assert plain[0].load is None
    low, force, high = (weighed.load.force[k] for k in (1, 0, 2))
    assert 0 <= low < force < high
    assert f"{force:.3g} N" in repr(weighed)
    # Twice the counts on a straight line are twice the force.
    (twice,) = skinmap.find_contacts(mesh, 1.5 * counts, calibration=model)
    assert twice.load.force.value == pytest.approx(1.5 * force, rel=0.02)
    (falling,) = skinmap.find_contacts(
        mesh, 255 - counts, calibration=replace(model, rest=255 + 0 * model.rest, span=-model.span)
    )
    assert falling.load.force.value == pytest.approx(force, rel=1e-6)
