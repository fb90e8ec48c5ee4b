"""MuJoCo, where it is installed."""

from __future__ import annotations

import logging
from importlib import import_module
from types import ModuleType

from skinmap.errors import MissingLibraryError

logger = logging.getLogger(__name__)

LEAST = (4, 0)  # the first whose tactile sensor and direct contact stiffness were tested here


def import_mujoco() -> ModuleType:
    """The package `mujoco`.

    Raises
    ------
    MissingLibraryError
        Not installed, or older than `LEAST` (names the extra).
    """
    try:
        mujoco = import_module("mujoco")
    except ImportError as error:
        raise MissingLibraryError(
            "MuJoCo is not installed: pip install 'skinmap[mujoco]'"
        ) from error
    version = str(mujoco.__version__)
    if tuple(int(one) for one in version.split(".")[:2]) < LEAST:
        raise MissingLibraryError(
            f"MuJoCo {version} is too old, 4.0 or later is needed: pip install 'skinmap[mujoco]'"
        )
    # By itself it writes warnings into a file of the current folder.
    mujoco.set_mju_user_warning(logger.warning)
    return mujoco
