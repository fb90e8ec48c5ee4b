"""Live: sources of samples, publishers, and the loop from a sample to a named touch."""

from skinmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
