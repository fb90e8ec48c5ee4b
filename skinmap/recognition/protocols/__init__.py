"""Protocols: how classifiers are judged, by the papers' own rules and without what flatters them.

| name | what it does |
|---|---|
| `make_folds`, `group_folds` | rows to train on and to test on: by touch, or with groups left out |
| `evaluate_recordings` | labelled touches cross-validated, beside the leak of plain folds |
| `cut_patches`, `touch_patches`, `score_patches` | transfer between patches and robots |
| `evaluate_kaspar` | the first paper's table |
"""

from __future__ import annotations

from skinmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
