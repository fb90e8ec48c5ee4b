"""Speed against accuracy: settings measured on a user's own skin and machine, and recommended."""

from skinmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
