"""Classifiers of touches: contact geometry (the default), histograms, and how well they do."""

from __future__ import annotations

from typing import Any


def __getattr__(name: str) -> Any:
    if name == "check_classifier":  # on first use: importing this package costs nothing
        from skinmap.classify.check import check_classifier

        return check_classifier
    raise AttributeError(f"module 'skinmap.classify' has no attribute {name!r}")
