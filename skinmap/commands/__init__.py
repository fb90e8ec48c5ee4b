"""What every command is made of: options, groups, profiles, progress, workers."""

from skinmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
