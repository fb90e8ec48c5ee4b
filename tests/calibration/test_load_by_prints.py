"""Prints beside a chamber: areas and spread of planted stamps through a planted foam come back."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner

import skinmap
from skinmap.cli.main import cli
from skinmap.live.response.loads import PartForces, heaviest_load
from skinmap.touch.load_calibration import LoadCalibration
from skinmap.touch.prepared_skin import PreparedSkin

RATE, EACH = 50.0, 40


@pytest.fixture(scope="module")
def skin():
    return skinmap.load_robot("icub").skin("left_forearm")


@cache
def foam_of(skin, foam=5e-3):
    """Points (p, 3) of the skin's surface, the area of each, and its share (n, p) at each taxel."""
    mesh = skinmap.build_surface(skin)
    dense = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    points = trimesh.sample.sample_surface_even(dense, 40_000, seed=1)[0]
    cell = dense.area / len(points)
    away = ((skin.positions[:, None] - points[None]) ** 2).sum(axis=2)
    return points, cell, np.exp(-away / (2 * foam**2)) * cell / (2 * np.pi * foam**2)


def stamps(skin, seed, count):
    """Counts (t, n) of flat stamps on the skin, touch of each row, areas (count,) [mm2]."""
    rng = np.random.default_rng(seed)
    points, cell, felt = foam_of(skin)
    inner = np.flatnonzero(felt.sum(axis=1) > 0.97)
    loads, events, areas, pushes = [], [], [], []
    for k in range(count):
        radius = rng.uniform(0.004, 0.014)
        centre = skin.positions[rng.choice(inner)] + rng.normal(0, 1e-3, 3)
        under = np.linalg.norm(points - centre, axis=1) < radius
        areas.append(1e6 * cell * under.sum())
        pushes.append(rng.uniform(0.3, 1.2))
        push = pushes[-1] * np.sin(np.linspace(0, np.pi, EACH))
        loads += [np.outer(push, felt @ under), np.zeros((10, len(skin)))]
        events += [k] * EACH + [-1] * 10
    return counted(np.concatenate(loads), seed), np.array(events), np.array(areas), np.array(pushes)


def counted(loads, seed):
    """What taxels of different gains send [counts]."""
    gains = np.random.default_rng(7).normal(60, 8, loads.shape[1])
    noise = np.random.default_rng(seed).normal(0, 0.4, loads.shape)
    return np.clip((240 - loads * gains + noise).round(), 0, 255).astype(np.uint8)


def write(folder, skin):
    load = np.interp(np.arange(4000), np.arange(0, 4000, 100),
                     np.random.default_rng(1).uniform(0, 2, 40) * (np.arange(40) > 2))  # fmt: skip
    chamber = counted(np.repeat(load[:, None], len(skin), axis=1), 0)
    np.savez(folder / "chamber.npz", samples=chamber, times=np.arange(4000) / RATE,
             pressure_bar=load)  # fmt: skip
    samples, events, areas, _ = stamps(skin, 3, 30)
    np.savez(folder / "stamps.npz", samples=samples, times=np.arange(len(samples)) / RATE,
             events=events, prints=areas)  # fmt: skip


def run(folder, *words):
    return CliRunner().invoke(
        cli, ["calibrate", "load", *(str(folder / w) if "." in w else w for w in words)]
    )


def judged(skin, calibration, seed=11, zero=0.0, gains=0.0):
    """Relative errors of areas of other stamps, whether their intervals hold; errors of forces.

    `zero` [counts] and the spread of `gains` are those of another day.
    """
    samples, events, areas, pushes = stamps(skin, seed, 30)
    gain = 1.0 + np.random.default_rng(seed).normal(0, gains, samples.shape[1])
    samples = np.rint(240 + (samples - 240.0) * gain + zero)
    if zero:
        calibration = calibration.zero_at(samples[events < 0], 0.0)
    found = calibration.pressures(samples, zero="none" if zero else "auto")
    forces = PartForces(PreparedSkin(skin), calibration.answered, calibration.covering)
    own = [np.flatnonzero(events == k) for k in range(len(areas))]
    ours = [
        heaviest_load(forces, calibration, found, rows, found[0][rows].max(axis=0) > 0.05)
        for rows in own
    ]
    area, low, high = np.array([one.area for one in ours]).T * 1e6
    force = np.array([one.force.value for one in ours]) / (0.1 * areas * pushes)
    return np.abs(area / areas - 1), (low <= areas) & (areas <= high), np.abs(force - 1)


def test_prints_teach_areas_and_the_spread_of_the_foam(skin, tmp_path):
    write(tmp_path, skin)
    part = ["--part", "left_forearm"]
    assert run(tmp_path, "chamber.npz", *part, "-o", "plain.d").exit_code == 0
    out = run(tmp_path, "chamber.npz", "stamps.npz", *part, "-o", "taught.d", "--json")
    assert out.exit_code == 0, out.output
    result = json.loads(out.stdout)
    assert result["prints"] == 30
    assert result["print_error"] < 0.1
    assert result["spread_mm"] == pytest.approx(5.0, abs=0.8)
    plain = judged(skin, LoadCalibration.read(tmp_path / "plain.d"))
    taught = judged(skin, LoadCalibration.read(tmp_path / "taught.d"))
    assert np.median(plain[0]) > 1.0  # the control: areas without prints
    assert np.median(taught[0]) < 0.15
    assert taught[1].mean() >= 0.85
    assert np.median(taught[2]) < np.median(plain[2]) + 0.01
    other = judged(skin, LoadCalibration.read(tmp_path / "taught.d"), zero=-1.0, gains=0.037)
    assert other[1].mean() >= 0.85  # 0.67 by the residual of the fit alone


def test_prints_alone_of_no_part_or_of_other_touches_are_refused(skin, tmp_path):
    write(tmp_path, skin)
    part = ["--part", "left_forearm", "-o", "none.d"]
    held = dict(np.load(tmp_path / "stamps.npz"))
    changed = {
        "shuffled.npz": {"prints": np.random.default_rng(5).permutation(held["prints"])},
        "few.npz": {"events": np.where(held["events"] > 2, -1, held["events"])},
        "zero.npz": {"prints": held["prints"] * (np.arange(30) != 4)},
        "beyond.npz": {"events": held["events"] + 5},
        "pictures.npz": {"prints": np.zeros((30, 8, 8), np.uint8)},
    }
    for name, change in changed.items():
        np.savez(tmp_path / name, **(held | change))
    del held["events"]
    np.savez(tmp_path / "eventless.npz", **held)
    for words, message in {
        ("stamps.npz", *part): "a file with a known load is needed",
        ("chamber.npz", "stamps.npz", "-o", "none.d"): "prints need --part",
        ("chamber.npz", "few.npz", *part): "3 prints are felt, 5 are needed",
        ("chamber.npz", "shuffled.npz", *part): "do not follow the prints",
        ("chamber.npz", "zero.npz", *part): "print 4 has no area",
        ("chamber.npz", "beyond.npz", *part): "events must be whole numbers to 29",
        ("chamber.npz", "pictures.npz", *part): "areas (k,) [mm2]",
        ("chamber.npz", "eventless.npz", *part): "prints need `events (t,)`",
    }.items():
        refused = run(tmp_path, *words)
        assert refused.exit_code != 0
        assert message in str(refused.exception)
    assert not (tmp_path / "none.d").exists()
