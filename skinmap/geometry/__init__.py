"""Arrays in, arrays out: triangles, topology, proximity, distances, rigid transforms."""

from skinmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
