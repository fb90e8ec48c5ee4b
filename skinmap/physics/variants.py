"""What may differ between one hand on one skin and another, by name: ranges that touches draw from.

Sources: a fingertip gives way by about 2 mm under 1 N and stiffens (Serina, Mote and Rempel,
J. Biomech. 30(10), 1997); 2 mm of soft foam of 0.1 MPa are 5e7 Pa/m. Everything else here is
estimated; docs/simulator.md says so, too.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

from skinmap.errors import check_known

Range = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Variant:
    """Ranges (least, most) of a hand and a skin; each skin, person and touch draws its own.

    Attributes
    ----------
    name : str
    foam : (2,) float
        Stiffness of the skin's foam per area [Pa/m], drawn once a skin, evenly in its logarithm.
    spread : (2,) float
        How far the foam spreads a pressure, standard deviation [m], drawn once a skin.
    full_scale : (2,) float
        Pressure that a taxel sends 160 counts for [Pa], drawn once a skin, in its logarithm.
    flesh : (2,) float
        Stiffness of hands per area [Pa/m], drawn once a person, in its logarithm.
    force : float
        Of the median person, 1 = see `bodies`.
    force_spread : float
        Standard deviation of the logarithm of the force, from touch to touch.
    bend : float
        How far the joints of a finger are from straight, standard deviation [rad].
    hollow : (2,) float
        How much further from the skin the middle of a palm is than its pads [m].
    friction : float
        Between hand and skin; 0 slides.
    """

    name: str
    foam: Range = (3e7, 6e7)
    spread: Range = (1.6e-3, 2.4e-3)
    full_scale: Range = (25e3, 40e3)
    flesh: Range = (1.5e7, 3e7)
    force: float = 1.0
    force_spread: float = 0.35
    bend: float = 0.06
    hollow: Range = (2e-3, 5e-3)
    friction: float = 0.0


VARIANTS = {
    one.name: one
    for one in (
        Variant("foam", foam=(1e7, 2e7), spread=(2.4e-3, 3.2e-3), flesh=(3e7, 6e7)),
        Variant("flesh", foam=(6e7, 1.2e8), spread=(1.2e-3, 1.8e-3), flesh=(0.8e7, 1.5e7)),
        Variant("finger", bend=0.22),
        Variant("palm", hollow=(5e-3, 10e-3)),
        Variant("force", force=0.8, force_spread=0.7),
        Variant(
            "judge",
            foam=(1.2e7, 1e8),
            spread=(1.2e-3, 3.0e-3),
            full_scale=(18e3, 55e3),
            flesh=(0.9e7, 4.5e7),
            force_spread=0.5,
            bend=0.14,
            hollow=(1e-3, 8e-3),
            friction=0.5,
        ),
    )
}
# Judged on, never trained or tuned on: no code that fits anything may draw from it
# (tests/physics/test_variants.py), and its parameters do not change any more.
FROZEN = "judge"
TUNING = tuple(name for name in VARIANTS if name != FROZEN)
DEFAULT = TUNING[0]


def find_variant(name: str) -> Variant:
    """The variant of a name.

    Raises
    ------
    UnknownNameError
        Says which there are.
    """
    check_known("physics variant", [name], VARIANTS)
    return VARIANTS[name]


def parameters(variant: Variant) -> str:
    """All parameters as one line of text, the same for the same variant."""
    return "; ".join(f"{one.name}={getattr(variant, one.name)!r}" for one in fields(variant))
