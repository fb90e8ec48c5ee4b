"""Classifiers of touches: contact geometry (the default), histograms, images; how they do."""

from skinmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
