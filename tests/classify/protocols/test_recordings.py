from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skinmap.cli.collection import collect
from skinmap.cli.evaluate.protocol_recordings import judged_touches
from skinmap.errors import InvalidArrayError, SkinMismatchError, UnknownNameError
from skinmap.io.recordings.touch_files import save_recordings
from skinmap.recognition.protocols.recordings import check_spelling, evaluate_recordings
from skinmap.touch.recording import Recording
from skinmap.touch.simulation.simulator import simulate

PART = "left_forearm"


@pytest.fixture(scope="module")
def recording(icub):
    return simulate(icub.skin(PART), rng=np.random.default_rng(8), per_gesture=8, variety=0.0)


@pytest.fixture(scope="module")
def touches(tmp_path_factory, recording):
    return judged(tmp_path_factory.mktemp("touches") / "t.npz", recording)


def judged(path, recording, *only):
    """The touches of a recording that was written to a file."""
    save_recordings(recording, path)
    return tuple(one.touch for one in judged_touches(collect([path], "icub"), only))


def test_recordings_give_a_row_for_each_classifier_and_kind_of_folds(touches):
    table, flattered, skipped = evaluate_recordings(
        touches, names=["contact-geometry", "raw-intersection"], seeds=[0], folds=4
    )
    assert [(row.classifier, row.folds) for row in table] == [
        ("contact-geometry", "plain"), ("contact-geometry", "event"),
        ("raw-intersection", "plain"), ("raw-intersection", "event"),
    ]  # fmt: skip
    means = {(row.classifier, row.folds): row.mean for row in table}
    assert means["contact-geometry", "event"] >= 0.8  # 24 touches to learn from
    leak = {row.classifier: row.points for row in flattered}
    for name in leak:
        expected = 100 * (means[name, "plain"] - means[name, "event"])
        assert leak[name] == pytest.approx(expected)
    # Raw values have seen the other samples of the very touch that they are asked for.
    assert leak["raw-intersection"] > 10.0
    assert skipped == {}


def test_what_cannot_run_is_skipped_with_its_reason_only_where_nobody_asked(prepared, touches):
    other = prepared("right_leg_lower")
    moved = [replace(t, skin=other, samples=np.zeros((3, 380), np.uint8)) for t in touches[:8]]
    both = [*touches, *moved]
    table, _, skipped = evaluate_recordings(
        both, names=["raw-rbf"], seeds=[0], folds=2, optional=True
    )
    assert table == []
    assert "raw values need touches of one part" in skipped["raw-rbf"]
    with pytest.raises(InvalidArrayError, match="raw-rbf: raw values need touches of one part"):
        evaluate_recordings(both, names=["raw-rbf"], seeds=[0], folds=2)


def test_too_few_events_for_the_folds_are_counted(touches):
    with pytest.raises(InvalidArrayError, match=r"9 folds need .* got: 8 full_finger, 8 poke"):
        evaluate_recordings(touches, names=["contact-geometry"], seeds=[0], folds=9)


def relabelled(recording: Recording, *labels: str) -> Recording:
    return replace(recording, labels=(*labels, *recording.labels[len(labels) :]))


def test_labels_that_do_not_match_are_refused(tmp_path, recording):
    path = tmp_path / "t.npz"
    with pytest.raises(InvalidArrayError, match=r"touch of 'left_forearm' in .* has no label"):
        judged(path, relabelled(recording, " "))
    odd = relabelled(recording, "Full Finger")
    with pytest.raises(InvalidArrayError, match="'full_finger' differ in spelling only"):
        judged(path, odd)
    with pytest.raises(
        UnknownNameError, match="no recorded gesture 'slap'; the recorded gestures are: full_finger"
    ):
        judged(path, recording, "slap")
    both = relabelled(recording, "poke+whole_hand")
    assert len(judged(path, both)) == len(recording.labels) - 1


def test_labels_that_differ_in_signs_numbers_or_marks_are_not_one_label():
    """The old check kept letters and digits alone, and saw one label in each of these pairs."""
    for pair in (
        ("press 1.5 N", "press 15 N"),
        ("roll<", "roll>"),
        ("twist -", "twist +"),
        ("\u2191", "\u2193"),
        ("\u0915\u093f", "\u0915\u093e"),
        ("\U0001f44d", "\U0001f44e"),
    ):
        check_spelling(pair)
    for pair in (("full-finger", "Full  Finger"), ("caf\u00e9", "cafe\u0301"), ("a_1", "A 1 ")):
        with pytest.raises(InvalidArrayError, match="differ in spelling only"):
            check_spelling(pair)


def test_a_recording_from_another_skin_is_refused(tmp_path, recording):
    with pytest.raises(SkinMismatchError, match="has 240 taxels, the skin of iCub has 380"):
        judged(tmp_path / "t.npz", replace(recording, part="right_leg_lower"))


def test_the_fold_that_cannot_be_learnt_is_named(touches):
    few = [touch for label in ("poke", "full_finger")
           for touch in [one for one in touches if one.label == label][:5]]  # fmt: skip
    with pytest.raises(InvalidArrayError, match=r"fold 1 of 4: training needs .* of each 5"):
        evaluate_recordings(few, names=["contact-geometry"], seeds=[0], folds=4)
