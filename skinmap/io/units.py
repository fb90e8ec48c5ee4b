"""Units of length that files may be in: the same words in manifests, options and tables."""

from __future__ import annotations

UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "inch": 0.0254}
