"""One name for every touch: touches are told apart as for any classifier, and not judged."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.recognition.classifier import Classifier
from skinmap.recognition.descriptors import ContactGeometry, Touch
from skinmap.recognition.trained_skin import SkinDifference
from skinmap.skin.skin import Skin
from skinmap.touch.contacts.skin_geometry import ACTIVE, pool_event


class GivenName(Classifier):
    """Calls every touch by one name.

    Parameters
    ----------
    label : str
    """

    def __init__(self, label: str) -> None:
        named = SimpleNamespace(classes_=np.array([label]))
        super().__init__("given name", ContactGeometry(), named)

    def difference(self, skin: Skin) -> SkinDifference:
        """None: there is nothing that it learnt."""
        return SkinDifference("", True)

    @property
    def answers(self) -> None:
        """None: nothing is judged."""
        return

    def probabilities(self, touch: Touch) -> FloatArray | None:
        """(1,) certainty; None without contact."""
        return np.ones(1) if (pool_event(touch.samples) > ACTIVE).any() else None
