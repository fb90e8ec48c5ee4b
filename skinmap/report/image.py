"""Pictures and films inside a page, so that the page is one file."""

from __future__ import annotations

import base64
from html import escape
from pathlib import Path

TYPES = {".png": "image/png", ".mp4": "video/mp4", ".gif": "image/gif"}


def data_uri(data: bytes, kind: str = "image/png") -> str:
    """Bytes as an address that holds them."""
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"


def image(png: bytes, what: str) -> str:
    """A PNG, and in words what it shows."""
    return f"<img alt='{escape(what)}' src='{data_uri(png)}'>"


def media(path: Path, what: str) -> str:
    """A file with a picture or a film, and in words what it shows."""
    data = data_uri(path.read_bytes(), TYPES[path.suffix])
    if path.suffix == ".mp4":
        return f"<video controls autoplay loop muted src='{data}'></video>"
    return f"<img alt='{escape(what)}' src='{data}'>"
