"""All targets by name."""

from __future__ import annotations

from . import layouts, messages, recordings

TARGETS = {
    target.name: target for target in (*layouts.TARGETS, *recordings.TARGETS, *messages.TARGETS)
}
