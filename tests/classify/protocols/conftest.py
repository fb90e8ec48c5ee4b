from __future__ import annotations

import pytest

import skinmap
from skinmap.touch.prepared_skin import PreparedSkin


@pytest.fixture(scope="session")
def kaspar_skin():
    """A function: a part of the robot `kaspar`, prepared once."""
    robot = skinmap.load_robot("kaspar")
    made: dict[str, PreparedSkin] = {}

    def get(part: str) -> PreparedSkin:
        if part not in made:
            made[part] = PreparedSkin(robot.skin(part))
        return made[part]

    return get
