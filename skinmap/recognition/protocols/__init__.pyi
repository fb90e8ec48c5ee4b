"""Names of skinmap.recognition.protocols, from where they are defined; loaded on first use."""

from skinmap.recognition.protocols.folds import make_folds as make_folds
from skinmap.recognition.protocols.kaspar import evaluate_kaspar as evaluate_kaspar
from skinmap.recognition.protocols.recordings import evaluate_recordings as evaluate_recordings
from skinmap.recognition.protocols.recordings import group_folds as group_folds
from skinmap.recognition.protocols.transfer import cut_patches as cut_patches
from skinmap.recognition.protocols.transfer import score_patches as score_patches
from skinmap.recognition.protocols.transfer import touch_patches as touch_patches

__all__ = [
    "cut_patches",
    "evaluate_kaspar",
    "evaluate_recordings",
    "group_folds",
    "make_folds",
    "score_patches",
    "touch_patches",
]
