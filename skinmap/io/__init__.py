"""Files in and out: taxel tables, URDF bodies, robot manifests."""

from skinmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
