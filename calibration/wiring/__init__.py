"""The wiring doctor: which channel is really where, told by touches and by the skin at rest."""

from skinmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
