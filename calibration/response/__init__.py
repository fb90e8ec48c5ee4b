"""Baselines, gains, drift and health of taxels."""

from skinmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
