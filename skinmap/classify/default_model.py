"""The model that comes with Skinmap: it names touches on any robot before a user trains one.

It learnt from simulated touches on the iCub that stay and that go on in time; how it does on other
robots and in another physics is in docs/classifiers.md. `scripts/default_model.py` makes it.
"""

from __future__ import annotations

from pathlib import Path

from skinmap.classify.classifier import TouchClassifier
from skinmap.classify.model_file import read_model
from skinmap.classify.named_classifiers import contact_geometry_classifier

FILE = Path(__file__).with_name("default.skinmodel")


def default_model() -> TouchClassifier:
    """The model that comes with Skinmap, read anew.

    Raises
    ------
    MissingFileError, DataFormatError
        An installation that is not whole.
    """
    return read_model(FILE, lambda name: contact_geometry_classifier)
