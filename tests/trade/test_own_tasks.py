"""Our own tasks on a small part: real runs, short, and what their figures must obey."""

from __future__ import annotations

import numpy as np
import pytest

import skinmap
from skinmap.cli.trade import every_task
from skinmap.flat.flat_map import flatten
from skinmap.surface.surface_mesh import build_surface
from skinmap.trade import tasks
from skinmap.trade.tasks import classify_task, edge_rms, flatten_task


@pytest.fixture(scope="module")
def kaspar():
    return skinmap.load_robot("kaspar")


def test_our_tasks_are_registered():
    assert every_task() == {"flatten": flatten_task, "classify": classify_task}


@pytest.mark.parametrize("task", [flatten_task, classify_task])
def test_settings_name_known_knobs_with_their_values_each_once(task):
    knobs = {knob.name: knob for knob in task.knobs}
    settings = task.settings()
    assert len({tuple(sorted(one.items())) for one in settings}) == len(settings)
    for setting in settings:
        for name, value in setting.items():
            assert value in knobs[name].values
    used = {(name, value) for one in settings for name, value in one.items()}
    for name, knob in knobs.items():
        assert sum(n == name for n, _ in used) >= 1
        assert knob.default in knob.values


def test_flattening_measures_the_edges_of_the_map(kaspar):
    setting = {"meshing": "consensus", "method": "balanced", "iterations": 2}
    pieces = flatten_task.prepare(kaspar, ("right_hand",), seed=0)
    found = flatten_task.run(pieces, setting, seed=0)
    flat = flatten(build_surface(kaspar.skin("right_hand")), method="balanced", iterations=2)
    assert found.error == pytest.approx(100.0 * edge_rms([flat]), rel=1e-12)
    if len(flat.charts) == 1:
        assert found.error == pytest.approx(100.0 * flat.charts[0].distortion.edge_rms)
    assert found.seconds > 0
    assert found.beside == {"unmeshed": 0.0}


@pytest.fixture
def untimed(monkeypatch):
    """Work is called once, and not to measure it."""
    monkeypatch.setattr(tasks, "cpu_seconds", lambda work: (1e-6, work()))


@pytest.mark.usefixtures("untimed")
def test_every_setting_of_flattening_runs(kaspar):
    prepared = flatten_task.prepare(kaspar, ("right_hand",), seed=0)
    settings = [one for one in flatten_task.settings() if one["meshing"] != "accurate"]
    errors = {str(one): flatten_task.run(prepared, one, seed=0).error for one in settings}
    assert all(np.isfinite(list(errors.values())))


@pytest.mark.usefixtures("untimed")
def test_classifying_is_the_same_for_the_same_seed_and_not_for_another(kaspar, monkeypatch):
    monkeypatch.setattr(tasks, "LEARNT", 6)
    monkeypatch.setattr(tasks, "TESTED", 4)
    setting = {"classifier": "histogram", "words": 4}
    drawn = [classify_task.prepare(kaspar, ("right_hand",), seed=seed) for seed in (1, 1, 2)]
    runs = [
        classify_task.run(prepared, setting, seed=seed)
        for prepared, seed in zip(drawn, (1, 1), strict=False)
    ]
    assert runs[0].error == runs[1].error
    assert not np.array_equal(drawn[0].tested[0].samples, drawn[2].tested[0].samples)
    # Whole touches of those named, in percent.
    assert (runs[0].error * len(drawn[0].tested) / 100.0) % 1 == pytest.approx(0.0, abs=1e-9)
    assert all(0.0 <= run.error <= 100.0 for run in runs)
    assert runs[0].beside["training_seconds"] > runs[0].seconds


def test_of_several_parts_one_is_never_learnt_from(kaspar, monkeypatch):
    monkeypatch.setattr(tasks, "LEARNT", 1)
    monkeypatch.setattr(tasks, "TESTED", 1)
    parts = ("right_hand", "left_hand")
    for seed in (0, 1):
        prepared = classify_task.prepare(kaspar, parts, seed=seed)
        learnt = {touch.skin.skin.part for touch in prepared.learnt}
        tested = {touch.skin.skin.part for touch in prepared.tested}
        assert tested == {parts[seed]}
        assert learnt == set(parts) - tested
