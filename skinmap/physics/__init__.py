"""Touches by a physics engine of others: MuJoCo presses hands on a bed of springs."""

from skinmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
