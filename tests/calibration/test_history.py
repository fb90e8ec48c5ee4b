"""Check-ups that are kept: files that are never replaced, and taxels that change between them."""

from __future__ import annotations

from datetime import UTC, datetime
from functools import cache

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks.calibration.person import SimulatedSkin
from calibration.wiring import Doctor, boards_of, make_touch
from calibration.wiring.examination import Plan, examine_live
from calibration.wiring.findings import findings, with_changes
from calibration.wiring.history import (
    FORMAT,
    KeptCheckup,
    KeptPart,
    KeptTouch,
    changes_of,
    earlier_checkups,
    keep_checkup,
    kept_part,
)
from calibration.wiring.touches import gains_told
from skinmap.cli.main import cli
from skinmap.errors import DataFormatError, OutputError, SkinMismatchError
from skinmap.io.robots.manifest import load_robot
from viewer.layers import Layers
from viewer.view_options import Session

PART = "left_forearm"
TIMES = [f"2026-{month:02}-03T10:00:00+00:00" for month in (9, 10, 11)]


@cache
def strokes():
    """Paths of strokes all over."""
    doctor = Doctor.of(boards_of(load_robot("icub"), PART))
    doctor.next_place("stroke")
    return doctor.places["stroke"].paths[::3]


@pytest.fixture(scope="module")
def healthy(icub):
    """An examination that finds nothing."""
    skin = SimulatedSkin(icub, PART, [], 3)
    return examine_live(skin, icub, (PART,), Plan(markers=[skin]))


def kept(boards, rng, weak=(), baseline=0.0, odd=0.0, exchanged=()):
    """A check-up with strokes all over, of a finger that wanders beside where it was asked for."""
    gains = np.exp(np.random.default_rng(1).normal(0.0, 0.25, len(boards.table)))
    gains[list(weak)] *= 0.7
    told = []
    for path in strokes():
        track = np.array([np.interp(np.linspace(0, len(path) - 1, 30), np.arange(len(path)), own)
                          for own in path.T]).T + rng.normal(0, 2e-3, 3)  # fmt: skip
        away = np.linalg.norm(boards.table.positions - track[:, None], axis=2)
        force = 150 * np.exp(np.cumsum(rng.normal(0, 0.05, (30, 1)), axis=0))
        samples = force * np.exp(-(away**2) / 2 / 6e-3**2) * gains
        samples = samples * np.exp(rng.normal(0.0, odd, len(gains)))
        samples[:, exchanged] = samples[:, exchanged[::-1]]
        samples = np.minimum(np.rint(samples + rng.normal(0, 1.2, samples.shape)), 255.0)
        one = gains_told(boards, make_touch(samples, "stroke", path, samples), gains > 0)
        triangle = one.precision[np.triu_indices(len(one.rows))]
        told.append(KeptTouch(one.rows.tolist(), one.pull.tolist(), triangle.tolist()))
    level = np.zeros(len(gains))
    level[7] = baseline
    return KeptPart(boards.table.channels.tolist(), level.tolist(), [0.5] * len(level), told)


def test_a_taxel_that_loses_gain_is_named_after_two_checkups(icub):
    boards = boards_of(icub, PART)
    rng = np.random.default_rng(0)
    weak = (100, 150, 33)
    several = [kept(boards, rng), kept(boards, rng, weak), kept(boards, rng, weak, 20.0)]
    found = {one.row: one for one in changes_of(PART, TIMES, several)[0]}
    assert {*weak, 7} <= set(found)
    assert len(found) <= 4 + 0.01 * len(boards.table)  # false ones: 1 % at most is asked for
    assert found[100].kind == "weaker"
    assert found[100].words.endswith("since 3 October 2026")
    assert all(22 <= int(found[row].words[10:12]) <= 38 for row in weak)
    assert found[7].words == "its rest lies 20 counts higher since 3 November 2026"
    assert changes_of(PART, TIMES[:2], several[:2])[0] == []  # one check-up may err


def test_what_the_last_checkup_alone_shows_is_not_dated_before_it(icub):
    """Half of a loss was named, since a check-up at which the taxel was sound."""
    boards, rng = boards_of(icub, PART), np.random.default_rng(0)
    times = [f"2026-{month:02}-03T10:00:00+00:00" for month in range(1, 6)]
    several = [kept(boards, rng, weak) for weak in ([], [], [], [100], [100])]
    assert changes_of(PART, times[:4], several[:4])[0] == []
    found = changes_of(PART, times, several)[0]
    assert [(one.row, one.since[5:7]) for one in found] == [(100, "04")]


def test_exchanged_channels_are_no_change_of_gain(icub, tmp_path):
    """They were "stronger by 666 %", and sound taxels beside them weaker."""
    boards, rng = boards_of(icub, PART), np.random.default_rng(0)
    wrong = [100, 150]
    several = [kept(boards, rng, exchanged=one) for one in ([], wrong, wrong)]
    found = changes_of(PART, TIMES, several)[0]
    assert {one.row for one in found} <= set(wrong)
    assert {one.kind for one in found} == {"swapped_channels"}
    assert "exchanged channels" in found[0].words
    for one, time in zip(several, TIMES, strict=True):
        file = tmp_path / f"checkup_{time[:10]}.json"
        file.write_bytes(msgspec.json.encode(
            KeptCheckup(FORMAT, time, icub.name, "healthy", [], {PART: one})))  # fmt: skip
    session = Session(icub, (PART,), checkups=tmp_path)
    session.prepare()
    layer = Layers(session.skins, changed=session.changed).get("changed")
    row = found[0].row
    assert layer.categories[int(layer.values(PART, None)[row])] == "feels elsewhere"


def test_touches_that_disagree_change_no_sound_taxel(icub):
    """Fingers that press some taxels more in one stroke than in the next: 45 were named."""
    boards, rng = boards_of(icub, PART), np.random.default_rng(0)
    several = [kept(boards, rng, odd=0.15) for _ in range(3)]
    assert len(changes_of(PART, TIMES, several)[0]) <= 1


def test_a_moved_rest_keeps_its_date_and_may_come_back():
    """It was dated by the latest check-up, and forgotten after as many as before."""
    times = [f"2026-{month:02}-03T10:00:00+00:00" for month in range(1, 10)]

    def named(levels, noises=()):
        noises = noises or [0.5] * len(levels)
        parts = [
            KeptPart([0, 1, 2], [level, 20.0, 20.0], [noise, 0.5, 0.5])
            for level, noise in zip(levels, noises, strict=True)
        ]
        return [(one.kind, one.row, one.since[5:7])
                for one in changes_of(PART, times[: len(parts)], parts)[0]]  # fmt: skip

    for after in range(1, 6):
        assert named([20.0] * 3 + [60.0] * after) == [("moved", 0, "04")]
    assert named([20.0, 60.0, 60.0, 20.0, 20.5]) == []
    assert named([20.0] * 6, [0.5] * 3 + [4.0] * 3) == [("noisier", 0, "04")]


def test_checkups_of_another_robot_are_named(healthy, tmp_path):
    folder = tmp_path / "checkups"
    folder.mkdir()
    other = KeptCheckup(FORMAT, TIMES[0][:19], "other", "healthy", [], {})
    (folder / "checkup_0.json").write_bytes(msgspec.json.encode(other))
    found = healthy
    before = earlier_checkups(folder)
    assert before[0].time == TIMES[0]  # without a zone: UTC
    result = findings(found)
    history = keep_checkup(folder, before, found, result, datetime(2026, 11, 3, 10, tzinfo=UTC))
    result = with_changes(result, found.cases, history)
    assert result.checkups == 1
    assert result.notes[-1].startswith(f"{PART} is not in 1 of the earlier check-ups")


def test_a_recording_of_before_is_compared_with_older_checkups_alone(icub, healthy, tmp_path):
    found = healthy
    kept_now = kept_part(found.cases[0])
    moved = msgspec.structs.replace(kept_now, baseline=[30.0] * len(kept_now.baseline))
    later = [KeptCheckup(FORMAT, time, icub.name, "healthy", [], {PART: moved}) for time in TIMES]
    when = datetime(2026, 1, 3, 10, tzinfo=UTC)
    history = keep_checkup(tmp_path / "checkups", later, found, findings(found), when)
    assert history.changes == []
    assert history.compared == 1
    assert history.notes == ["3 later check-ups of the history are not compared"]


def test_checkups_of_a_person_find_what_became_weaker(icub):
    boards = boards_of(icub, PART)
    rows = [12, 60, 111, 170, 222]
    weak = [f"weak:{channel},30" for channel in boards.table.channels[rows]]
    several = []
    for seed, plant in enumerate(([], weak, weak)):
        skin = SimulatedSkin(icub, PART, plant, seed)
        case = examine_live(skin, icub, (PART,), Plan(markers=[skin], covers=True)).cases[0]
        several.append(kept_part(case))
    found = [one.row for one in changes_of(PART, TIMES, several)[0] if one.kind == "weaker"]
    assert sorted(found) == rows


def test_each_checkup_is_kept_beside_those_before(icub, tmp_path):
    folder = tmp_path / "checkups"
    for day in (3, 4):
        skin = SimulatedSkin(icub, PART, [], day)
        found = examine_live(skin, icub, (PART,), Plan(markers=[skin], covers=True))
        before = earlier_checkups(folder)
        when = datetime(2026, 11, day, 10, tzinfo=UTC)
        result = findings(found)
        kept = keep_checkup(folder, before, found, result, when)
        result = with_changes(result, found.cases, kept)
    assert (result.status, result.checkups, len(result.files)) == ("healthy", 2, 2)
    names = sorted(path.name for path in folder.iterdir())
    assert names == ["checkup_2026-11-03T10-00-00.json", "checkup_2026-11-04T10-00-00.json",
                     "checkup_2026-11-04T10-00-00.pdf"]  # fmt: skip
    assert all(path.stat().st_size < 300_000 for path in folder.iterdir())
    with pytest.raises(OutputError, match="there already"):
        keep_checkup(folder, before, found, result, when)
    first = folder / names[0]
    for damaged in (first.read_text()[:500], "[]", first.read_text().replace("up 1", "up 9")):
        first.write_text(damaged)
        with pytest.raises(DataFormatError, match="not a kept check-up"):
            earlier_checkups(folder)


def test_the_layer_of_changes_has_what_became_weaker_or_moved(icub, tmp_path):
    boards, rng, weak = boards_of(icub, PART), np.random.default_rng(0), (100, 150, 33)
    several = kept(boards, rng), kept(boards, rng, weak), kept(boards, rng, weak, 20.0)
    for number, (time, one) in enumerate(zip(TIMES, several, strict=True)):
        own = KeptCheckup(FORMAT, time, icub.name, "healthy", [], {PART: one})
        (tmp_path / f"checkup_{number}.json").write_bytes(msgspec.json.encode(own))
    session = Session(icub, (PART, "torso"), checkups=tmp_path)
    session.prepare()
    layer = Layers(session.skins, changed=session.changed).get("changed")
    assert layer.title == "changes since 2026-09-03"
    values = layer.values(PART, None)
    names = [layer.categories[int(value)] for value in values]
    assert [names[row] for row in (*weak, 7)] == ["weaker"] * 3 + ["rest moved"]
    assert names.count("as before") >= len(names) - 4 - 0.01 * len(names)
    assert np.isnan(layer.values("torso", None)).all()
    with pytest.raises(SkinMismatchError, match="here are 3 of iCub left_forearm"):
        Session(icub, ("torso",), checkups=tmp_path).prepare()


@pytest.mark.parametrize(
    ("words", "answer"),
    [
        (["{}"], "write ROBOT --calibration {} --layer changed"),
        (["icub", "--calibration", PART + "={}"], "without PART="),
        (["icub", *["--calibration", "{}"] * 2], "takes one folder of check-ups"),
        (["icub", "--calibration", "{}"], "not a kept check-up"),
    ],
)
def test_a_wrong_history_gets_one_line(words, answer, tmp_path):
    (tmp_path / "checkup_1.json").write_text("[]")
    picture = tmp_path / "changed.png"
    given = [word.format(tmp_path) for word in words]
    done = CliRunner().invoke(cli, ["view", *given, "--screenshot", str(picture)])
    text = done.output + str(done.exception)
    assert done.exit_code != 0
    assert answer.format(tmp_path) in text
    assert not picture.exists()
