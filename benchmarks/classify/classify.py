"""Speed of the classification of touches: `make bench-classify` (ARGS=--quick for a glance).

Every figure is CPU time of one thread, the median of turns that we and the peers take; ratios are
the peer's time over ours. Results go to benchmarks/results/classify.json.

Histograms are of 1,128 taxels: ours, the loop of Algorithm 1 and scikit-learn's k-means.

Periodic structures: how many there are, how firm under noise, and how long they take.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from sklearn.cluster import KMeans
from sklearn.metrics import adjusted_rand_score
from sklearn.svm import SVC

import skinmap
from benchmarks.harness.record import command
from benchmarks.harness.timing import medians, quartiles, ratio_quartiles, take_turns
from benchmarks.live.live import TAUGHT, train
from skinmap.arrays import FloatArray
from skinmap.neighbours.offsets import (
    BAND,
    LATTICE,
    Neighbourhoods,
    concatenate,
    flat_map_directions,
    neighbourhoods,
)
from skinmap.neighbours.structures import RADIUS, Structures, find_structures
from skinmap.recognition.histograms.intersection import (
    IntersectionSVC,
    intersection_function,
    intersection_kernel,
)
from skinmap.recognition.naming import name_touches
from skinmap.skin.modules import module_layout, taxel_table, triangle_sheet
from skinmap.touch.histograms.codebook import Codebook, VoteCounter, learn_codebook, patterns
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.simulator import simulate

REPEATS = 3
NOISE = 0.25e-3  # of the positions [m]
Placed = tuple[FloatArray, FloatArray, FloatArray]  # positions, normals, reference directions
PARTS = ("right_arm", "right_leg_upper", "torso")
LATTICES = {"triangle_12pad": 8e-3, "triangle_10pad": 9.15e-3}  # radius [m]


def structure_rows(*, seeds: int = 5) -> list[dict[str, Any]]:
    """Rows with the key `what`: time, part or noise, and what was measured beside the bound."""
    icub = placed("icub")
    sheet = {"sheet": noisy(tiling("triangle_10pad", 100), 0.1e-3, 0)}
    return [
        time_row("icub", icub),
        time_row("100,000 taxels of 10-pad tiling", sheet),
        *(part_row(part, icub[part]) for part in PARTS),
        *(noise_row(name, radius, seeds) for name, radius in LATTICES.items()),
    ]


def placed(name: str) -> dict[str, Placed]:
    """Positions, normals and reference directions of each part of a robot."""
    robot = skinmap.load_robot(name)
    found = {}
    for part in robot.parts:
        skin = PreparedSkin(robot.skin(part))
        directions = flat_map_directions(skin.flat)
        found[part] = (skin.skin.positions, skin.skin.normals, directions)
    return found


def tiling(name: str, rows: int, *, most: int = 100_000) -> Placed:
    """A flat sheet of `rows` rows of twice as many boards, of at most so many taxels."""
    layout = module_layout(name)
    centres, angles = triangle_sheet([(0, 2 * rows)] * rows, layout.side or 0.0)
    poses = np.tile(np.eye(4), (len(centres), 1, 1))
    poses[:, 0, 0] = poses[:, 1, 1] = np.cos(angles)
    poses[:, 1, 0], poses[:, 0, 1] = np.sin(angles), -np.sin(angles)
    poses[:, :2, 3] = centres
    points = taxel_table(poses, layout).positions[:most]
    n = len(points)
    return points, np.tile([0.0, 0.0, 1.0], (n, 1)), np.tile([0.0, 1.0, 0.0], (n, 1))


def noisy(skin: Placed, noise: float, seed: int) -> Placed:
    """The same with normal noise on the positions in the plane [m]."""
    points, normals, reference = skin
    shift = np.random.default_rng(seed).normal(scale=noise, size=points.shape)
    return points + shift * [1.0, 1.0, 0.0], normals, reference


def hoods_of(skins: dict[str, Placed], radius: float) -> Neighbourhoods:
    """Neighbourhoods of several parts."""
    return concatenate([neighbourhoods(*skin, radius=radius) for skin in skins.values()])


def time_row(name: str, skins: dict[str, Placed]) -> dict[str, Any]:
    """CPU time of neighbourhoods and structures together, compiled and, of a robot, not."""
    row: dict[str, Any] = {"what": "time", "skin": name}
    for key in ("compiled", "numpy")[: 1 + (name == "icub")]:  # of more taxels numpy takes minutes

        def run(compiled: bool = key == "compiled") -> None:
            hoods = hoods_of(skins, RADIUS)
            find_structures(hoods, rotations=LATTICE, compiled=compiled)

        spread = quartiles(take_turns({key: run}, REPEATS)[key])
        row[f"cpu_s_{key}_rotations_6"] = round(spread[1], 3)
        row[f"quartiles_s_{key}_rotations_6"] = spread
    return row


def part_row(part: str, skin: Placed) -> dict[str, Any]:
    """Structures of one part of the iCub without rotation, with a hard and a soft radius."""
    hard, soft = (
        len(find_structures(neighbourhoods(*skin, radius=RADIUS, band=band)).prototypes)
        for band in (0.0, BAND)
    )
    radius_mm = 1e3 * RADIUS
    return {"what": "part", "part": part, "radius_mm": radius_mm, "hard_radius": hard,
            "rotations_1": soft}  # fmt: skip


def noise_row(name: str, radius: float, seeds: int) -> dict[str, Any]:
    """Adjusted Rand index of labels against the noise-free ones, worst of several seeds."""
    skin = tiling(name, 6)

    def found(placed: Placed) -> Structures:
        return find_structures(neighbourhoods(*placed, radius=radius), rotations=LATTICE)

    quiet = found(skin)
    index = [
        float(adjusted_rand_score(quiet.labels, found(noisy(skin, NOISE, seed)).labels))
        for seed in range(seeds)
    ]
    return {
        "what": "noise",
        "lattice": name,
        "radius_mm": 1e3 * radius,
        "rotations": LATTICE,
        "noise_mm": 1e3 * NOISE,
        "structures": len(quiet.prototypes),
        "adjusted_rand_index": {"worst": min(index), "mean": float(np.mean(index))},
    }


TAXELS = 1128  # of 94 modules
BATCH = 200
ONE_RATIOS = {  # of two tasks on one sample
    "numpy_over_literal_loop": ("literal_loop", "numpy"),
    "compiled_over_literal_loop": ("literal_loop", "compiled"),
    "compiled_to_gather": ("compiled", "gather_compiled"),
}
BATCH_RATIOS = {
    "batch_numpy_over_kmeans": ("kmeans_per_structure", "numpy"),
    "batch_compiled_over_kmeans": ("kmeans_per_structure", "compiled"),
}


def literal_loop(book: Codebook, structures: Structures, sample: np.ndarray) -> np.ndarray:
    """Algorithm 1 of the first paper: one taxel after another votes for its nearest codeword."""
    votes = np.zeros(book.words.shape[:2], np.int64)
    for taxel, s in enumerate(structures.labels):
        places = structures.neighbours[taxel]
        pattern = np.concatenate([sample[[taxel]], np.where(places >= 0, sample[places], 0.0)])
        distances = np.linalg.norm(book.words[s] - pattern, axis=1)
        votes[s, np.argmin(distances)] += 1
    return votes[:, 1:].ravel()


def draw(points: np.ndarray, share: float, rng: np.random.Generator) -> np.ndarray:
    """Samples (BATCH, n) of 0 to 1 with a share of the taxels active, side by side."""
    samples = rng.random((BATCH, len(points)))
    if share == 1.0:
        return np.maximum(samples, 0.05)
    active = max(1, round(share * len(points)))
    for sample in samples:
        gap = np.linalg.norm(points - points[rng.integers(len(points))], axis=1)
        sample[np.argsort(gap)[active:]] = 0.0
    return samples


def gather_kernel() -> Any:
    """The neighbour gather alone, compiled: what any histogram has to do at least."""
    from numba import njit

    @njit
    def gather(sample: Any, index: Any, out: Any) -> None:
        for a in range(index.shape[0]):
            for i in range(index.shape[1]):
                out[a, i] = sample[index[a, i]]

    return gather


def histogram_row(rotations: int, share: float, rounds: int) -> dict[str, Any]:
    """One sample and a batch, all ways, on the 1,128 taxels of the tiling."""
    rng = np.random.default_rng(0)
    skin = tiling("triangle_12pad", 7, most=TAXELS)
    points = skin[0]
    structures = find_structures(neighbourhoods(*skin, radius=8e-3), rotations=rotations)
    book = learn_codebook([(structures, draw(points, 1.0, rng))], rng=rng)
    samples = draw(points, share, rng)
    plain = VoteCounter(book, structures, compiled=False)
    fast = VoteCounter(book, structures, compiled=True)
    sample, padded = samples[0], np.append(samples[0], 0.0)
    order = plain.index[:-1].T.copy()
    gathered, gather = np.empty(order.shape), gather_kernel()
    machines = [k_means(words) for words in book.words]
    shapes = range(len(book.words))
    width = book.words.shape[2]

    def predict() -> list[np.ndarray]:
        seen = (patterns(structures, s, samples).reshape(-1, width) for s in shapes)
        return [machine.predict(x) for machine, x in zip(machines, seen, strict=True)]

    one_times = take_turns(
        {
            "literal_loop": (lambda: literal_loop(book, structures, sample), 1),
            "numpy": (lambda: plain.count_one(sample), 50),
            "compiled": (lambda: fast.count_one(sample), 200),
            "gather_compiled": (lambda: gather(padded, order, gathered), 200),
        },
        rounds,
    )
    batch_times = take_turns(
        {
            "kmeans_per_structure": (predict, 1),
            "numpy": (lambda: plain.count(samples), 1),
            "compiled": (lambda: fast.count(samples), 2),
        },
        rounds,
    )
    ratios = ratio_quartiles(one_times, ONE_RATIOS) | ratio_quartiles(batch_times, BATCH_RATIOS)
    some = samples[:20]
    loop = np.array([literal_loop(book, structures, sample) for sample in some])
    ways = (plain.count(some), fast.count(some), np.array([plain.count_one(x) for x in some]))
    return {
        "rotations": rotations,
        "active_share": share,
        "batch_us_per_sample": medians(batch_times, 1e6 / BATCH),
        "votes_that_differ": int(sum(np.abs(way - loop).sum() for way in ways)),
        "ratio_quartiles": ratios,
        "ratios": {name: middle for name, (_, middle, _) in ratios.items()},
    }


def k_means(words: np.ndarray) -> KMeans:
    """scikit-learn's k-means with given centres."""
    machine = KMeans(len(words), n_init=1, max_iter=1, init=words, random_state=0).fit(words)
    machine.cluster_centers_ = np.ascontiguousarray(words)
    return machine


SHARES = ((1, 1.0), (1, 0.03), (6, 1.0), (6, 0.03))  # rotations, share of the taxels active
ROUNDS = 15
TRAIN, TEST = 2500, 2000
BLOCK = 2**22  # numbers at a time in the plain kernel
RATIOS = {  # of two tasks on all samples
    "numpy": ("scikit_learn", "numpy"),
    "compiled": ("scikit_learn", "compiled"),
}
SINGLE_RATIOS = {"one_sample_numpy": ("scikit_learn", "numpy")}  # on one


def measure(quick: bool, *, rounds: int = ROUNDS, seeds: int = 5) -> dict[str, Any]:
    """Rows of histograms, SVM, one sample to its labels, and structures.

    Parameters
    ----------
    quick : bool
        Small sizes, few turns, no structures.
    rounds : int
        Turns that we and the peers take.
    seeds : int
        Noises that each structure is found under.
    """
    rounds = 3 if quick else rounds
    return {
        "histogram": [
            histogram_row(rotations, share, rounds)
            for rotations, share in (SHARES[2:] if quick else SHARES)
        ],
        "intersection_svm": [svm_row(real, quick, rounds) for real in (False, True)],
        "sample_to_labels": live_rows(quick),
        "structures": [] if quick else structure_rows(seeds=seeds),
    }


def sum_of_minima(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The kernel as it is written down: what a user of scikit-learn passes it."""
    kernel = np.empty((len(a), len(b)))
    step = max(1, BLOCK // b.size)
    for start in range(0, len(a), step):
        block = a[start : start + step]
        kernel[start : start + step] = np.minimum(block[:, None], b[None]).sum(axis=2)
    return kernel


def svm_row(real: bool, quick: bool, rounds: int) -> dict[str, Any]:
    """Decision values of 2,000 histograms and of one, four classes."""
    rng = np.random.default_rng(1)
    train, test = (500, 200) if quick else (TRAIN, TEST)
    mean = rng.gamma(0.4, 6.0, (4, 64))
    # Classes overlap on purpose: about a thousand support vectors are left.
    mean = 0.845 * mean.mean(axis=0) + 0.155 * mean
    labels = np.arange(train) % 4
    x = rng.poisson(mean[labels]).astype(float)
    z = rng.poisson(mean[np.arange(test) % 4]).astype(float)
    if real:
        x, z = x + rng.random(x.shape) * (x > 0), z + rng.random(z.shape) * (z > 0)
    ours = IntersectionSVC().fit(x, labels)
    gram = intersection_kernel(x, x) / ours.scale_
    svc = SVC(kernel="precomputed", C=ours.C).fit(gram, labels)
    support = x[svc.support_]

    def peer(rows: np.ndarray) -> np.ndarray:
        kernel = np.zeros((len(rows), len(x)))  # only the support columns are ever read
        kernel[:, svc.support_] = sum_of_minima(rows, support) / ours.scale_
        return svc.decision_function(kernel)

    known = np.zeros((len(z), len(x)))
    known[:, svc.support_] = intersection_kernel(z, support) / ours.scale_
    parts = (ours.support_histograms_, ours.coefficients_, ours.intercept_)
    plain, fast = intersection_function(*parts), intersection_function(*parts)
    fast.compile()
    one = z[:1]
    many_times = take_turns(
        {
            "scikit_learn": (lambda: peer(z), 1),
            "numpy": (lambda: plain(z), 2),
            "compiled": (lambda: fast(z), 5),
        },
        rounds,
    )
    single_times = take_turns(
        {"scikit_learn": (lambda: peer(one), 5), "numpy": (lambda: plain(one), 100)}, rounds
    )
    ratios = ratio_quartiles(many_times, RATIOS) | ratio_quartiles(single_times, SINGLE_RATIOS)
    gap = np.abs(ours.decision_function(z) - peer(z)).max()
    return {
        "counts": "real" if real else "whole",
        "one_sample_us": medians(single_times, 1e6),
        "largest_difference": float(gap),
        "labels_that_differ": int((ours.predict(z) != svc.predict(known)).sum()),
        "ratio_quartiles": ratios,
        "ratios": {name: middle for name, (_, middle, _) in ratios.items()},
    }


def live_rows(quick: bool) -> list[dict[str, Any]]:
    """One sample of a touch, without a past, to its labels, by each classifier."""
    robot = skinmap.load_robot("icub")
    skins = {part: PreparedSkin(robot.skin(part)) for part in TAUGHT}
    skin, rng = skins["torso"], np.random.default_rng(3)
    recorded = simulate(skin.skin, rng=rng, per_gesture=4).touches()
    # The middle of each touch: a sample of a hand at rest on the skin.
    middles = [samples[len(samples) // 2] for _, _, samples in recorded]
    rows = []
    for name in ("contact-geometry", "histogram"):
        model = train(skins, name, 8 if quick else 16)
        model.prepare(skin)
        cost = np.zeros(len(middles))
        for _ in range(3):  # the first time warms up
            for number, sample in enumerate(middles):
                start = time.process_time()
                name_touches(model, skin, sample[None])
                cost[number] = (time.process_time() - start) * 1e3
        found = {"mean": float(cost.mean()), "quartiles": quartiles(cost)}
        rows.append({"classifier": name, "one_sample_alone_1_touched_ms": found})
    return rows


if __name__ == "__main__":
    command(measure, __doc__, "classify")
