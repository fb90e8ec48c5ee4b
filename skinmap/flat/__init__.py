"""Flat maps: flattening methods, distortion, packing of charts."""

from skinmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
