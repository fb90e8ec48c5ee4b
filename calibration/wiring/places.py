"""Where to touch next: the place whose answer would tell most about the faults still possible.

The gain of a place has two parts. Faults that are merely possible are told from a healthy skin
only: the chance that the next answer shows one, times what that would be worth. The few faults that
have become probable are told from each other by a bound on the mutual information that needs
pairwise overlaps only (Kolchinsky and Tracey, "Estimating mixture entropy with pairwise distances",
Entropy 19, 2017, with Bhattacharyya's overlap).

A module alone cannot say whether its board is turned or the finger was off to a side. Its
neighbours can, as they answer the same finger; so the error of the place is summed over jointly for
all modules that a poke lights, and places where several modules meet tell most.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from calibration.wiring.boards import Boards, Fault, Hypotheses, Wiring, conjugate
from calibration.wiring.touches import (
    NEAR,
    SHAPES,
    SPIKE,
    TABLE,
    TIMING,
    offsets,
    sideways,
    steps_at,
    tangents,
)
from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.log_maps import log_map
from skinmap.geometry.proximity import bridged_graph, nearest_first
from skinmap.geometry.triangles import pair_lengths

ACROSS = 14e-3  # taxels of two modules so near have a place between them [m]
APART = 3.5e-3  # candidates for pokes lie so far apart [m]
STROKE, STEP, GAP = 0.09, 6e-3, 9e-3  # length of a stroke, its points, and the widest hole [m]
SHORTEST = 0.045  # of a stroke where the skin ends [m]
NEVER = 1e-9  # a fault less probable asks for nothing (and slows sums of single floats down)
PROBABLE, MANY = 0.05, 5  # faults above are told from each other, at most so many
WORTH = 9.0  # most that showing a fault is worth [nats]
ENOUGH = 6.0  # evidence for a board laid otherwise beyond which a poke is worth no more [nats]
MISSED = 0.03  # chance that a module does not answer, however well it was aimed at
AGAIN = 8e-3  # touches so near each other are one place [m]
POKES = ((6e-3, 50.0), (6e-3, 150.0))  # width [m] and force [counts] of the pokes reckoned with
OVERLAP_DIMENSIONS = 4  # that the overlaps of answers are laid out in


@dataclass(frozen=True, eq=False, slots=True)
class Candidates:
    """Places that may be asked for.

    Attributes
    ----------
    paths : tuple of (p, 3) array
        Places [m]; of strokes their points.
    middles : (c, 3) float
    answers : (c, m, k) float
        Chance that each slot of each site answers.
    silent : (c, m) float
        Chance that none of a site's slots does.
    arrivals : (c, m, k) float
        When a stroke comes by.
    laid : (c, 5, m) float
        Evidence that a poke brings where a site's board is laid otherwise [nats].
    """

    paths: tuple[FloatArray, ...]
    middles: FloatArray
    answers: FloatArray
    silent: FloatArray
    arrivals: FloatArray
    laid: FloatArray

    def __len__(self) -> int:
        return len(self.paths)


def candidates(boards: Boards, how: str) -> Candidates:
    """Places of a part for one kind of touch."""
    poked = how == "poke"
    paths = [point[None] for point in _between(boards)] if poked else _stroke_paths(boards)
    middles = np.array([path[len(path) // 2] for path in paths])
    answers, silent, arrivals = _answers(boards, paths)
    laid = np.zeros((0, 5, len(boards)))
    if poked and boards.turnable:
        laid = _telling(boards, middles)
    return Candidates(tuple(paths), middles, answers, silent, arrivals, laid)


def _between(boards: Boards) -> FloatArray:
    """Places between modules first, where one poke asks two or three; corners of modules after."""
    positions, modules = boards.table.positions, boards.table.modules
    pairs = cKDTree(positions).query_pairs(ACROSS, output_type="ndarray")
    pairs = pairs[modules[pairs[:, 0]] != modules[pairs[:, 1]]]
    facing = np.einsum("ij,ij->i", boards.normals[pairs[:, 0]], boards.normals[pairs[:, 1]]) > 0.0
    pairs = pairs[facing]
    middles = 0.5 * (positions[pairs[:, 0]] + positions[pairs[:, 1]])
    # A taxel, a place beside and the nearest of two other modules: where three meet.
    order = nearest_first(pair_lengths(positions, pairs))
    points = np.concatenate([middles[order], positions])
    kept: list[int] = []
    taken = np.zeros(len(points), bool)
    tree = cKDTree(points)
    for row in range(len(points)):
        if not taken[row]:
            kept.append(row)
            taken[tree.query_ball_point(points[row], APART)] = True
    return np.asarray(points[kept])


def _stroke_paths(boards: Boards) -> list[FloatArray]:
    """Straight strokes over the middle of each module, in four directions."""
    positions, normals = boards.table.positions, boards.normals
    graph = bridged_graph(positions, 10, 2.5 * boards.pitch)
    paths = []
    for centre in boards.centres:
        source = int(np.argmin(np.linalg.norm(positions - centre, axis=1)))
        uv, _ = log_map(positions, normals, graph, source, STROKE)
        known = np.flatnonzero(np.isfinite(uv[:, 0]))
        tree = cKDTree(uv[known])
        for angle in np.pi / 4 * np.arange(4):
            steps = np.arange(-STROKE / 2, STROKE / 2 + 1e-9, STEP)
            line = steps[:, None] * [np.cos(angle), np.sin(angle)]
            away, near = tree.query(line, k=3)
            good = away[:, 0] < GAP
            middle = len(line) // 2
            first = middle - int(np.argmin(np.append(good[middle::-1], False))) + 1
            last = middle + int(np.argmin(np.append(good[middle:], False)))
            if (last - first - 1) * STEP < SHORTEST or not good[middle]:
                continue
            weight = 1.0 / (away + 1e-3) ** 2
            weight /= weight.sum(axis=1, keepdims=True)
            points = (weight[..., None] * positions[known[near]]).sum(axis=1)
            paths.append(points[first:last])
    return paths


def _answers(boards: Boards, paths: list[FloatArray]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Chances that slots (c, m, k) answer and that modules (c, m) do not, and when (c, m, k)."""
    m, k = boards.columns.shape
    answers = np.full((len(paths), m, k), SPIKE)
    silent = np.ones((len(paths), m))
    arrivals = np.zeros((len(paths), m, k))
    answer = 1.0 - np.exp(TABLE[0])
    spread = np.linspace(-2.0, 2.0, 5)
    weight = np.exp(-0.5 * spread**2)
    weight /= weight.sum()
    grid, log_weight = offsets()
    for row, path in enumerate(paths):
        away = np.linalg.norm(boards.centres[:, None] - path[None], axis=2).min(axis=1)
        near = np.flatnonzero(away < NEAR)
        slots = boards.places[near, 0]  # (b, k, 3)
        if len(path) == 1:
            axes = tangents(boards, path[0])
            points = path[0] + grid @ axes
            square = ((slots[None] - points[:, None, None]) ** 2).sum(axis=-1)
            chance = np.exp(log_weight)
        else:
            shifted = path[None] + (4e-3 * spread)[:, None, None] * sideways(boards, path)
            gap = ((slots[None, :, :, None] - shifted[:, None, None]) ** 2).sum(axis=-1)
            gap = np.where(np.isnan(gap), np.inf, gap)
            square = gap.min(axis=-1)
            arrivals[row, near] = gap[2].argmin(axis=-1) / (len(path) - 1)
            chance = weight
        felt = np.where(boards.columns[near] >= 0, answer[steps_at(square, SHAPES)], 0.0)
        answers[row, near] = np.einsum("o,sobk->bk", chance, felt) / len(SHAPES)
        none = (1.0 - felt).prod(axis=-1)  # errors of the place are shared by a module's slots
        silent[row, near] = np.einsum("o,sob->b", chance, none) / len(SHAPES)
    return np.where(boards.columns >= 0, answers, 0.0), MISSED + (1 - MISSED) * silent, arrivals


def _layout() -> FloatArray:
    """(STEPS + 1, d) points whose squared distances are -log of the overlaps of two answers.

    Torgerson's classical scaling; then the overlap of many answers is one matrix product.
    """
    chance = np.exp(TABLE.astype(np.float64))
    square = -np.log(np.minimum(np.sqrt(chance).T @ np.sqrt(chance), 1.0))
    centred = square - square.mean(axis=0) - square.mean(axis=1)[:, None] + square.mean()
    values, vectors = np.linalg.eigh(-0.5 * centred)
    top = np.argsort(-values)[:OVERLAP_DIMENSIONS]
    return np.asarray(vectors[:, top] * np.sqrt(np.maximum(values[top], 0.0)), np.float32)


POINTS = _layout()


def _telling(boards: Boards, places: FloatArray) -> FloatArray:
    """(c, 5, m) evidence that pokes at places (c, 3) bring where a site's board is laid otherwise.

    The elements are those of `boards.GROUP` but the first. In nats, at most `ENOUGH`, in the
    mean over where the finger really was.
    """
    found = np.zeros((len(places), 5, len(boards)))
    grid, log_weight = offsets()
    weight = np.tile(np.exp(log_weight), len(POKES)) / len(POKES)
    for row, place in enumerate(places):
        near = np.flatnonzero(np.linalg.norm(boards.centres - place, axis=1) < NEAR)
        if len(near) == 0:
            continue
        points = place + grid @ tangents(boards, place)
        gap = boards.places[near][None] - points[:, None, None, None]  # (o, b, 6, k, 3)
        square = (gap**2).sum(axis=-1)
        laid = POINTS[steps_at(square, POKES)]  # (s, o, b, 6, k, d)
        laid = laid * (boards.columns[near] >= 0)[:, None, :, None]
        q = len(weight)
        laid = laid.reshape(q, len(near), 6, -1).transpose(1, 2, 0, 3)  # (b, 6, q, k d)
        norm = (laid**2).sum(axis=-1)
        cross = laid @ laid[:, :1].transpose(0, 1, 3, 2)
        apart = norm[..., None] + norm[:, :1, None, :] - 2.0 * cross  # (b, 6, q, q)
        whole = apart[:, 0].sum(axis=0)
        rest = whole - apart[:, 0]
        own = -np.log(np.exp(-whole) @ weight)
        other = -np.log(np.exp(-(rest[:, None] + apart[:, 1:])) @ weight + 1e-30)  # (b, 5, q)
        found[row][:, near] = (np.clip(2.0 * (other - own), 0.0, ENOUGH) @ weight).T
    return found


class Chooser:
    """Ranks places by what their answers would tell.

    Parameters
    ----------
    boards : Boards
    hypotheses : Hypotheses
    wiring : Wiring
        As it is known.
    places : Candidates
    """

    def __init__(
        self, boards: Boards, hypotheses: Hypotheses, wiring: Wiring, places: Candidates
    ) -> None:
        self.boards, self.hypotheses, self.places = boards, hypotheses, places
        order = wiring.order
        self.site = site = np.where(wiring.site >= 0, wiring.site, 0)
        self.read = read = (wiring.site >= 0) & ~wiring.mute

        def seen(values: FloatArray) -> FloatArray:
            laid = np.empty_like(values)
            for place in range(len(site)):
                slots = order[place]
                if boards.turns is not None:
                    slots = boards.turns[wiring.element[place]][slots]
                laid[:, place] = values[:, place, slots]
            return np.asarray(laid[:, site] * read[None, :, None])

        self.answers = seen(places.answers)
        self.arrivals = seen(places.arrivals)
        self.silent = np.where(read, places.silent[:, site], 1.0).astype(np.float32)
        first = 1 + len(hypotheses.swaps)
        self._powered = np.r_[first : first + 6 * len(boards), hypotheses.chain_first :
                              len(hypotheses)]  # fmt: skip
        self.power = self._power(wiring)

    def gains(self, log_posterior: FloatArray, asked: list[FloatArray]) -> FloatArray:
        """(c,) what each place would tell [nats]; `asked` are the middles touched so far."""
        chance = np.exp(log_posterior)
        top = np.flatnonzero(chance[1:] > PROBABLE) + 1
        top = top[np.argsort(-chance[top], kind="stable")][:MANY]
        merely = np.where(chance > NEVER, chance, 0.0).astype(np.float32)
        merely[top] = 0.0
        swaps = self.hypotheses.swaps
        n = 1 + len(swaps)
        matrix = np.zeros((len(self.boards),) * 2, np.float32)
        matrix[swaps[:, 0], swaps[:, 1]] = merely[1:n]
        gain = np.asarray(self.power @ merely[self._powered], np.float64)
        # A swap shows where either of its modules answers.
        unseen = ((self.silent @ matrix) * self.silent).sum(axis=1)
        gain = gain + WORTH * (float(matrix.sum()) - unseen)
        if len(top):
            gain = gain + self._between_probable(top, chance)
        if asked:
            away = np.linalg.norm(self.places.middles[:, None] - np.array(asked)[None], axis=2)
            gain = gain / (1.0 + (away < AGAIN).sum(axis=1))
        return gain

    def _power(self, wiring: Wiring) -> FloatArray:
        """(c, ...) evidence for faults that the answer at each place would bring [nats].

        Of those in `_powered`: swaps have a shorter way, and two channels of a module are not
        looked for on purpose.
        """
        silent = self.silent
        blocks: list[np.ndarray] = [-np.log(silent) / WORTH]
        turns = self.boards.turns
        for element in range(1, 6):
            if len(self.places.laid):
                blocks.append(self._laid(wiring, element))
            elif turns is None:
                blocks.append((1.0 - silent) * self.boards.turnable)
            else:
                blocks.append((1.0 - silent) * (1.0 - self._overlap(turns[element])))
        log_silent = np.log(silent)
        for fault in self.hypotheses.faults[self.hypotheses.chain_first :]:
            moves = fault.moves(self.boards)
            moved = [module for module, to in moves.items() if to != module]
            some = log_silent[:, moved].sum(axis=1, keepdims=True)
            mute = fault.kind == "mute_chain"
            blocks.append(np.minimum(-some / WORTH, 1.0) if mute else 1.0 - np.exp(some))
        return np.asarray(WORTH * np.concatenate(blocks, axis=1), np.float32)

    def _laid(self, wiring: Wiring, element: int) -> FloatArray:
        """(c, m) evidence for a board laid otherwise beyond what is known of it."""
        laid = wiring.element[self.site]
        beside = np.array([conjugate(element, now) for now in laid.tolist()])
        found = self.places.laid[:, beside - 1, self.site]
        return np.asarray(found * self.read / ENOUGH)

    def _overlap(self, slots: IntArray) -> FloatArray:
        """(c, m) overlap of each module's answers with those of a board laid otherwise."""
        slots = np.broadcast_to(slots, self.answers.shape)
        here = self.answers, self.arrivals
        there = [np.take_along_axis(own, slots, axis=2) for own in here]
        return _overlap_of(*here, *there).prod(axis=2)

    def _between_probable(self, top: IntArray, chance: FloatArray) -> FloatArray:
        """(c,) bound on what an answer tells about the probable faults and a healthy skin."""
        faults = [self.hypotheses.faults[row] for row in (0, *top.tolist())]
        weight = np.array([chance[0], *chance[top]])
        involved = sorted({module for fault in faults for module in fault.modules})
        if not involved:
            return np.zeros(len(self.places))
        near = np.flatnonzero((self.silent[:, involved] < 0.9).any(axis=1))
        if len(near) == 0:
            return np.zeros(len(self.places))
        under = [self._under(fault, involved, near) for fault in faults]
        h = len(faults)
        overlap = np.ones((h, h, len(near)))
        for i in range(h):
            for j in range(i):
                part = _overlap_of(*under[i], *under[j])
                overlap[i, j] = overlap[j, i] = part.reshape(len(near), -1).prod(axis=1)
        total = weight.sum()
        share = weight / total
        mixed = np.einsum("j,ijc->ic", share, overlap)
        gain = np.zeros(len(self.places))
        gain[near] = -total * np.einsum("i,ic->c", share, np.log(mixed))
        return gain

    def _under(
        self, fault: Fault, involved: list[int], near: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Answers (c, i, k) of the involved modules' channels under a fault, and when."""
        moves = fault.moves(self.boards)
        whole, times = self.answers[near], self.arrivals[near]
        answers, late = whole[:, involved], times[:, involved]
        for place, module in enumerate(involved):
            to = moves.get(module, module)
            slots = np.arange(answers.shape[2])
            if module in fault.modules and fault.element and self.boards.turns is not None:
                slots = self.boards.turns[fault.element]
            elif module in fault.modules and fault.slots:
                slots[list(fault.slots)] = slots[list(fault.slots)[::-1]]
            if to < 0:
                answers[:, place] = 0.0
            else:
                answers[:, place] = whole[:, to][:, slots]
                late[:, place] = times[:, to][:, slots]
        return np.clip(answers, 0.0, 1.0), late


def _overlap_of(p: FloatArray, when: FloatArray, q: FloatArray, then: FloatArray) -> FloatArray:
    """Bhattacharyya's overlap of answers of chances p and q that come at two times."""
    both = np.sqrt(p * q) * np.exp(-((when - then) ** 2) / (8.0 * TIMING**2))
    return np.asarray(both + np.sqrt((1.0 - p) * (1.0 - q)))
