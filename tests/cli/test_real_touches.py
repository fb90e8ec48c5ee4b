"""`skinmap evaluate --protocol fingers` and `hands`: planted touches, and real ones if present."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from skinmap.cli.main import cli
from skinmap.errors import SkinError
from skinmap.io.recordings.cyskin_arrays import SATURATION, find_pressed, read_pressed
from skinmap.io.taxels.cyskin import CySkin, write_cyskin
from skinmap.recognition.protocols import fingers as protocol
from skinmap.recognition.protocols.fingers import (
    WIDTH,
    count_by_width,
    describe,
    fit_thresholds,
    judge,
    places,
)
from skinmap.touch.prepared_skin import PreparedSkin

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "cyskin"
REAL = pytest.mark.skipif(
    not (DATA / "fingers.npz").is_file(),
    reason="the CySkin recordings are not beside this checkout",
)
PITCH, ROWS, COLUMNS, FILES, STEPS = 6.5e-3, 22, 26, 7, 30
WIDE = 17e-3  # between two fingers


def run(*words: str) -> dict:
    result = CliRunner().invoke(cli, ["evaluate", *words, "--json"], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def refused(*words: str) -> str:
    result = CliRunner().invoke(cli, ["evaluate", *words])
    if isinstance(result.exception, SkinError):  # `skinmap` prints it and exits with 2
        return str(result.exception)
    assert result.exit_code == 2, result.output
    return result.output


def sheet() -> CySkin:
    row, column = np.divmod(np.arange(ROWS * COLUMNS), COLUMNS)
    places = PITCH * np.column_stack([column + 0.5 * (row % 2), row * np.sqrt(0.75), 0.0 * row])
    up = np.tile([0.0, 0.0, 1.0], (len(places), 1))
    ids = 16 * (1 + np.arange(len(places)) // 12) + np.arange(len(places)) % 12
    return CySkin("sheet", ids, places, up, np.zeros((0, 3), np.int64))


def ridge(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Shares (n,) of a finger that lies flat from start to end."""
    way = end - start
    along = np.clip((points - start) @ way / (way @ way), 0.0, 1.0)
    away = np.linalg.norm(points - start - along[:, None] * way, axis=1)
    return np.exp(-((away / 6e-3) ** 2))


def planted(folder: Path, *, leak: bool = True, seed: int = 0) -> Path:
    """Fingers side by side on a sheet, with noise, gains, spikes and a rest of each class."""
    rng = np.random.default_rng(seed)
    one = sheet()
    points = one.positions[:, :2]
    gains = np.clip(rng.normal(1.0, 0.2, len(points)), 0.4, 1.6)
    blocks, index, classes = [], [], []
    course = np.sin(np.pi * np.clip((np.arange(STEPS) - 8) / 14.0, 0.0, 1.0)) ** 0.5
    for fingers in range(6):
        rest = 900.0 * rng.random(len(points)) if leak else np.zeros(len(points))
        for _ in range(FILES):
            middle = points.mean(axis=0) + rng.uniform(-0.02, 0.02, 2)
            turn = rng.uniform(-0.5, 0.5)
            away = np.array([np.cos(turn), np.sin(turn)])
            load = np.zeros(len(points))
            for k in range(fingers):
                foot = middle + away * WIDE * (k - (fingers - 1) / 2)
                half = 0.5 * rng.uniform(0.025, 0.04) * np.array([-away[1], away[0]])
                load = np.maximum(
                    load, rng.uniform(0.7, 1.2) * ridge(points, foot - half, foot + half)
                )
            values = rest + 9000.0 * gains * load * course[:, None]
            values += np.abs(rng.normal(0.0, 150.0, values.shape))
            values[rng.integers(STEPS), rng.integers(len(points))] += 1700.0
            index += [len(classes)] * STEPS
            classes.append(fingers)
            blocks.append(np.clip(values, 0, SATURATION))
    folder.mkdir(parents=True, exist_ok=True)
    write_cyskin(one, folder / "sheet.json")
    np.savez(
        folder / "fingers.npz",
        values=np.concatenate(blocks).astype(np.uint16),
        times=np.tile(np.arange(STEPS) / 10.0, len(classes)),
        taxel_ids=one.ids,
        file_index=np.array(index),
        file_class=np.array(classes),
    )
    return folder


@pytest.fixture(scope="module")
def fingers(tmp_path_factory):
    return planted(tmp_path_factory.mktemp("fingers"))


def test_planted_fingers_are_counted_and_the_control_is_chance(fingers, tmp_path, monkeypatch):
    monkeypatch.setattr(protocol, "TREES", 60)
    found = run("--protocol", "fingers", str(fingers), "--seeds", "1", "--out", str(tmp_path))
    assert found["recordings"] == {str(k): FILES for k in range(6)}
    assert found["majority"] == pytest.approx(1 / 6, abs=1e-6)  # of JSON's six digits
    for row in (found["chosen"], found["trained"]):
        assert row["exact"] >= 0.6
        assert row["within_one"] >= 0.9
        assert row["control"] <= 0.3, "the rest of each class names it, and must not help"
    assert np.sum(found["trained"]["confusion"]) == pytest.approx(6 * FILES)
    assert found["files"] == ["evaluation.json", "report.html"]


def test_rest_that_is_not_taken_away_names_the_class(fingers):
    """The judge can fail: raw first samples of these recordings give their class away."""
    with np.load(fingers / "fingers.npz") as arrays:
        first = arrays["values"][::STEPS].astype(float)
        classes = arrays["file_class"]
    gap = np.linalg.norm(first[:, None] - first, axis=2)
    np.fill_diagonal(gap, np.inf)
    assert (classes[gap.argmin(axis=1)] == classes).mean() == 1.0


def test_widths_are_fitted_on_a_third_and_none_is_counted_as_none(fingers):
    data = read_pressed(*find_pressed(fingers, "fingers*.npz", "patch"))
    assert data.classes is not None
    found = describe(PreparedSkin(data.skin), data.files)
    chosen = np.arange(len(data.classes)) % 3 == 0
    _, narrow, finger = fit_thresholds(found, data.classes, chosen, WIDTH)
    counts = count_by_width(found, narrow, finger)
    np.testing.assert_array_equal(counts == 0, data.classes == 0)
    wider = count_by_width(found, narrow + 2 * finger, finger)
    assert (wider <= counts).all()
    region = places(found)
    assert np.bincount(region).sum() == 6 * FILES
    assert np.bincount(region).min() >= 5
    row = judge("x", [np.where(chosen, 9, data.classes)], [~chosen], data.classes)
    assert (row.exact, row.within_one) == (1.0, 1.0)


def grasped(folder: Path) -> Path:
    """Five grasps of four fingers and a palm, and five of a plate, on the sheet."""
    rng = np.random.default_rng(1)
    one = sheet()
    points = one.positions[:, :2]
    gains = np.clip(rng.normal(1.0, 0.2, len(points)), 0.4, 1.6)
    values = []
    for grasp in range(10):
        if grasp % 2 == 0:
            shift = rng.uniform(-0.015, 0.015, 2)
            feet = [np.array([0.03 + 0.02 * k, 0.07]) + shift for k in range(4)]
            load = np.max([ridge(points, f, f + [0.0, 0.03]) for f in feet], axis=0)
            palm = np.exp(
                -((((points - [0.06, 0.03] - shift) / [0.035, 0.02]) ** 2).sum(axis=1) ** 2)
            )
            load = np.maximum(load, palm)
        else:
            turn = rng.uniform(0, np.pi)
            across = (points - points.mean(axis=0)) @ [np.cos(turn), np.sin(turn)]
            load = np.exp(-((across / 0.02) ** 4))
        course = np.concatenate([np.zeros(6), np.linspace(0.2, 1, 4), np.ones(6), np.zeros(4)])
        block = 9000.0 * gains * load * course[:, None]
        values.append(np.abs(block + rng.normal(0.0, 80.0, block.shape)))
    folder.mkdir(parents=True)
    write_cyskin(one, folder / "sheet.json")
    every = np.concatenate(values)
    arrays = {"values": every, "time": np.arange(len(every)) / 10.0}
    np.savez(folder / "hands_1.npz", taxel_ids=one.ids, **arrays)
    return folder


def test_planted_grasps_are_few_contacts(tmp_path):
    found = run(
        "--protocol", "hands", str(grasped(tmp_path / "data")), "--out", str(tmp_path / "out")
    )
    assert found["flips"] == 0
    assert found["edge_error_percent"] <= 0.5
    assert found["contacts_median"] <= 5
    assert found["single_taxels"] == 0.0
    assert found["quiet_contacts"] == 0.0
    assert found["files"] == ["evaluation.json", "report.html"]


def test_hands_stand_beside_fingers_with_a_skin_of_their_own(tmp_path):
    """The layout of the page on fingers: the skin of the sub-folder is that of its recordings."""
    for name in ("fingers.npz", "skin.json", "handles/hands.npz", "handles/skin.json"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    hands = tmp_path / "handles"
    assert find_pressed(tmp_path, "hands*.npz", "handles") == (
        hands / "hands.npz",
        hands / "skin.json",
    )
    (hands / "two.json").touch()
    with pytest.raises(SkinError, match=r"2 skins \(handles/skin.json, handles/two.json\)"):
        find_pressed(tmp_path, "hands*.npz", "handles")


def test_bad_data_is_refused_with_one_line(tmp_path, fingers):
    said = refused("--protocol", "fingers")
    assert "needs its file or folder; got 0 of them" in said
    assert "expected a folder with fingers*.npz" in refused(
        "--protocol", "fingers", str(tmp_path / "nothing")
    )
    assert "expected samples there" in refused("--protocol", "hands", str(fingers))

    def altered(name, **change):
        with np.load(fingers / "fingers.npz") as arrays:
            held = {**arrays}
        for key, value in change.items():
            held[key] = value(held[key]) if callable(value) else value
        held = {key: value for key, value in held.items() if value is not None}
        folder = tmp_path / name
        folder.mkdir()
        (folder / "sheet.json").write_bytes((fingers / "sheet.json").read_bytes())
        np.savez(folder / "fingers.npz", **held)
        return folder

    for name, change, expected in (
        ("classes", {"file_class": None}, "no array 'file_class'"),
        ("hands", {"file_class": lambda c: c + 3}, "expected two or more numbers of 0 to 5"),
        (
            "few",
            {"file_class": lambda c: np.where(np.arange(len(c)) < 2, 0, 1)},
            "2 recordings of 0",
        ),
        ("other", {"taxel_ids": lambda ids: ids + 10**6}, "another skin"),
        ("short", {"times": lambda times: times[:5]}, "times of shape (5,)"),
        ("nan", {"times": lambda times: times * np.nan}, "times must hold finite numbers"),
        ("gaps", {"file_index": lambda one: one * 2}, "must count 0, 1, 2"),
        ("width", {"taxel_ids": lambda ids: ids[:-1]}, "one column each"),
    ):
        assert expected in refused("--protocol", "fingers", str(altered(name, **change))), name
    (tmp_path / "gaps" / "second.json").write_text("{}")
    assert "2 skins" in refused("--protocol", "fingers", str(tmp_path / "gaps"))
    assert "simulates its touches" in refused("--protocol", "kaspar", str(fingers))


@REAL
def test_real_hands_are_few_contacts():
    found = run("--protocol", "hands", str(DATA))
    assert (found["taxels"], found["samples"], found["flips"]) == (640, 401, 0)
    assert found["edge_error_percent"] <= 0.5
    assert found["contacts_median"] <= 4
    assert found["single_taxels"] <= 0.05
    assert found["pieces_median"] > found["contacts_median"]


@REAL
def test_real_fingers_are_counted_without_training():
    """The whole protocol, trained too, is in benchmarks/results/real_fingers.json."""
    from skinmap.recognition.protocols.fingers import FIRST, chosen_number

    data = read_pressed(*find_pressed(DATA, "fingers*.npz", "gesture_patch"))
    assert (len(data.files), data.unplaced, data.unrecorded) == (188, 82, 8)
    assert data.classes is not None
    skin = PreparedSkin(data.skin)
    touch, _ = chosen_number(describe(skin, data.files), data.classes, [0, 1])
    assert touch.exact >= 0.55
    assert touch.within_one >= 0.92
    control, _ = chosen_number(describe(skin, data.files, first=FIRST), data.classes, [0, 1])
    assert control.exact <= 0.3
