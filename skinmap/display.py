"""Is there a screen, and is there a library to draw with? Asked before VTK is imported.

VTK 9.7 segfaults without a word where no OpenGL library can be loaded, so the libraries are
tried with ctypes first. This file imports nothing heavy: commands ask it before they start.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Callable

from skinmap.errors import MissingLibraryError, OutputError

DEBIAN_PACKAGES = "libgl1 libegl1"
WINDOW_CLASS = "VTK_DEFAULT_OPENGL_WINDOW"  # VTK reads it when it makes a window
OSMESA = ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")


def loads(library: str) -> bool:
    """Whether the dynamic linker finds a shared library."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def has_display() -> bool:
    """Whether a window can be opened here: an X server that answers, or not Linux at all.

    A set DISPLAY is not enough: a stale one makes VTK abort the program. Wayland alone is not
    either: VTK's wheels open X windows, which Wayland desktops serve through XWayland.
    """
    if not sys.platform.startswith("linux"):
        return True
    if not os.environ.get("DISPLAY"):
        return False
    try:
        x11 = ctypes.CDLL("libX11.so.6")
    except OSError:
        return False
    x11.XOpenDisplay.restype = ctypes.c_void_p
    connection = x11.XOpenDisplay(None)
    if not connection:
        return False
    x11.XCloseDisplay(ctypes.c_void_p(connection))
    return True


def require_opengl(*, window: bool = False, loads: Callable[[str], bool] = loads) -> str | None:
    """Find a library to draw with and tell VTK which kind of window to make.

    Parameters
    ----------
    window : bool
        Whether a window will be opened. Pictures alone are drawn through the display too where
        there is one: two kinds of OpenGL contexts in one program get in each other's way.
    loads : callable, optional
        Whether a library can be loaded; tests pretend with it.

    Returns
    -------
    str or None
        VTK's window class; None where its own choice is right.

    Raises
    ------
    MissingLibraryError
        No library that could draw: one line that says what to install.
    OutputError
        A window is wanted and there is no display.
    """
    if not sys.platform.startswith("linux"):
        return None
    display = has_display()
    chosen = window_class(not display, loads)
    if window and not display:
        raise OutputError("no display to open a window on; ask for a picture or a movie instead")
    if chosen is None:
        os.environ.pop(WINDOW_CLASS, None)
    else:
        os.environ[WINDOW_CLASS] = chosen
    return chosen


def window_class(hidden: bool, loads: Callable[[str], bool]) -> str | None:
    """VTK's class for a hidden or a real window; raises where nothing can draw it."""
    if not hidden and loads("libGL.so.1"):
        return None
    if hidden and loads("libEGL.so.1") and loads("libGL.so.1"):
        return "vtkEGLRenderWindow"
    if hidden and any(loads(library) for library in OSMESA):
        return "vtkOSOpenGLRenderWindow"
    raise MissingLibraryError(
        f"no OpenGL library to draw with; on Debian or Ubuntu: apt-get install -y {DEBIAN_PACKAGES}"
    )
