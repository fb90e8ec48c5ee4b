"""What flat maps cost, as rows: a patch, and the same patch by another method or drawing.

Commands name these types before anything is computed: nothing heavy is imported at the top.
"""

from __future__ import annotations

from msgspec import UNSET, UnsetType

from skinmap.rows import column, row

METHOD = "With a method, as of the patch; null where a triangle collapses."


@row
class Spread:
    """Spread of a figure over a map, weighted by area (edges: by length)."""

    mean: float | None = column("Its mean; null where a triangle collapses.", "")
    p95: float | None = column("Its 95th percentile; null where a triangle collapses.")
    max: float | None = column("Its maximum; null where a triangle collapses.", "largest")


@row
class Distorted:
    """What a map costs, at the scale that keeps the whole area."""

    flips: int = column("Triangles that are turned over.")
    quasi_conformal: Spread = column("Ratio of singular values; 1 keeps angles.", "quasi-conformal")
    area: Spread = column("Area of a triangle on the map over its area on the skin.")
    area_sd: float | None = column("Spread of ln(area); null where a triangle is turned over.")
    symmetric_dirichlet: Spread = column("Its energy; 4 is an isometry.", "symmetric Dirichlet")
    stretch: Spread = column("L2 stretch: root mean square of the inverse singular values.")
    stretch_l2: float | None = column("Of the map; null where a triangle collapses.", "stretch L2")
    stretch_linf: float | None = column("The largest one; null where a triangle collapses.")
    arap: Spread = column("Squared distance of each triangle from a rotation.")
    arap_energy: float = column("Mean of these squared distances.")
    edge_strain_percent: Spread = column("Change of the edges' length, without its sign.")
    edge_rms_percent: float = column("Root mean square of the change of the edges' length.")


@row
class WorstFace:
    """One of the triangles furthest from the metric's ideal."""

    channels: list[int] = column("Channels of its corners.")
    value: float | None = column("Its metric; null where the triangle collapses.")


@row
class PatchRow(Distorted):
    """One patch of a part."""

    part: str = column("Name of the part; of a mesh file its name, or its path where two agree.")
    patch: int = column("Number of the patch in its part, from 0.")
    vertices: int = column("Vertices of its map; those on a seam count twice.")
    faces: int = column("Triangles of its map.")
    holes: int = column("Holes of its map.")
    cut_mm: float = column("Length of its seams.")
    period_mm: float | None = column("Period of a tube laid flat uncut; null for other maps.")
    method: str = column("Method that made the map.")
    fallback: bool = column("Whether that is not the method asked for.")
    reason: str = column("Why `auto` took it; empty for other methods.")
    geodesic_stress: float | None = column(
        "Error of distances on the map against those along the skin; null above 200,000 vertices "
        "or with slivers."
    )
    geodesic_stress_error: float | None = column(
        "Half of its 95 % confidence interval; null above 200,000 vertices or with slivers.", "±"
    )
    seconds: float = column("CPU time of the solve.")
    worst: list[WorstFace] = column("Worst triangles by `metric`, the worst first.")
    touches: int | None = column("Touches recorded there; null without `--seam contacts:FILE`.")
    touches_divided: int | None = column("Touches that the seam divides; null as `touches`.")
    touches_divided_shortest: int | None = column(
        "Touches that the shortest seam would divide; null as `touches`."
    )
    touches_saved_percent: float | None = column(
        "Of the touches that the shortest seam divides in one half of the recording, the share "
        "saved by seams chosen on the other half; null as `touches`, or where it divides none."
    )


@row
class ComparedRow:
    """The same patch by another method, or as a drawing has it."""

    part: str = column("Name of the part.")
    patch: int = column("Number of the patch in its part.")
    with_: str = column('Method, "drawing", or the name of a map in the file.', "compared with")
    flips: int | None = column("Triangles turned over; null where too little is drawn.")
    edge_rms_percent: float | None = column("As of the patch; null where too little is drawn.")
    area_sd: float | None = column("As of the patch; null also where too little is drawn.")
    fallback: bool | UnsetType = column(METHOD, default=UNSET)
    seconds: float | UnsetType = column(METHOD, default=UNSET)
    quasi_conformal: Spread | UnsetType = column(METHOD, "quasi-conformal", default=UNSET)
    area: Spread | UnsetType = column(METHOD, default=UNSET)
    symmetric_dirichlet: Spread | UnsetType = column(METHOD, "symmetric Dirichlet", default=UNSET)
    stretch: Spread | UnsetType = column(METHOD, default=UNSET)
    stretch_l2: float | UnsetType | None = column(METHOD, default=UNSET)
    stretch_linf: float | UnsetType | None = column(METHOD, default=UNSET)
    arap: Spread | UnsetType = column(METHOD, default=UNSET)
    arap_energy: float | UnsetType | None = column(METHOD, default=UNSET)
    edge_strain_percent: Spread | UnsetType = column(METHOD, default=UNSET)
    taxels: int | UnsetType = column(
        "With a drawing: its taxels in whole triangles.", "taxels drawn", default=UNSET
    )
    missing: int | UnsetType = column(
        "With a drawing: taxels of the patch that are not drawn.", default=UNSET
    )
    mirrored: bool | UnsetType = column(
        "With a drawing: whether it is drawn as seen from inside.", default=UNSET
    )
    scale: float | UnsetType | None = column(
        "With a drawing: factor from it to the chart; null where too little is drawn.",
        default=UNSET,
    )
    distance_mm: float | UnsetType | None = column(
        "With a drawing: distance from the chart (rms) once moved, turned and scaled onto it; null "
        "where too little is drawn.",
        "apart [mm]",
        default=UNSET,
    )
