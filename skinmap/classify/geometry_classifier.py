"""The classifier `contact-geometry`: lengths, areas and counts of the contacts on the skin."""

from __future__ import annotations

from skinmap.classify.classifier import TouchClassifier
from skinmap.classify.descriptors import ContactGeometry


def contact_geometry_classifier() -> TouchClassifier:
    """A calibrated RBF machine on the logarithms of lengths, areas and counts of the contacts."""
    from skinmap.classify.rbf_machine import RbfMachine

    # C and gamma by leaving patches out on simulated touches; flat for a factor of 3 around here.
    return TouchClassifier("contact-geometry", ContactGeometry(), RbfMachine())
