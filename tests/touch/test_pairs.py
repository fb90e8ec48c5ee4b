from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from skinmap.errors import InvalidArrayError, UnknownNameError
from skinmap.recognition.protocols.transfer import cut_into_patches
from skinmap.skin.skin import skin_from_points
from skinmap.touch.recording import Recording, load_recordings, save_recordings
from skinmap.touch.simulation.gestures import EIGHT, GESTURES
from skinmap.touch.simulation.hands import HAND, OTHER, gesture_set
from skinmap.touch.simulation.simulator import APART, simulate, simulate_pairs
from skinmap.touch.simulation.variety import FULL_SCALE, Sensing, Sensors, draw_subjects


@pytest.fixture(scope="module")
def pairs(icub):
    return simulate_pairs(icub.skin("torso"), rng=np.random.default_rng(2), count=4, variety=0.0)


def test_pairs_overlap_in_time_at_distinct_places(icub, pairs):
    points = icub.skin("torso").positions
    assert len(pairs.labels) >= 3
    for event, label, samples in pairs.touches():
        assert len(label.split("+")) == 2
        own = [samples[:, pairs.owners[event] == k] > 12 for k in (0, 1)]
        assert (own[0].any(axis=1) & own[1].any(axis=1)).sum() >= 3
        felt = [points[pairs.owners[event] == k][own[k].any(axis=0)] for k in (0, 1)]
        distance, _ = cKDTree(felt[0]).query(felt[1])
        assert distance.min() >= APART


def test_pairs_do_not_fit_a_palm(icub, rng):
    pairs = simulate_pairs(
        icub.skin("left_hand"), rng=rng, count=2, gestures=["whole_hand"], variety=0.0
    )
    assert pairs.labels == ()
    assert pairs.owners.shape == (0, 48)


def test_owners_and_subjects_come_back_from_a_file(tmp_path, pairs):
    save_recordings([pairs], tmp_path / "p.npz")
    (back,) = load_recordings(tmp_path / "p.npz")
    np.testing.assert_array_equal(back.owners, pairs.owners)
    np.testing.assert_array_equal(back.subjects, pairs.subjects)


def test_files_without_subjects_load_as_before(tmp_path, pairs):
    save_recordings([pairs], tmp_path / "p.npz")
    with np.load(tmp_path / "p.npz") as arrays:
        old = {k: v for k, v in arrays.items() if k.split("_")[0] not in ("subjects", "owners")}
    np.savez(tmp_path / "old.npz", **old)
    (back,) = load_recordings(tmp_path / "old.npz")
    assert back.owners is None
    np.testing.assert_array_equal(back.subjects, np.zeros(len(pairs.labels)))


def test_recording_refuses_subjects_and_owners_of_another_shape():
    empty = (np.zeros(1), np.zeros((1, 3), np.uint8), np.zeros(1, int), ("poke",))
    with pytest.raises(InvalidArrayError, match=r"subjects must have shape \(1,\)"):
        Recording("p", *empty, subjects=np.arange(2))
    with pytest.raises(InvalidArrayError, match=r"owners must have shape \(1, 3\)"):
        Recording("p", *empty, owners=np.zeros((1, 2), int))


def test_every_gesture_fits_an_upper_leg_and_is_wider_where_it_should_be(icub):
    recording = simulate(
        icub.skin("left_leg_upper"),
        rng=np.random.default_rng(4),
        per_gesture=5,
        gestures=tuple(GESTURES),
        variety=0.0,
    )
    active = {name: [] for name in GESTURES}
    for _, label, samples in recording.touches():
        active[label].append((samples > 12).any(axis=0).sum())
    size = {name: np.median(counts) for name, counts in active.items()}
    assert size["poke"] < size["elbow"] < size["forearm"]
    assert size["poke"] < size["edge"] < size["cylinder"] < size["forearm"]
    assert size["poke"] < size["ball"] < size["whole_hand"]


def test_habitual_touches_come_back_to_their_places(icub):
    def spread(places, gesture="poke"):
        recording = simulate(
            icub.skin("torso"),
            rng=np.random.default_rng(6),
            per_gesture=20,
            gestures=[gesture],
            subjects=1,
            places=places,
            variety=0.0,
        )
        points = icub.skin("torso").positions
        centres = [
            np.average(points, axis=0, weights=samples.mean(axis=0) ** 2)
            for _, _, samples in recording.touches()
        ]
        middle = np.median(centres, axis=0)
        return np.median(np.linalg.norm(centres - middle, axis=1))

    # Four fifths of one subject's pokes lie within some 8 mm of one place of a chest of 130 mm.
    assert spread("habitual") < 15e-3
    assert spread("anywhere") > 25e-3
    # As the first paper has it: grips at their places, pokes anywhere.
    assert spread("grips") > 25e-3
    assert spread("grips", "three_finger") < 15e-3


def test_subjects_differ_and_are_recorded(icub):
    recording = simulate(
        icub.skin("left_foot"),
        rng=np.random.default_rng(3),
        per_gesture=10,
        subjects=4,
        variety=0.0,
    )
    assert set(recording.subjects) == {0, 1, 2, 3}
    people = draw_subjects(30, rng=np.random.default_rng(1))
    assert [one.number for one in people] == list(range(30))
    assert all(0.75 <= one.hand <= 1.0 for one in people)


def read(sensing, loads, seed=0):
    rng = np.random.default_rng(seed)
    places = np.arange(3.0 * loads.shape[1]).reshape(-1, 3)
    skin = skin_from_points(places, np.ones_like(places))
    return Sensors(skin, sensing, rng=rng).read(loads, rng=rng)


def test_dead_taxels_send_nothing():
    counts = read(Sensing(dead=0.25), np.ones((9, 40)))
    assert (counts == 0).all(axis=0).sum() == 10


def test_saturation_and_resolution_bound_what_is_sent():
    quiet = {"noise": 0.0, "drift": 0.0, "gain_spread": 0.0}
    assert read(Sensing(saturation=100.0, **quiet), np.ones((2, 3))).max() == 100
    coarse = read(Sensing(bits=4, **quiet), np.linspace(0, 2, 200)[None])
    assert set((coarse % 16).ravel().tolist()) <= {0, 15}  # the top step ends at 255
    exact = read(Sensing(**quiet), np.full((2, 3), 0.5))
    np.testing.assert_array_equal(exact, FULL_SCALE / 2)


def test_drift_wanders_slowly():
    sensing = Sensing(noise=0.0, drift=20.0, gain_spread=0.0, bits=8)
    counts = read(sensing, np.full((50, 300), 0.5)).astype(float)
    assert counts[0].std() == pytest.approx(20.0, rel=0.15)  # 300 draws: 4 % standard error
    # One second of a baseline that forgets in 20 s: sd * sqrt(2 * (1 - exp(-1 / 20))).
    moved = 20.0 * np.sqrt(2 * (1 - np.exp(-1 / 20)))
    assert (counts[-1] - counts[0]).std() == pytest.approx(moved, rel=0.15)


@pytest.mark.parametrize(
    ("what", "message"),
    [
        ({"noise": -1.0}, "noise must be finite and not negative"),
        ({"dead": 2.0}, "dead is a share"),
        ({"bits": 0}, "bits 1..8"),
        ({"rate": 0.0}, "rate must lie"),
        ({"drift": float("nan")}, "drift must be finite"),
    ],
)
def test_sensing_refuses_what_makes_no_sense(what, message):
    with pytest.raises(InvalidArrayError, match=message):
        Sensing(**what)


def test_gesture_sets_have_names():
    assert gesture_set(()) == ("poke", "full_finger", "three_finger", "whole_hand")
    assert gesture_set(("eight",)) == EIGHT
    assert gesture_set(("poke", "four", "edge"))[-1] == "edge"
    assert gesture_set(("all",)) == tuple(GESTURES)
    assert gesture_set(("all, time", "poke")) == gesture_set(("all", "time"))
    with pytest.raises(UnknownNameError, match="no gesture 'tiem'; did you mean 'time'"):
        gesture_set(("poke,tiem",))
    both = gesture_set(("hand", "other"))
    assert both == (*HAND, *OTHER)
    assert set(GESTURES) < set(both)


def test_pairs_name_the_gestures(icub, rng):
    with pytest.raises(UnknownNameError, match="no gesture 'slap'"):
        simulate_pairs(icub.skin("torso"), rng=rng, gestures=["slap"], variety=0.0)


def test_patches_hold_every_meshed_taxel_once(prepared):
    arm = prepared("left_arm")
    patches = cut_into_patches(arm.mesh)
    assert [len(patch) for patch in patches] == [110, 110, 80, 50]
    assert [patch.part for patch in patches] == [f"left_arm/{k}" for k in range(4)]
    channels = np.concatenate([patch.channels for patch in patches])
    np.testing.assert_array_equal(np.sort(channels), np.sort(arm.skin.channels))
    foot = prepared("left_foot")
    assert cut_into_patches(foot.mesh) == (foot.skin,)
