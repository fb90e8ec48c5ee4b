"""Live: sources of samples, publishers, and the loop from a sample to a named touch.

The names below are loaded on first use, so that `import skinmap.live` costs next to nothing.
"""

from __future__ import annotations

import importlib
from typing import Any

_PUBLIC = {
    "Moment": ("skinmap.live.moment", "Moment"),
    "NamedTouch": ("skinmap.live.contacts.named_touch", "NamedTouch"),
    "PolledSource": ("skinmap.live.sources.polled_source", "PolledSource"),
    "Receiver": ("skinmap.live.sources.receiver", "Receiver"),
    "Relay": ("skinmap.live.sources.source", "Relay"),
    "Seekable": ("skinmap.live.sources.source", "Seekable"),
    "Source": ("skinmap.live.sources.source", "Source"),
    "TouchLoop": ("skinmap.live.loop", "TouchLoop"),
    "check_source": ("skinmap.live.sources.check", "check_source"),
    "open_publisher": ("skinmap.live.publishing.publish", "open_publisher"),
    "open_recording": ("skinmap.live.sources.open_recording", "open_recording"),
    "open_source": ("skinmap.live.sources.open_source", "open_source"),
}
__all__ = [*_PUBLIC]


def __getattr__(name: str) -> Any:
    if name in _PUBLIC:
        module, attribute = _PUBLIC[name]
        return getattr(importlib.import_module(module), attribute)
    raise AttributeError(f"module 'skinmap.live' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *_PUBLIC])
