"""A family of links and boards with known truth: shapes, meshes and boards that no robot gave.

A board is laid on a shape given by a formula, so that the place of every taxel is known. `flat`
boards are the flat map of where they lie, as `skinmap.flatten` makes it; `modules` are rigid
triangles of ten taxels whose gaps open and close, which nothing in the wrap assumes. The link's
mesh is the shape itself, fine, coarse, noisy or open, below the taxels by an unknown height.

Boards and links of the real iCub, and simulated evidence of where the taxels are.

The truth are the taxels of the built-in iCub; a board is the flat map of a patch, of at most 16
modules round a random one. Evidence is made from the truth with noise of known spread.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.interpolate import CloughTocher2DInterpolator
from scipy.spatial import Delaunay
from scipy.spatial.transform import Rotation

import skinmap
from calibration import Touch
from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.rigid import turn_about
from skinmap.geometry.triangles import unit
from skinmap.skin.skin import Skin

MAX_MODULES = 16
FELT = 4e-3  # width of what a taxel feels [m]
LEAST = 0.08  # share of its largest value that counts as felt
GAIN = 0.25  # spread of the taxels' gains
TRIANGLE = 12e-3  # longest side of a triangle of taxels that is skin [m]


@dataclass(frozen=True, eq=False, slots=True)
class Case:
    """A patch: part, board (n, 2), true places (n, 3) [m], modules (n,) and its link's mesh."""

    part: str
    layout: FloatArray
    truth: FloatArray
    modules: IntArray
    vertices: FloatArray
    faces: IntArray


def icub_cases() -> Iterator[Case]:
    """All patches of the iCub."""
    robot = skinmap.load_robot("icub")
    for part in robot.parts:
        skin = robot.skin(part)
        link = robot.mesh(skin.link)
        for chart in skinmap.flatten(skinmap.build_surface(skin)).charts:
            keep = _some_modules(skin.modules[chart.taxels], chart.uv)
            taxels = chart.taxels[keep]
            truth, modules = skin.positions[taxels], skin.modules[taxels]
            yield Case(part, chart.uv[keep], truth, modules, link.vertices, link.faces)


def _some_modules(modules: IntArray, uv: FloatArray) -> FloatArray:
    names = np.unique(modules)
    middle = np.array([uv[modules == name].mean(axis=0) for name in names])
    first = np.random.default_rng(0).integers(len(names))
    order = np.argsort(np.linalg.norm(middle - middle[first], axis=1))
    return np.isin(modules, names[order[:MAX_MODULES]])


def normalised(error: FloatArray, covariance: FloatArray) -> float:
    """Mean square of errors (n, 3) in their stated spreads (n, 3, 3): 1 where these are true."""
    square = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error)
    return float(square.mean() / 3)


def displaced(
    middle: FloatArray, rng: np.random.Generator, angle: float, distance: float
) -> FloatArray:
    """T (4, 4) that turns by an angle about a random axis through a point, and shifts [m]."""
    turn, way = unit(rng.normal(size=(2, 3)))
    return turn_about(middle, Rotation.from_rotvec(angle * turn).as_matrix(), distance * way)


def counted(words: Iterable[object]) -> dict[str, int]:
    """How often each word comes, by its name."""
    return dict(sorted(Counter(map(str, words)).items()))


def far_apart(layout: FloatArray, count: int, rng: np.random.Generator) -> IntArray:
    """Taxels (count,) of a board, each the furthest from those before."""
    start = layout[rng.integers(len(layout))]
    chosen = [int(np.argmax(np.linalg.norm(layout - start, axis=1)))]
    while len(chosen) < count:
        gap = np.linalg.norm(layout[:, None] - layout[chosen][None], axis=2).min(axis=1)
        chosen.append(int(np.argmax(gap)))
    return np.array(chosen)


def simulate_touches(
    case: Case,
    count: int,
    rng: np.random.Generator,
    *,
    noise: float,
    wrong: float = 0.0,
    dead: float = 0.0,
    one_module: bool = False,
) -> list[Touch]:
    """Touches at random places; `wrong` of them have the place of another taxel."""
    corners = Delaunay(case.layout).simplices
    sides = case.layout[corners] - case.layout[np.roll(corners, 1, axis=1)]
    corners = corners[np.linalg.norm(sides, axis=2).max(axis=1) < TRIANGLE]
    if one_module:
        own = case.modules == case.modules[rng.integers(len(case.modules))]
        corners = corners[own[corners].all(axis=1)]
    n = len(case.layout)
    gain = np.exp(rng.normal(0.0, GAIN, n)) * (rng.random(n) >= dead)
    touches: list[Touch] = []
    while len(touches) < count:
        place = rng.dirichlet([1.0] * 3) @ case.truth[corners[rng.integers(len(corners))]]
        value = gain * np.exp(-np.sum((case.truth - place) ** 2, axis=1) / (2 * FELT**2))
        felt = np.flatnonzero(value > LEAST)
        if len(felt) == 0:
            continue
        if rng.random() < wrong:
            place = case.truth[rng.integers(n)]
        touches.append(Touch(place + rng.normal(0.0, noise, 3), noise, felt, value[felt]))
    return touches


SIDE = 30e-3  # of the triangles that the modules stand in, gaps included [m]
PITCH = 6.6e-3  # of the ten taxels of a module [m]
Shape = Callable[[FloatArray, FloatArray], FloatArray]  # arc lengths (n,), (n,) [m] to (n, 3)


def tube(
    bend: float, u: FloatArray, v: FloatArray, *, radius: float = 35e-3, taper: float = 0.0
) -> FloatArray:
    """A tube bent with a radius: u goes round it, v along it; it widens by `taper` a length."""
    a, b = u / radius, v / bend
    # The side that looks away from the centre of the bend is longer.
    wide = radius + taper * v
    arm = bend + wide * np.cos(a)
    return np.column_stack([arm * np.cos(b) - bend, wide * np.sin(a), arm * np.sin(b)])


def section(half: Callable[..., FloatArray], *sizes: float) -> Shape:
    """A straight prism round z: `half` takes sizes and angles (k,) to points (k, 2) [m]."""
    angle = np.linspace(-np.pi, np.pi, 4001)
    points = half(*sizes, angle)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    along -= np.interp(0.0, angle, along)

    def place(u: FloatArray, v: FloatArray) -> FloatArray:
        x, y = (np.interp(u, along, points[:, k], period=along[-1] - along[0]) for k in (0, 1))
        return np.column_stack([x, y, v])

    return place


def ellipse(a: float, b: float, t: FloatArray) -> FloatArray:
    """Section (k, 2) of an elliptic cylinder."""
    return np.column_stack([a * np.cos(t), b * np.sin(t)])


def box(a: float, b: float, edge: float, t: FloatArray) -> FloatArray:
    """Section (k, 2) of a flat box with round edges: half widths and the edges' radius [m]."""
    way = np.column_stack([np.cos(t), np.sin(t)])
    core = np.array([a - edge, b - edge])
    # The point of a rounded box that looks along `way` at its corner, else on its flat side.
    grown = way * 4.0 * max(a, b)
    inner = np.clip(grown, -core, core)
    out = grown - inner
    return inner + edge * out / np.linalg.norm(out, axis=1, keepdims=True)


def cone(radius: float, slope: float, u: FloatArray, v: FloatArray) -> FloatArray:
    """A cone round z whose radius grows by `slope` for each length along it."""
    r, a = radius + slope * v, u / radius
    return np.column_stack([r * np.cos(a), r * np.sin(a), np.sqrt(1.0 - slope**2) * v])


def ball(radius: float, u: FloatArray, v: FloatArray) -> FloatArray:
    """A ball: u along its equator, v along its meridians."""
    a, b = u / radius, v / radius
    return radius * np.column_stack([np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)])


def saddle(radius: float, u: FloatArray, v: FloatArray) -> FloatArray:
    """A saddle whose two curvatures have this radius at its middle, over x."""
    return np.column_stack([(u**2 - v**2) / (2 * radius), u, v])


def torso(a: float, b: float, tall: float, u: FloatArray, v: FloatArray) -> FloatArray:
    """A chest: an ellipse that swells and shrinks along its height."""
    swell = 1.0 - 0.25 * (v / tall) ** 2 + 0.06 * np.cos(3 * v / tall)
    t = u / a
    return np.column_stack([b * swell * np.cos(t), a * swell * np.sin(t), v])


@dataclass(frozen=True, slots=True)
class Link:
    """One link of the family.

    Attributes
    ----------
    name : str
    shape : callable
    around, along : (low, high) [m]
        What the mesh covers of both arc lengths.
    mesh : str
        "fine", "coarse", "noisy" or "open".
    rows, columns : int
        Of triangles on the board.
    judged : bool
        Whether no constant of the wrap was chosen by it.
    """

    name: str
    shape: Shape
    around: tuple[float, float]
    along: tuple[float, float]
    mesh: str
    rows: int
    columns: int
    judged: bool


def whole(radius: float) -> tuple[float, float]:
    """Arc lengths once round."""
    return -np.pi * radius, np.pi * radius


HALF = (-0.11, 0.11)
CYLINDER, TORSO = partial(tube, 1e4, radius=45e-3), partial(torso, 0.11, 0.075, 0.16)
LINKS = (
    Link("cylinder", CYLINDER, whole(45e-3), HALF, "fine", 4, 4, False),
    Link("cylinder, coarse", CYLINDER, whole(45e-3), HALF, "coarse", 2, 8, True),
    Link("cone", partial(cone, 45e-3, 0.25), whole(45e-3), HALF, "noisy", 4, 4, False),
    Link("ellipse", section(ellipse, 60e-3, 35e-3), (-0.1522, 0.1522), HALF, "fine", 3, 6, True),
    Link("box", section(box, 60e-3, 32e-3, 14e-3), (-0.16, 0.16), HALF, "fine", 4, 4, True),
    Link("tube of 150", partial(tube, 0.15), whole(35e-3), HALF, "fine", 4, 4, True),
    Link("tube of 150, noisy", partial(tube, 0.15), whole(35e-3), HALF, "noisy", 3, 5, True),
    Link("tube of 300", partial(tube, 0.3), whole(35e-3), HALF, "fine", 3, 8, False),
    Link("tube of 300, open", partial(tube, 0.3), (-0.085, 0.085), HALF, "open", 3, 6, True),
    Link("tube of 300, coarse", partial(tube, 0.3), whole(35e-3), HALF, "coarse", 4, 7, True),
    Link("tube of 600", partial(tube, 0.6), whole(35e-3), HALF, "fine", 3, 7, True),
    Link("ball", partial(ball, 60e-3), whole(60e-3), (-0.094, 0.094), "fine", 3, 5, False),
    Link("ball of 90, open", partial(ball, 90e-3), (-0.14, 0.14), (-0.1, 0.1), "open", 4, 5, True),
    Link("saddle", partial(saddle, 0.12), (-0.09, 0.09), (-0.09, 0.09), "fine", 4, 4, True),
    Link("torso", TORSO, whole(0.11), (-0.13, 0.13), "noisy", 5, 5, True),
)  # fmt: skip
EDGE = {"fine": 5e-3, "coarse": 16e-3, "noisy": 5e-3, "open": 6e-3}  # of the mesh [m]
NOISE = 0.4e-3  # of a noisy mesh's vertices [m]
REACHES = (1.1, 1.2, 1.3, 1.4, 1.6)  # of the chart that a board is drawn on, in boards
INSIDE, OUTSIDE = -1.5e-3, 2e-3  # heights of the taxels above the mesh: covers of either kind [m]


def family_cases(board: str) -> Iterator[tuple[Link, Case]]:
    """Every link with a board of one kind: "flat" or "modules"."""
    for number, link in enumerate(LINKS):
        rng = np.random.default_rng([number, board == "modules"])
        height = rng.uniform(INSIDE, OUTSIDE)
        vertices, faces = link_mesh(link, rng)
        layout, truth, modules = (flat_board if board == "flat" else rigid_board)(link, height)
        yield link, Case(f"{link.name}, {board}", layout, truth, modules, vertices, faces)


def _frames(shape: Shape, uv: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places (n, 3) and frames (n, 3, 3) whose columns are along u, across it, and outward."""
    step = 1e-5
    place = shape(*uv.T)
    along = shape(uv[:, 0] + step, uv[:, 1]) - shape(uv[:, 0] - step, uv[:, 1])
    up = shape(uv[:, 0], uv[:, 1] + step) - shape(uv[:, 0], uv[:, 1] - step)
    out = np.cross(along, up)
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return place, np.stack([along, np.cross(out, along), out], axis=2)


def _triangles(rows: int, columns: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Middles (m, 2), turns (m,) of the modules, and ten taxels (10, 2) round a middle [m]."""
    row, column = np.divmod(np.arange(rows * columns), columns)
    upside = (row + column) % 2
    high = row * SIDE * np.sqrt(0.75) + upside * SIDE / 3.46
    places = np.column_stack([column * SIDE / 2, high])
    lattice = [[PITCH * (i + 0.5 * j), PITCH * np.sqrt(0.75) * j]
               for j in range(4) for i in range(4 - j)]  # fmt: skip
    taxels = np.array(lattice) - np.mean(lattice, axis=0)
    return places - places.mean(axis=0), np.pi * upside, taxels


def _turned(angle: FloatArray, points: FloatArray) -> FloatArray:
    """(m, k, 2) points (k, 2) turned by angles (m,)."""
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    x, y = points.T
    return np.stack([c * x - s * y, s * x + c * y], axis=2)


def _flattened(truth: FloatArray, normals: FloatArray, modules: IntArray) -> FloatArray:
    """The flat map (n, 2) of taxels, seen from outside."""
    skin = Skin("board", "", np.arange(len(truth)), modules, truth, normals)
    charts = skinmap.flatten(skinmap.build_surface(skin)).charts
    if len(charts) != 1 or len(charts[0].taxels) != len(truth):
        raise ValueError(f"{len(charts)} charts of {len(truth)} taxels")
    layout = np.empty((len(truth), 2))
    layout[charts[0].taxels] = charts[0].uv
    return layout


def _chart(shape: Shape, reach: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Flat places (k, 2) and arc lengths (k, 2) of a grid that reaches so far (2,) [m].

    Boards are drawn with even lengths, arc lengths of a formula are not even: the flat map of a
    grid says where on the shape a place of the drawing comes to lie.
    """
    span = [np.linspace(-half, half, round(2 * half / 4e-3) + 1) for half in reach]
    uv = np.stack(np.meshgrid(*span, indexing="ij"), axis=-1).reshape(-1, 2)
    place, frame = _frames(shape, uv)
    flat = _flattened(place, frame[:, :, 2], np.zeros(len(uv), np.int64))
    middle = int(np.argmin(np.linalg.norm(uv, axis=1)))
    flat = flat - flat[middle]
    near = np.linalg.norm(uv, axis=1) < 15e-3
    left, _, right = np.linalg.svd(flat[near].T @ uv[near])
    return flat @ (left @ right), uv


def _raised(shape: Shape, height: float) -> Shape:
    """A shape some way above another: a board is as long as where it lies, not as the link."""

    def place(u: FloatArray, v: FloatArray) -> FloatArray:
        on, frame = _frames(shape, np.column_stack([u, v]))
        return on + height * frame[:, :, 2]

    return place


def _laid(link: Link, shape: Shape) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """The drawing (m, 10, 2), arc lengths there (m, 10, 2), of the middles (m, 2), and theirs."""
    middles, turns, taxels = _triangles(link.rows, link.columns)
    drawn = middles[:, None] + _turned(turns, taxels)
    for reach in REACHES:  # no further than the board needs: what lies beyond stretches the map
        flat, uv = _chart(shape, reach * np.abs(drawn).max(axis=(0, 1)))
        across = CloughTocher2DInterpolator(flat, uv)
        if np.isfinite(across(drawn)).all():
            return drawn, across(drawn), across(middles), middles
    raise ValueError(f"no chart of {link.name} holds the board")


def flat_board(link: Link, height: float) -> tuple[FloatArray, FloatArray, IntArray]:
    """A flexible board: its layout (n, 2) is the flat map of where it lies (n, 3); modules (n,)."""
    shape = _raised(link.shape, height)
    drawn, uv, _, _ = _laid(link, shape)
    truth, frame = _frames(shape, uv.reshape(-1, 2))
    modules = np.repeat(np.arange(len(drawn)), drawn.shape[1])
    return _flattened(truth, frame[:, :, 2], modules), truth, modules


def rigid_board(link: Link, height: float) -> tuple[FloatArray, FloatArray, IntArray]:
    """Rigid modules, each tangent where its middle comes to lie; the drawing is regular."""
    shape = _raised(link.shape, height)
    drawn, uv, centres, middles = _laid(link, shape)
    place, frame = _frames(shape, centres)
    # Turned in its tangent plane as the shape's own points round it lie.
    around = shape(*uv.reshape(-1, 2).T).reshape(*drawn.shape[:2], 3) - place[:, None]
    flat = np.einsum("mki,mij->mkj", around, frame[:, :, :2])
    flat = flat - flat.mean(axis=1, keepdims=True)
    own = drawn - middles[:, None]
    left, _, right = np.linalg.svd(np.einsum("mki,mkj->mij", flat, own))
    placed = np.einsum("mij,mkj->mki", left @ right, own)
    truth = place[:, None] + np.einsum("mij,mkj->mki", frame[:, :, :2], placed)
    modules = np.repeat(np.arange(len(drawn)), drawn.shape[1])
    return drawn.reshape(-1, 2), truth.reshape(-1, 3), modules


def link_mesh(link: Link, rng: np.random.Generator) -> tuple[FloatArray, IntArray]:
    """The link's mesh: vertices (v, 3) [m] and faces (f, 3), closed by caps but where open."""
    edge = EDGE[link.mesh]
    steps = [max(4, round(float(high - low) / edge)) for low, high in (link.around, link.along)]
    u, v = (np.linspace(*span, count + 1)
            for span, count in zip((link.around, link.along), steps, strict=True))  # fmt: skip
    grid = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    vertices = link.shape(*grid.T)
    if link.mesh == "noisy":
        vertices = vertices + rng.normal(0.0, NOISE, vertices.shape)
    row = np.arange(steps[0] * (steps[1] + 1)).reshape(steps[0], -1)[:, :-1].ravel()
    below = row + steps[1] + 1
    faces = np.concatenate([
        np.column_stack([row, below, below + 1]), np.column_stack([row, below + 1, row + 1])
    ])  # fmt: skip
    if link.mesh == "open":
        return vertices, faces
    return _capped(vertices, faces, steps, link)


def _capped(
    vertices: FloatArray, faces: IntArray, steps: list[int], link: Link
) -> tuple[FloatArray, IntArray]:
    """Caps at both ends; a shape that is not round is closed behind, 80 mm below its lowest."""
    wide, tall = steps[0] + 1, steps[1] + 1
    rim = np.concatenate([
        np.arange(wide) * tall, (wide - 1) * tall + np.arange(tall),
        np.arange(wide)[::-1] * tall + tall - 1, np.arange(tall)[::-1],
    ])  # fmt: skip
    if np.allclose(vertices[:tall], vertices[-tall:], atol=4 * NOISE):
        vertices = vertices.copy()
        vertices[-tall:] = vertices[:tall]  # the seam, also where it is noisy
        ends = [np.arange(wide) * tall, np.arange(wide)[::-1] * tall + tall - 1]
        parts = [faces]
        for end in ends:
            vertices = np.vstack([vertices, vertices[end].mean(axis=0)])
            middle = np.full(wide - 1, len(vertices) - 1)
            parts.append(np.column_stack([end[1:], end[:-1], middle]))
        return vertices, np.concatenate(parts)
    bottom = vertices[rim] - [0.08, 0.0, 0.0]
    first = len(vertices)
    vertices = np.vstack([vertices, bottom, bottom.mean(axis=0)])
    k = np.arange(len(rim))
    after = (k + 1) % len(rim)
    middle = np.full(len(rim), len(vertices) - 1)
    skirt = [
        np.column_stack([rim[k], first + k, first + after]),
        np.column_stack([rim[k], first + after, rim[after]]),
        np.column_stack([first + k, middle, first + after]),
    ]
    return vertices, np.concatenate([faces, *skirt])
