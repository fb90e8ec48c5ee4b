"""`auto`: the method that a budget of time or of error pays for, by measured cost."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from skinmap.arrays import FloatArray
from skinmap.errors import InvalidArrayError
from skinmap.flat.dirichlet import locally_injective_map, rigid_map
from skinmap.flat.disc import Disc
from skinmap.flat.distortion import edge_rms

# CPU seconds (s, p) as s (n / 100,000)^p; what `balanced` and `dirichlet` add to `fast`, which is
# their start. From "cost_model" of benchmarks/results/geometry.json, by `make bench-geometry`.
# What a method really takes is scaled by what `fast` took on the machine and the mesh at hand.
COSTS = {"fast": (0.83, 1.17), "balanced": (0.87, 1.18), "dirichlet": (1.41, 1.13)}
SMALLEST = 1e-3  # seconds: no disc takes less
CHEAP = 0.1  # seconds: without a budget, the most that `dirichlet` may take beside `fast`
_REFINEMENTS: dict[str, Callable[[Disc], FloatArray]] = {
    "balanced": rigid_map,
    "dirichlet": locally_injective_map,
}


@dataclass(frozen=True, eq=False, slots=True)
class Choice:
    """What `auto` took.

    Attributes
    ----------
    uv : (n, 2) float
        [m].
    method : str
    reason : str
        Why, with the figures.
    met : bool
        Whether the result keeps to the budget.
    """

    uv: FloatArray
    method: str
    reason: str
    met: bool


def check_budget(method: str, budgets: Mapping[str, float | None]) -> None:
    """Refuse budgets that are not positive, or that no choice follows.

    Parameters
    ----------
    method : str
    budgets : mapping of str to float
        Under the names that the user has for them: keywords, or options.

    Raises
    ------
    InvalidArrayError
    """
    for name, value in budgets.items():
        if value is None:
            continue
        if not 0.0 < value < math.inf:
            raise InvalidArrayError(f"{name} must be above 0 and finite, got {value:g}")
        if method != "auto":
            auto = "--method auto" if name.startswith("-") else "method 'auto'"
            raise InvalidArrayError(f"{name} needs {auto}, got {method!r}")


def predicted_seconds(method: str, n: int) -> float:
    """CPU time that a method adds for a disc of n vertices on the machine of the benchmark."""
    seconds, exponent = COSTS[method]
    return max(seconds * (n / 1e5) ** exponent, SMALLEST)


def within_budget(
    disc: Disc, *, max_seconds: float | None = None, max_edge_rms: float | None = None
) -> Choice:
    """Map a disc by the method that suits a budget; the nearest there is where none does.

    `fast` runs first, as the start of the others and to see how quick this machine is. With a
    limit of error the next dearer method follows while the limit is not met and the time lasts;
    with a limit of time alone, the best that is expected to fit; without either, `dirichlet`
    where it is cheap and `balanced` elsewhere.

    Parameters
    ----------
    disc : Disc
    max_seconds : float, optional
        CPU time of one thread [s].
    max_edge_rms : float, optional
        Root mean square of the edge strain, 0.01 for 1 %.
    """
    started = time.process_time()
    maps = {"fast": disc.conformal}
    pace = (time.process_time() - started) / predicted_seconds("fast", len(disc.vertices))
    limit = float("inf") if max_seconds is None else max_seconds
    for method in _order(disc, pace, max_seconds, max_edge_rms):
        if max_edge_rms is not None and _best(disc, maps)[1] <= max_edge_rms:
            break
        spent = time.process_time() - started
        if spent + pace * predicted_seconds(method, len(disc.vertices)) <= limit:
            maps[method] = _REFINEMENTS[method](disc)
            if max_edge_rms is None and disc.is_injective(maps[method]):
                return _explain(disc, maps, method, started, max_seconds, max_edge_rms)
    return _explain(disc, maps, _best(disc, maps)[0], started, max_seconds, max_edge_rms)


def _order(
    disc: Disc, pace: float, max_seconds: float | None, max_edge_rms: float | None
) -> list[str]:
    """Methods beside `fast` in the order in which they are worth trying."""
    if max_edge_rms is not None:
        return ["balanced", "dirichlet"]
    if max_seconds is not None:
        return ["dirichlet", "balanced"]
    cheap = pace * predicted_seconds("dirichlet", len(disc.vertices)) <= CHEAP
    return ["dirichlet"] if cheap else ["balanced"]


def _best(disc: Disc, maps: dict[str, FloatArray]) -> tuple[str, float]:
    """Name and error of the map with least edge error among those that do not flip."""
    errors = {
        name: edge_rms(disc.vertices, disc.faces, uv) if disc.is_injective(uv) else float("inf")
        for name, uv in maps.items()
    }
    name = min(errors, key=lambda key: errors[key])
    return name, errors[name]


def _explain(
    disc: Disc,
    maps: dict[str, FloatArray],
    method: str,
    started: float,
    max_seconds: float | None,
    max_edge_rms: float | None,
) -> Choice:
    error = edge_rms(disc.vertices, disc.faces, maps[method])
    spent = time.process_time() - started
    words, met = [], True
    if max_seconds is not None:
        met &= spent <= max_seconds
        words.append(f"{spent:.3g} s of {max_seconds:.3g} s")
    if max_edge_rms is not None:
        met &= error <= max_edge_rms
        words.append(f"edge rms {100 * error:.3g} % of {100 * max_edge_rms:.3g} %")
    if not words:
        words = ["no budget, the most accurate that is cheap" if method == "dirichlet" else
                 "no budget, the default"]  # fmt: skip
    tried = ", ".join(maps)
    return Choice(maps[method], method, f"{'; '.join(words)}; tried {tried}", bool(met))
