"""Neighbour offsets of each taxel and the periodic structures among them."""

from skinmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
