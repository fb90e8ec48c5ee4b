"""Skinmap: from a robot's meshes and taxel positions to named touches on its skin.

Every public name is loaded on first use, so that `import skinmap` costs next to nothing. The stub
`__init__.pyi` is the list of names, of the packages above the core too: all three come in one
distribution, and a name has one place.
"""

from skinmap.lazy import attach

__version__ = "0.1.0"
__getattr__, __dir__, __all__ = attach(__name__, __file__, adapt="skinmap.front:accepting")
