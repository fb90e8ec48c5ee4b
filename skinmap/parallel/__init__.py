"""Many tasks on several cores or machines: results in order, resumed after an interruption."""

from skinmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
