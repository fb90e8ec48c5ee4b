from skinmap.neighbours.offsets import (
    Neighbourhoods,
    auto_radius,
    flat_map_directions,
    neighbourhoods,
)
from skinmap.neighbours.structures import Prototypes, Structures, assign, find_structures

__all__ = [
    "Neighbourhoods",
    "Prototypes",
    "Structures",
    "assign",
    "auto_radius",
    "find_structures",
    "flat_map_directions",
    "neighbourhoods",
]
