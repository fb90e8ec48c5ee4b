"""What `skinmap flatten` finds: the types of its result."""

from __future__ import annotations

from dataclasses import dataclass, field

from msgspec import UNSET, UnsetType


@dataclass(frozen=True, kw_only=True, slots=True)
class Spread:
    """How a figure is spread over a map, weighted by area (edges: by length).

    Attributes
    ----------
    mean, p95, max
        The 95th percentile between mean and largest; null where a triangle collapses.
    """

    mean: float | None
    p95: float | None
    max: float | None


@dataclass(frozen=True, kw_only=True, slots=True)
class Distorted:
    """What a map costs, at the scale that keeps the whole area.

    Attributes
    ----------
    flips
        Triangles that are turned over.
    quasi_conformal
        Ratio of the singular values; 1 keeps angles.
    area
        Area on the map over area on the skin.
    area_sd
        Spread of its logarithm; null where a triangle is turned over.
    symmetric_dirichlet
        Symmetric Dirichlet energy; 4 is an isometry.
    stretch
        Root mean square of the singular values.
    stretch_l2, stretch_linf
        Its mean square and its largest; null where a triangle collapses.
    arap
        Squared distance of each triangle from a rotation.
    arap_energy
        Its mean.
    edge_strain_percent
        Change of the edges' length, without its sign.
    edge_rms_percent
        Its root mean square.
    """

    flips: int
    quasi_conformal: Spread
    area: Spread
    area_sd: float | None
    symmetric_dirichlet: Spread
    stretch: Spread
    stretch_l2: float | None
    stretch_linf: float | None
    arap: Spread
    arap_energy: float
    edge_strain_percent: Spread
    edge_rms_percent: float


@dataclass(frozen=True, kw_only=True, slots=True)
class WorstFace:
    """One of the triangles furthest from the metric's ideal.

    Attributes
    ----------
    channels
        Of its corners.
    value
        Of the metric; null where the triangle collapses.
    """

    channels: list[int]
    value: float | None


@dataclass(frozen=True, kw_only=True, slots=True)
class PatchRow(Distorted):
    """One patch of a part.

    Attributes
    ----------
    part, patch
        Name of the part, and the patch's number in it. A mesh file is a part by its name, or by its
        path as it was given where two files have the same name.
    vertices, faces, holes
        How many.
    cut_mm
        Length of the seams.
    period_mm
        After which the map of a tube laid flat uncut repeats itself; null for others.
    touches
        With `--seam contacts`: how many the recording has there; null for others, as below.
    touches_divided, touches_divided_shortest
        How many of them the seam divides, and how many the shortest one would; null without it.
    touches_saved_percent
        Of those that the shortest divides, in one half of the recording, by seams chosen on the
        other half; null where it divides none. Little where touches are spread evenly: then the
        shortest seam stays.
    method
        The one that made the map.
    fallback
        Whether that is not the one asked for.
    reason
        Why `auto` took it; empty for other methods.
    geodesic_stress
        Deviation of distances on the map from those along the skin; null above 200,000 vertices.
    geodesic_stress_error
        Half of its 95 % confidence interval; null above 200,000 vertices.
    seconds
        CPU time of the solve.
    worst
        The worst triangles by `metric`, worst first.
    """

    part: str
    patch: int
    vertices: int
    faces: int
    holes: int
    cut_mm: float
    period_mm: float | None
    method: str
    fallback: bool
    reason: str
    geodesic_stress: float | None
    geodesic_stress_error: float | None
    seconds: float
    worst: list[WorstFace]
    touches: int | None = None
    touches_divided: int | None = None
    touches_divided_shortest: int | None = None
    touches_saved_percent: float | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class ComparedRow:
    """The same patch by another method, or as a drawing has it.

    Attributes
    ----------
    part, patch
        As above.
    with_
        The method, "drawing", or the name of a map that the skin's file brings.
    flips, edge_rms_percent
        As above; null where too little of the patch is drawn.
    area_sd
        As above; null also where a triangle is turned over.
    fallback, seconds
        With a method, as above.
    quasi_conformal, area, symmetric_dirichlet, stretch, arap, edge_strain_percent
        With a method, as above.
    stretch_l2, stretch_linf, arap_energy
        With a method, as above; null where a triangle collapses.
    taxels
        With a drawing: taxels matched, in whole triangles.
    missing
        With a drawing: taxels of the patch that are not drawn.
    mirrored
        With a drawing: whether it is drawn as seen from inside.
    scale, distance_mm
        With a drawing: its scale, and its distance from the chart (rms) after moving, turning and
        scaling; null where too little is drawn.
    """

    part: str
    patch: int
    with_: str
    flips: int | None
    edge_rms_percent: float | None
    area_sd: float | None
    fallback: bool | UnsetType = UNSET
    seconds: float | UnsetType = UNSET
    quasi_conformal: Spread | UnsetType = UNSET
    area: Spread | UnsetType = UNSET
    symmetric_dirichlet: Spread | UnsetType = UNSET
    stretch: Spread | UnsetType = UNSET
    stretch_l2: float | UnsetType | None = UNSET
    stretch_linf: float | UnsetType | None = UNSET
    arap: Spread | UnsetType = UNSET
    arap_energy: float | UnsetType | None = UNSET
    edge_strain_percent: Spread | UnsetType = UNSET
    taxels: int | UnsetType = UNSET
    missing: int | UnsetType = UNSET
    mirrored: bool | UnsetType = UNSET
    scale: float | UnsetType | None = UNSET
    distance_mm: float | UnsetType | None = UNSET


@dataclass(frozen=True, kw_only=True, slots=True)
class FlattenResult:
    """Flat maps and what they distort.

    Attributes
    ----------
    robot
        Its name, or those of the mesh files with commas between.
    method
        The one asked for.
    meshing
        How surfaces were meshed; null for files that are surfaces: meshes, CySkin files.
    iterations
        Asked for; null: the method's own.
    precision
        Of the sparse solves.
    seam
        How seams were placed: "shortest", "contacts", "file" or "none".
    metric
        What colours the maps and chooses the worst triangles.
    scale
        Of these colours: "own" range of each map, or "fixed" for the metric.
    seed
        Of all randomness.
    patches
        Part by part, in the order of the command line.
    compare
        By `--compare` and `--drawing`, in the same order.
    seconds
        CPU time of all solves.
    files
        Names inside `--out`.
    """

    robot: str
    method: str
    meshing: str | None
    iterations: int | None
    precision: str
    seam: str
    metric: str
    scale: str
    seed: int
    patches: list[PatchRow]
    compare: list[ComparedRow]
    seconds: float
    files: list[str] = field(default_factory=list)
