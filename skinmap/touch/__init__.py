"""Touches: recordings, the simulator, contacts and their geometry, histograms."""

from skinmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
