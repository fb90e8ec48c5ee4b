"""Calibration of skins: position of each taxel, with its confidence, and response."""

from skinmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
