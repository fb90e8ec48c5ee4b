import numpy as np
import pytest

from skinmap.live.touches import NamedTouch
from viewer.drawing.touch_list import caption, details
from viewer.drawing.touch_marks import LONG, SHORT, arrow, solid_arrow


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
    full = made(confidence=0.9, area=1.234e-3, peak=99.6, began=1.5, force=2.25)
    assert details(full, 3.0) == ["left arm", "1,234 mm\u00b2", "peak 100", "2.2 N", "1.5 s"]
    assert details(full, float("nan"))[-1] == "2.2 N"
