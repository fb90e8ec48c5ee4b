"""Real files of the field, where they are at hand."""

from __future__ import annotations

from pathlib import Path

import pytest

# Development data stand beside the repository and are not part of it.
ICUB_MAIN = Path(__file__).resolve().parents[3] / "shared" / "data" / "icub-main"


@pytest.fixture(scope="session")
def icub_main() -> Path:
    """Folder with `positions` and `skinGui` of the iCub's software."""
    if not ICUB_MAIN.is_dir():
        pytest.skip("no shared/data/icub-main beside the repository: real files are not at hand")
    return ICUB_MAIN
