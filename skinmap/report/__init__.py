"""Reports: pages, tables, figures and projections of results."""

from skinmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
