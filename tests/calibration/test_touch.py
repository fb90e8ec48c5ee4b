"""Taxels located by touches: planted truth, wrong touches, dead taxels, too little coverage."""

from __future__ import annotations

import numpy as np
import pytest

from calibration import Status, Touch, locate_by_touch
from calibration.patch.link_surface import make_board, make_target
from calibration.patch.placing import check_touches, consistent
from skinmap.errors import InvalidArrayError


def miss(found, places) -> float:
    return float(np.median(np.linalg.norm(found.positions - places, axis=1)))


def touched(bent, count, rng, *, noise=1e-3, wrong=0.0, dead=0.0, inside=None):
    """Simulated touches: values fall off with the distance, gains spread by a quarter."""
    n = len(bent.layout)
    gain = np.exp(rng.normal(0, 0.25, n)) * (rng.random(n) >= dead)
    low, high = bent.layout.min(axis=0), bent.layout.max(axis=0)
    if inside is not None:
        low, high = bent.layout[inside].min(axis=0), bent.layout[inside].max(axis=0)
    touches = []
    while len(touches) < count:
        place = rng.uniform(low, high)
        value = gain * np.exp(-np.sum((bent.layout - place) ** 2, axis=1) / (2 * 4e-3**2))
        felt = np.flatnonzero(value > 0.08)
        if len(felt) == 0:
            continue
        if rng.random() < wrong:
            place = rng.uniform(bent.layout.min(axis=0), bent.layout.max(axis=0))
        angle = place[0] / 45e-3
        point = np.array([45e-3 * np.cos(angle), 45e-3 * np.sin(angle), place[1]])
        touches.append(Touch(point + rng.normal(0, noise, 3), noise, felt, value[felt]))
    return touches


def locate(bent, touches, **words):
    return locate_by_touch(
        bent.layout, bent.vertices, bent.faces, touches, rng=np.random.default_rng(1), **words
    )


def test_what_a_touch_misses_is_its_distance_from_what_was_felt(bent, rng):
    """The error of its centre counts in the fit, and not in this distance."""
    touches = touched(bent, 32, rng)
    found = locate(bent, touches)
    for row, touch in enumerate(touches):
        felt = touch.values @ found.positions[touch.channels] / touch.values.sum()
        missed = np.linalg.norm(felt - touch.point)
        assert found.left_out.missed[row] == pytest.approx(missed, rel=0.05, abs=2e-4)


def test_touches_alone_place_the_patch(bent, rng):
    found = locate(bent, touched(bent, 32, rng))
    assert found.status is Status.OK
    assert found.residuals["touches"].shape == (32, 3)
    assert miss(found, bent.places) < 2 * np.median(found.predicted_sd)
    assert miss(found, bent.places) < 1.5e-3


def test_far_from_touches_that_cover_little_the_stated_error_grows_with_the_distance(bent, rng):
    inside = np.linalg.norm(bent.layout - bent.layout[0], axis=1) < 15e-3
    found = locate(bent, touched(bent, 16, rng, inside=inside))
    assert found.status is not Status.OK
    away = np.linalg.norm(bent.layout - bent.layout[inside].mean(axis=0), axis=1)
    far = np.argmax(away)
    # 3 % of the way from the hull, which reaches at most 22 mm (a half diagonal) from its middle.
    floor = 0.03 * (away[far] - 22e-3)
    assert np.sqrt(np.linalg.eigvalsh(found.covariance[far])[0]) > floor > 0.5e-3


def test_wrong_touches_and_dead_taxels_do_little_harm(bent, rng):
    touches = touched(bent, 64, rng, noise=2e-3, wrong=0.3, dead=0.2)
    found = locate(bent, touches)
    assert found.status is Status.OK
    assert miss(found, bent.places) < 2.5e-3


def test_consistent_leaves_most_wrong_touches_out(bent, rng):
    touches = touched(bent, 40, rng)
    for row in range(0, 40, 4):  # every fourth point is that of another touch
        other = touches[(row + 13) % 40]
        touches[row] = Touch(other.point, other.sigma, touches[row].channels, touches[row].values)
    target = make_target(bent.vertices, bent.faces)
    felt = check_touches(bent.layout, (bent.vertices, bent.faces), touches)
    taken = consistent(target, make_board(bent.layout), felt)
    wrong = np.arange(40) % 4 == 0
    far = np.linalg.norm((felt.blend @ bent.layout)[(np.arange(40) + 13) % 40] -
                         felt.blend @ bent.layout, axis=1) > 20e-3  # fmt: skip
    assert taken[~wrong].mean() > 0.8
    assert not taken[wrong & far].any()


def test_too_little_coverage_is_never_ok(bent, rng):
    few = locate(bent, touched(bent, 7, rng))
    assert few.status is not Status.OK
    assert any("7 touches" in reason for reason in few.reasons)
    corner = np.array([0, 1, 2, 8, 9, 10, 16, 17, 18])
    crowded = locate(bent, touched(bent, 32, rng, inside=corner))
    assert crowded.status is not Status.OK
    nearest = np.linalg.norm(bent.layout[crowded.next_taxels[0]] - bent.layout[corner], axis=1)
    assert nearest.min() > 20e-3  # the next touch is asked for where there was none


def test_anchors_help_where_touches_are_few(bent, rng):
    taxels, points = bent.anchors(0.5e-3, rng)
    found = locate(bent, touched(bent, 5, rng), anchors=(taxels, points), anchor_sigma=0.5e-3)
    assert found.status is Status.OK
    assert set(found.residuals) == {"touches", "anchors", "strain"}
    assert miss(found, bent.places) < 1e-3


def test_locate_by_touch_of_the_same_seed_gives_the_same_bits(bent, rng):
    touches = touched(bent, 12, rng)
    one, two = locate(bent, touches), locate(bent, touches)
    assert one.positions.tobytes() == two.positions.tobytes()


GOOD = ([0.045, 0, 0], 1e-3, [3, 4], [1.0, 2.0])


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (([0.045, np.nan, 0], 1e-3, [3], [1.0]), "the point of touch 2 holds NaN"),
        (([0.045, 0, 0], 0.0, [3], [1.0]), "the sigma of touch 2"),
        (([0.045, 0, 0], 1e-3, [72], [1.0]), r"touch 2 has taxel 72, the layout has 0..71"),
        (([0.045, 0, 0], 1e-3, [3, 4], [1.0]), "touch 2 has 1 values for channels"),
        (([0.045, 0, 0], 1e-3, [3], [0.0]), "touch 2 has no value above 0"),
        (([0.045, 0, 0], 1e-3, [3], [np.inf]), "the values of touch 2 holds NaN or inf"),
    ],
)
def test_locate_by_touch_names_the_touch_that_is_wrong(bent, bad, message):
    with pytest.raises(InvalidArrayError, match=message):
        locate(bent, [Touch(*GOOD), Touch(*GOOD), Touch(*bad)])


def test_locate_by_touch_names_units_and_counts(bent, rng):
    with pytest.raises(InvalidArrayError, match="at least 3 touches, got 2"):
        locate(bent, [Touch(*GOOD)] * 2)
    large = [Touch(1e3 * t.point, t.sigma, t.channels, t.values) for t in touched(bent, 12, rng)]
    with pytest.raises(InvalidArrayError, match=r"touches in millimetres\? .* by 0.001"):
        locate(bent, large)


def test_touch_command_says_where_to_touch_next(tmp_path, bent, rng):
    import json

    import trimesh
    from click.testing import CliRunner

    from skinmap.cli.main import cli

    rows = [f"{k},{x!r},{y!r}" for k, (x, y) in enumerate(bent.layout.tolist())]
    (tmp_path / "board.csv").write_text("\n".join(["channel,x,y", *rows]) + "\n")
    trimesh.Trimesh(bent.vertices, bent.faces).export(tmp_path / "link.ply")
    rows = [
        ",".join(map(str, [number, *touch.point.tolist(), channel, value]))
        for number, touch in enumerate(touched(bent, 24, rng))
        for channel, value in zip(touch.channels.tolist(), touch.values.tolist(), strict=True)
    ]
    words = ["calibrate", "wrap", "-o", str(tmp_path / "out"), "--json"]
    for name in ("layout", "mesh", "touches"):
        file = {"layout": "board.csv", "mesh": "link.ply", "touches": "touches.csv"}[name]
        words += [f"--{name}", str(tmp_path / file)]
    head = "touch,x,y,z,channel,value\n"
    (tmp_path / "touches.csv").write_text(head + "\n".join(rows) + "\n")
    done = CliRunner().invoke(cli, words)
    assert done.exit_code == 0, done.output
    result = json.loads(done.stdout)
    assert result["status"] == "ok"
    assert result["touches"] == 24
    assert len(result["next"]) == 3
    assert 0.2 < result["cross_validation_mm"] < 4.0
    assert (tmp_path / "out" / "taxels.csv").exists()
    (tmp_path / "touches.csv").write_text(head + "0,0,0,0,3,1\n0,0,0,1,4,1\n")
    done = CliRunner().invoke(cli, words)
    assert "touches.csv:3: touch 0 has two places" in str(done.exception)


def test_touches_on_a_board_drawn_from_its_other_side_are_told(bent, rng):
    touches = touched(bent, 24, rng)
    found = locate_by_touch(
        bent.layout * [-1.0, 1.0], bent.vertices, bent.faces, touches,
        rng=np.random.default_rng(1),
    )  # fmt: skip
    assert found.status is not Status.OK
    assert found.mirrored
    assert "drawn from the other side" in found.reasons[0]


def test_a_touch_that_one_channel_felt_may_be_anywhere_in_its_cell(bent, rng):
    layout, vertices, faces = bent.layout, bent.vertices, bent.faces
    touches = touched(bent, 12, rng)
    lone = [Touch(t.point, t.sigma, t.channels[:1], t.values[:1] + 1.0) for t in touches]
    wide = check_touches(layout, (vertices, faces), lone).sigma
    pitch = np.median(np.sort(np.linalg.norm(layout[:, None] - layout[None], axis=2))[:, 1])
    assert (wide > 0.28 * pitch).all()
