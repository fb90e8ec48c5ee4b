"""The viewer: skins, pressures and named touches on the robot's body."""

from skinmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
