"""`skinmap evaluate --protocol prints`: planted contacts on a grid, and real ones if present."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy import ndimage

from skinmap.cli.main import cli
from skinmap.errors import SkinError
from skinmap.recognition.protocols.prints import find_spots, match_prints
from skinmap.touch.contacts.skin_geometry import least_areas

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "capcontact" / "prints.npz"
ROWS, COLUMNS, FINE, PITCH = 20, 32, 8, 345.0 / 72.0
SCALE = 0.1  # of a person, in the logarithm of readings


def planted(path: Path, people: tuple[int, ...], *, seed: int, images: int = 24) -> Path:
    """Two ellipses an image, blurred to readings, with noise and a gain of each person."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: ROWS * FINE, : COLUMNS * FINE] + 0.5
    readings, prints, persons = [], [], []
    for person in people:
        gain = 700.0 * np.exp(rng.normal(0.0, SCALE))
        for _ in range(images):
            touched = np.zeros(x.shape, bool)
            for column in (8.0, 24.0):
                row, across = rng.uniform(5, 15), column + rng.uniform(-2, 2)
                long, short = rng.uniform(6.0, 14.0), rng.uniform(6.0, 11.0)
                touched |= ((y - row * FINE) / long) ** 2 + ((x - across * FINE) / short) ** 2 < 1
            cover = touched.reshape(ROWS, FINE, COLUMNS, FINE).mean(axis=(1, 3))
            reading = gain * ndimage.gaussian_filter(cover, 0.8)
            readings.append(np.rint(reading + rng.normal(0, 5, cover.shape)))
            prints.append(np.packbits(touched, axis=1))
            persons.append(person)
    arrays = {"readings": np.array(readings, np.int16), "prints": np.array(prints)}
    np.savez_compressed(path, **arrays, person=np.array(persons, np.uint8))
    return path


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("prints")
    train = planted(folder / "train.npz", (1, 2, 3, 4, 5), seed=1)
    return train, planted(folder / "test.npz", (6, 7), seed=2)


def run(*words: object) -> dict:
    command = ["evaluate", "--protocol", "prints", *map(str, words), "--json"]
    result = CliRunner().invoke(cli, command, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def refused(*words: object) -> str:
    result = CliRunner().invoke(cli, ["evaluate", "--protocol", "prints", *map(str, words)])
    if isinstance(result.exception, SkinError):
        return str(result.exception)
    assert result.exit_code == 2, result.output
    return result.output


def changed(path: Path, out: Path, **arrays: np.ndarray | None) -> Path:
    with np.load(path) as found:
        held = {name: found[name] for name in found.files}
    held.update(arrays)
    np.savez(out, **{name: array for name, array in held.items() if array is not None})
    return out


def test_prints_planted_contacts_are_measured(files: tuple[Path, Path], tmp_path: Path) -> None:
    train, test = files
    found = run(train, test, "--predictions", tmp_path / "areas.npz")
    # Two a picture, and none of them missed.
    assert (found["contacts"], found["judged"], found["missed"]) == (96, 96, 0)
    # A gain of 10 % moves an area by about as much; centres are as sharp as the noise allows.
    assert found["area_error_median"] < 0.1
    assert found["area_error_p90"] < 0.25
    assert found["centre_mm_median"] < 0.4
    assert 0.8 <= found["holds"] <= 1.0
    with np.load(tmp_path / "areas.npz") as answers:
        assert set(answers.files) == {"image", "centre_mm", "area_mm2", "low", "high"}
        image, low, area, high = (answers[k] for k in ("image", "low", "area_mm2", "high"))
        centre = answers["centre_mm"]
    assert np.array_equal(np.bincount(image), np.full(48, 2))
    assert ((low < area) & (area < high)).all()
    assert found["high_to_low"] == pytest.approx(np.median(high / low), rel=1e-4)
    with np.load(test) as held:  # the control: what lies above a threshold is far too large
        above = (held["readings"] > 60).sum(axis=(1, 2)) * PITCH**2
        prints = np.unpackbits(held["prints"], axis=2)
    true = prints.sum(axis=(1, 2)) * (PITCH / FINE) ** 2
    assert np.median(above / true) > 1.3
    left = prints[0][:, : COLUMNS * FINE // 2]  # one contact in each half of a picture
    place = (np.argwhere(left).mean(axis=0) + 0.5) * PITCH / FINE
    assert np.linalg.norm(centre[image == 0] - place, axis=1).min() < 1.0


def least_and_most(path: Path) -> np.ndarray:
    """(k, 3) true areas of contacts, and the least and most that readings alone allow for."""
    with np.load(path) as held:
        readings, packed = held["readings"].astype(float), held["prints"]
    _, rows, columns = readings.shape
    spots = find_spots(readings, pitch_mm=PITCH)
    truth = match_prints(spots, (np.unpackbits(one, axis=1) for one in packed), pitch_mm=PITCH)
    number = np.pad(np.arange(rows * columns).reshape(rows, columns), 1, constant_values=-1)
    beside = np.stack([number[2:, 1:-1], number[:-2, 1:-1], number[1:-1, 2:], number[1:-1, :-2]])
    beside = beside.reshape(4, -1).T % (rows * columns + 1)  # beyond the grid: the last
    found, areas = [], np.full(rows * columns, PITCH**2)
    for label, reading in zip(spots.labels, readings.reshape(len(readings), -1), strict=True):
        for spot in np.unique(label[label > 0]):
            index = np.flatnonzero(label == spot)
            own = reading[index]
            least = least_areas(index, own, own.max(), beside, areas)
            found.append([truth.area_mm2[spot - 1], least.sum(), areas[index].sum()])
    table = np.array(found)
    return table[table[:, 0] > 0].T


def test_a_planted_contact_covers_between_at_least_and_at_most(files: tuple[Path, Path]) -> None:
    true, least, most = least_and_most(files[1])
    assert (least <= true).mean() >= 0.95
    assert (true <= most).mean() >= 0.95
    assert np.median(least / true) > 0.3  # it is worth something
    assert np.median(most / true) > 1.3  # the control: skin that feels it is not covered by it


@pytest.mark.skipif(not DATA.is_file(), reason="the prints are not beside this checkout")
def test_real_fingers_cover_between_at_least_and_at_most() -> None:
    true, least, most = least_and_most(DATA)
    assert len(true) > 1900
    assert (least <= true).mean() >= 0.95
    assert (true <= most).all()
    assert np.median(least / true) > 0.5


def test_prints_of_the_test_do_not_reach_the_answers(
    files: tuple[Path, Path], tmp_path: Path
) -> None:
    train, test = files
    with np.load(test) as held:
        shuffled = held["prints"][::-1]
    for name, prints in (("shuffled", shuffled), ("none", None)):
        other = changed(test, tmp_path / f"{name}.npz", prints=prints, person=None)
        found = run(train, other, "--predictions", tmp_path / f"areas-{name}.npz")
        assert found["own_area_error_median"] is None
    assert found["area_error_median"] is None
    assert found["judged"] == 0
    run(train, test, "--predictions", tmp_path / "areas.npz")
    with np.load(tmp_path / "areas.npz") as first:
        for name in ("shuffled", "none"):
            with np.load(tmp_path / f"areas-{name}.npz") as second:
                assert all(np.array_equal(first[k], second[k]) for k in first.files)


def test_prints_people_may_be_names(files: tuple[Path, Path], tmp_path: Path) -> None:
    train, test = files
    with np.load(train) as held:
        names = np.char.add("p", held["person"].astype(str))
    assert run(changed(train, tmp_path / "named.npz", person=names), test)["people"] == 5


def test_prints_answers_are_empty_without_a_touch(files: tuple[Path, Path], tmp_path: Path) -> None:
    quiet = tmp_path / "quiet.npz"
    np.savez(quiet, readings=np.zeros((3, ROWS, COLUMNS), np.int16))
    assert run(files[0], quiet, "--predictions", tmp_path / "none.npz")["contacts"] == 0
    with np.load(tmp_path / "none.npz") as answers:
        assert answers["centre_mm"].shape == (0, 2)
        assert answers["low"].shape == (0,)


def test_prints_refuses_files_that_cannot_be_judged(
    files: tuple[Path, Path], tmp_path: Path
) -> None:
    train, test = files
    out = tmp_path / "areas.npz"
    assert "needs TRAIN.npz TEST.npz; got 1" in refused(train, "--predictions", out)
    assert "no file 'nowhere.npz'" in refused(train, "nowhere.npz", "--predictions", out)
    bare = changed(train, tmp_path / "bare.npz", prints=None)
    assert "no array 'prints' to train on" in refused(bare, test, "--predictions", out)
    alone = changed(train, tmp_path / "alone.npz", person=np.ones(120, np.uint8))
    assert "of 1 people: areas need 30 of 3 people" in refused(alone, test, "--predictions", out)
    with np.load(test) as held:
        gone = held["readings"].astype(float)
        gone[0, 0, 0] = np.nan
        cut = held["prints"][:, :-3]
    nan = changed(test, tmp_path / "nan.npz", readings=gone)
    assert "expected finite numbers" in refused(train, nan, "--predictions", out)
    odd = changed(test, tmp_path / "odd.npz", prints=cut)
    assert "packed bits" in refused(train, odd, "--predictions", out)
    (tmp_path / "text.npz").write_text("no archive")
    assert "not an archive" in refused(train, tmp_path / "text.npz", "--predictions", out)
    assert "format" in refused(train, test, "--predictions", tmp_path / "areas.csv")
    assert not out.exists()


@pytest.mark.skipif(not DATA.is_file(), reason="the prints are not beside this checkout")
def test_prints_hold_on_people_left_out(tmp_path: Path) -> None:
    with np.load(DATA) as held:
        everything = {name: held[name] for name in ("readings", "prints", "person")}
    own = np.isin(everything["person"], (7, 9))
    for name, rows in (("train", ~own), ("test", own)):
        arrays = {key: array[rows] for key, array in everything.items()}
        np.savez_compressed(tmp_path / f"{name}.npz", **arrays)
    found = run(tmp_path / "train.npz", tmp_path / "test.npz")
    assert found["missed"] <= 1
    assert found["area_error_median"] <= 0.18
    assert found["area_error_p90"] <= 0.43
    assert found["centre_mm_median"] <= 1.1
    assert 0.85 <= found["holds"] <= 0.95
    assert found["high_to_low"] <= 2.8
