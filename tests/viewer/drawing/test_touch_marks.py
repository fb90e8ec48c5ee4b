import dataclasses

import numpy as np
import pytest

from skinmap.live.contacts.named_touch import NamedTouch
from skinmap.live.response.loads import ContactForce, Interval
from skinmap.recognition.answers import Answer, Answers, HandAnswer
from viewer.colours import class_colour, touch_colour
from viewer.drawing.panel.touch_list import caption, details, largest
from viewer.drawing.touches.touch_marks import LONG, SHORT, arrow, carried_steps, solid_arrow


def made(**more):
    return NamedTouch("left_arm", np.array([1, 2]), np.array([0.1, 0.0, 0.2]), "full_hand", **more)


def test_arrow_stands_on_the_centre_along_the_normal_and_shows_how_hard():
    normal = np.array([0.0, 0.6, 0.8])
    T = np.eye(4)
    T[:3, 3] = 1.0, 2.0, 3.0
    tips = {}
    for peak in (0.0, 255.0, 1000.0, float("nan")):
        ((points, faces, _),) = arrow(made(confidence=0.9, normal=normal, peak=peak), T)
        along = (points - points[-1]) @ normal
        assert np.abs(along).max() == pytest.approx(np.ptp(along))
        tips[peak] = np.ptp(along)
        foot = points[np.argmin(along)]
        assert np.linalg.norm(foot - ([1.1, 2.0, 3.2] + 2.9e-3 * normal)) < 2e-3
        assert faces.max() == len(points) - 1
    assert tips[0.0] == pytest.approx(SHORT)
    assert tips[255.0] == tips[1000.0] == pytest.approx(LONG)


def test_arrow_is_closed_around_its_side_and_faces_outwards():
    points, faces = solid_arrow(0.05)
    a, b, c = points[faces].transpose(1, 0, 2)
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6
    assert volume > 0


def test_arrow_without_a_normal_is_not_drawn():
    assert arrow(made(confidence=0.9), np.eye(4)) == []
    assert arrow(made(confidence=0.9, normal=np.full(3, np.nan)), np.eye(4)) == []


def test_a_touch_in_words_leaves_out_what_is_not_known():
    assert caption(made(confidence=0.914)) == "full hand 91 %"
    assert caption(made(confidence=float("nan"))) == "full hand"
    assert details(made(confidence=0.9), 3.0) == ["left arm"]
    full = made(confidence=0.9, area=1.234e-3, peak=99.6, began=1.5)
    assert details(full, 3.0) == ["left arm", "1,234 mm\u00b2", "peak 100", "1.5 s"]
    assert details(full, float("nan"))[-1] == "peak 100"


def test_the_kind_is_called_one_beside_another_label_and_left_out_of_the_unknown():
    kind, motion = Answer("poke", 0.5, ("poke",)), Answer("still", 0.9, ("still",))
    touch = made(confidence=0.4, answers=Answers(kind, motion, HandAnswer("unsure", 0.5)))
    for label, words, tint in (
        ("poke", "poke, still", "poke"), ("hold", "kind poke, still", "poke"),
        ("unknown", "still", "unknown"),
    ):  # fmt: skip
        one = dataclasses.replace(touch, label=label)
        assert details(one, 3.0)[1:] == [words, "hand?"]
        assert touch_colour(one) == class_colour(tint)


def test_touch_of_a_calibrated_part_has_its_force_with_an_interval():
    nothing = np.full(3, np.nan)
    load = ContactForce(
        Interval(12.44, 10.9, 14.06), nothing, nothing, nothing, nothing,
        Interval(1e-3, 9e-4, 2e-3), Interval(9e3, 8e3, 1e4), Interval(26.4e3, 2e4, 3e4),
    )  # fmt: skip
    touch = made(confidence=0.9, area=1e-3, peak=99.6, load=load)
    assert details(touch, 3.0)[:3] == ["left arm", "12.4 N (10.9 to 14.1)", "peak 26 kPa"]
    refused = dataclasses.replace(load, refused="above the calibrated range")
    told = details(dataclasses.replace(touch, load=refused), 3.0)
    assert told[1] == "no force: above the calibrated range"
    assert not any(" N" in one for one in told)


class TwoSheets:
    """A surface cut at x = 0 whose right half lies 1 m away, as on a flat map with a seam."""

    def carried(self, points, lift):
        return points + np.where(points[:, :1] < 0.0, 0.0, 1.0) + [0.0, 0.0, lift]


def test_trail_across_a_seam_is_drawn_on_both_sides_of_it_and_not_between():
    path = np.array([[-0.03, 0.0, 0.0], [-0.015, 0.0, 0.0], [0.017, 0.0, 0.0], [0.03, 0.0, 0.0]])
    steps = carried_steps(TwoSheets(), path, 0.0)
    length = np.linalg.norm(steps[:, 1] - steps[:, 0], axis=1)
    # One piece of 16 of the step of 32 mm is left out: the one across.
    assert length.sum() == pytest.approx(0.06 - 0.032 / 16)
    assert length.max() < 0.02
    assert (np.diff(steps[:, 0, 0]) > 0).all(), "in the order of the path"
    assert np.isclose(steps[:, :, 0], -0.001).any(), "up to the seam"
    assert np.isclose(steps[:, :, 0], 1.001).any(), "and on from it"


def test_list_keeps_the_largest_touches_in_their_order():
    sizes = [3, 9, 1, 7]
    touches = [
        NamedTouch("a", np.arange(size), np.zeros(3), str(k), 0.5) for k, size in enumerate(sizes)
    ]
    assert [touch.label for touch in largest(touches, 2)] == ["1", "3"]
    assert [touch.label for touch in largest(touches, 9)] == ["0", "1", "2", "3"]
