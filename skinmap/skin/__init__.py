"""What a skin is: taxel table, robot and links, repair of normals."""

from skinmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
