from skinmap.physics.simulation import simulate
from skinmap.physics.variants import VARIANTS

__all__ = [
    "VARIANTS",
    "simulate",
]
