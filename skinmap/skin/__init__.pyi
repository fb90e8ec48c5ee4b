from skinmap.skin.cover import measure_fit
from skinmap.skin.repair import repair_table
from skinmap.skin.robot import Robot
from skinmap.skin.skin import Skin, skin_from_points, skin_from_table
from skinmap.skin.taxels import TaxelTable

__all__ = [
    "Robot",
    "Skin",
    "TaxelTable",
    "measure_fit",
    "repair_table",
    "skin_from_points",
    "skin_from_table",
]
