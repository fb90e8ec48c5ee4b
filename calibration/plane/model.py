"""How likely a flat surface is felt: taxels that felt it lie below it, silent ones above.

With the signed distance s of a taxel from the surface and the press depth c of the contact, the
taxel is active with the probability of a logistic curve of (c - s) / tau, mixed with a few
readings that mean nothing. Unknown are mounts, planes, zero positions of joints and tau; by
contact its depth; by module a shift; by taxel a height at which it answers. The last three are
random, with spreads that are found from the data.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import expit

from calibration.mount.chains import Chain
from skinmap.arrays import BoolArray, FloatArray, IntArray, check_finite, check_whole, freeze
from skinmap.errors import InvalidArrayError
from skinmap.geometry.rigid import tangent_frames


@dataclass(frozen=True, eq=False, slots=True)
class PlaneContacts:
    """Presses on one or more flat surfaces that do not move.

    Attributes
    ----------
    angles : (m, j) float
        Joint angles of the robot at each press [rad, m].
    active : mapping of str to (m, n) bool
        Of each patch, which taxels felt each press.
    surface : (m,) int
        Which surface was pressed, from 0; one by default.
    """

    angles: FloatArray
    active: Mapping[str, BoolArray]
    surface: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))

    def __post_init__(self) -> None:
        angles = check_finite(self.angles, "angles", (None, None))
        m = len(angles)
        active = {}
        for name, given in self.active.items():
            felt = np.asarray(given)
            if felt.dtype != np.bool_ or felt.ndim != 2 or len(felt) != m:
                raise InvalidArrayError(
                    f"active taxels of {name!r} must be true or false of shape ({m}, n), "
                    f"got {felt.dtype} {felt.shape}"
                )
            active[name] = np.array(felt)
            active[name].flags.writeable = False
        surface = check_whole(self.surface, "surface")
        if len(surface) == 0 < m:
            surface = np.zeros(m, np.int64)
        if surface.shape != (m,) or surface.min(initial=0) < 0:
            raise InvalidArrayError(f"surface must be {m} whole numbers from 0")
        freeze(self, angles=angles, surface=surface)
        object.__setattr__(self, "active", active)

    def __len__(self) -> int:
        return len(self.angles)

    def subset(self, rows: BoolArray | IntArray) -> PlaneContacts:
        """Some of the presses."""
        active = {name: felt[rows] for name, felt in self.active.items()}
        return PlaneContacts(self.angles[rows], active, self.surface[rows])

    def joined(self, more: PlaneContacts) -> PlaneContacts:
        """These presses and more of the same patches."""
        return PlaneContacts(
            np.concatenate([self.angles, more.angles]),
            {name: np.concatenate([felt, more.active[name]]) for name, felt in self.active.items()},
            np.concatenate([self.surface, more.surface]),
        )


@dataclass(frozen=True, eq=False, slots=True)
class Plane:
    """A flat surface in the frame of the robot's base.

    Attributes
    ----------
    point : (3,) float
        Any point of it [m].
    normal : (3,) float
        Unit, towards the side that the robot is on.
    """

    point: FloatArray
    normal: FloatArray

    def __post_init__(self) -> None:
        point = check_finite(self.point, "point of the plane", (3,))
        normal = check_finite(self.normal, "normal of the plane", (3,))
        length = float(np.linalg.norm(normal))
        if length < 1e-9:
            raise InvalidArrayError("the normal of the plane has no length")
        freeze(self, point=point, normal=normal / length)

    def height(self, points: FloatArray) -> FloatArray:
        """Signed distances (...,) of points (..., 3) above the surface [m]."""
        return np.asarray((points - self.point) @ self.normal)


SENSELESS = 0.01  # share of readings that say nothing: each weighs no more than four in doubt
MOUNT_TURN, MOUNT_SHIFT = 1.0, 0.2  # priors of mount and plane that bound, and decide nothing
KNOWN_DEPTH = 2e-3  # prior of the press depth that is common to all contacts of a known plane [m]
TAU, TAU_FOLD = 1e-3, 1.0  # where the width of the logistic curve is sought [m, log]
TAIL = 4.0  # degrees of freedom of the press depths: one wrong contact cannot pull the rest


@dataclass(frozen=True, slots=True)
class Spreads:
    """Standard deviations of what is random [m]."""

    depth: float = 1e-3  # of a contact's press depth round the common one
    shift: float = 0.3e-3  # of a module, along each axis
    height: float = 0.3e-3  # at which a taxel answers
    fitted: float = 0.0  # how many unknowns the evidence has settled


@dataclass(eq=False, slots=True)
class PlaneState:
    """Unknowns: mounts by patch, planes, joint offsets, tau [m], depths, shifts, heights."""

    mounts: dict[str, FloatArray]
    normals: FloatArray  # (p, 3)
    points: FloatArray  # (p, 3)
    offsets: FloatArray  # (joints of the robot,)
    tau: float
    depths: FloatArray  # (m,)
    shifts: dict[str, FloatArray]  # (g, 3) by patch
    heights: dict[str, FloatArray]  # (n,) by patch

    def copy(self) -> PlaneState:
        """Another state with the same values."""
        return PlaneState(
            dict(self.mounts), self.normals.copy(), self.points.copy(), self.offsets.copy(),
            self.tau, self.depths.copy(), dict(self.shifts), dict(self.heights),
        )  # fmt: skip

    def plane(self, number: int = 0) -> Plane:
        """One of the surfaces."""
        return Plane(self.points[number], self.normals[number])


@dataclass(frozen=True, eq=False, slots=True)
class Patch:
    """A patch of the problem: its chain, and the module of each taxel as 0..g-1."""

    chain: Chain
    module: IntArray
    usable: BoolArray  # (n,): dead and stuck taxels say nothing

    @property
    def member(self) -> FloatArray:
        """(n, g) of ones where a taxel belongs to a module."""
        return np.asarray(np.eye(int(self.module.max()) + 1)[self.module])


@dataclass(frozen=True, eq=False, slots=True)
class Layout:
    """Columns of the unknowns."""

    mount: dict[str, int]
    plane: int
    tilting: bool
    joint: dict[int, int]
    tau: int
    main: int  # how many come before the random ones
    depth: IntArray  # (m,)
    shift: dict[str, IntArray]  # (g, 3) by patch
    height: dict[str, IntArray]  # (n,) by patch
    count: int


@dataclass(frozen=True, eq=False, slots=True)
class System:
    """Normal equations at one state."""

    normal: FloatArray  # (count, count), of the evidence alone
    slope: FloatArray  # (count,), of the evidence alone


@dataclass(frozen=True, eq=False, slots=True)
class PlaneProblem:
    """Contacts, patches and priors."""

    contacts: PlaneContacts
    patches: Mapping[str, Patch]
    joint_sigma: float
    tilting: bool = True  # False: planes are known but for the common press depth
    surfaces: int = 1

    def layout(self) -> Layout:
        """Where each unknown stands."""
        mount = {name: 6 * k for k, name in enumerate(self.patches)}
        plane = 6 * len(mount)
        used = sorted({int(k) for one in self.patches.values() for k in one.chain.joints})
        first = plane + (3 if self.tilting else 1) * self.surfaces
        joint = {number: first + k for k, number in enumerate(used)}
        tau = first + len(used)
        depth = tau + 1 + np.arange(len(self.contacts))
        column = tau + 1 + len(depth)
        shift, height = {}, {}
        for name, one in self.patches.items():
            shift[name] = column + np.arange(3 * (int(one.module.max()) + 1)).reshape(-1, 3)
            column += shift[name].size
        for name, one in self.patches.items():
            height[name] = column + np.arange(len(one.module))
            column += len(one.module)
        return Layout(mount, plane, self.tilting, joint, tau, tau + 1, depth, shift, height, column)

    def signed(self, name: str, state: PlaneState) -> FloatArray:
        """(m, n) distances of a patch's taxels above the surface [m]."""
        return self._seen(name, state)[0]

    def _seen(
        self, name: str, state: PlaneState
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """Distances (m, n), places (m, n, 3) in the base, T (m, 4, 4), axes and origins."""
        patch = self.patches[name]
        T, axes, origins = patch.chain.motion(self.contacts.angles, state.offsets)
        local = patch.chain.taxels + state.shifts[name][patch.module]
        M = state.mounts[name]
        own = local @ M[:3, :3].T + M[:3, 3]
        x = np.einsum("mij,nj->mni", T[:, :3, :3], own) + T[:, None, :3, 3]
        n, p = state.normals[self.contacts.surface], state.points[self.contacts.surface]
        s = np.einsum("mni,mi->mn", x - p[:, None], n) + state.heights[name]
        return np.asarray(s), np.asarray(x), T, axes, origins

    def chances(self, name: str, state: PlaneState) -> FloatArray:
        """(m, n) probability that a taxel is active."""
        z = (state.depths[:, None] - self.signed(name, state)) / state.tau
        return np.asarray(SENSELESS + (1 - 2 * SENSELESS) * expit(z))

    def evidence_cost(self, state: PlaneState) -> float:
        """-log likelihood of all readings."""
        return float(sum(self._losses(name, state).sum() for name in self.patches))

    def contact_losses(self, state: PlaneState) -> FloatArray:
        """(m,) -log likelihood of the readings of each contact."""
        return np.sum([self._losses(name, state).sum(axis=1) for name in self.patches], axis=0)

    def silent_losses(self, state: PlaneState) -> tuple[FloatArray, FloatArray]:
        """(m,) the losses of taxels that no contact felt, and (m,) how many taxels are pressed."""
        never, pressed = np.zeros((2, len(self.contacts)))
        for name, one in self.patches.items():
            never += self._losses(name, state) @ ~self.contacts.active[name].any(axis=0)
            pressed += self.chances(name, state) @ one.usable
        return never, pressed

    def _losses(self, name: str, state: PlaneState) -> FloatArray:
        chance, felt = self.chances(name, state), self.contacts.active[name]
        loss = -np.log(np.where(felt, chance, 1.0 - chance))
        return np.asarray(loss * self.patches[name].usable)

    def system(self, state: PlaneState, layout: Layout) -> System:
        """Scores and their expected information (Fisher's scoring)."""
        normal, slope = np.zeros((layout.count,) * 2), np.zeros(layout.count)
        for name in self.patches:
            self._add(name, state, layout, normal, slope)
        return System(np.triu(normal) + np.triu(normal, 1).T, slope)

    def rows(
        self, name: str, state: PlaneState, layout: Layout
    ) -> tuple[FloatArray, FloatArray, float, FloatArray]:
        """Places z (m, n) on the curve; slopes to main unknowns (m, n, main), c, a shift (m, 3).

        The slope to a taxel's own height is minus that to c.
        """
        patch, tau = self.patches[name], state.tau
        s, x, T, axes, origins = self._seen(name, state)
        z = (state.depths[:, None] - s) / tau
        slopes = np.zeros((*s.shape, layout.main))
        M = state.mounts[name]
        normal = state.normals[self.contacts.surface]
        inward = np.einsum("mji,mj->mi", T[:, :3, :3], normal)  # the surface's normal in the link
        arm = (patch.chain.taxels + state.shifts[name][patch.module]) @ M[:3, :3].T
        first = layout.mount[name]
        slopes[:, :, first : first + 3] = np.cross(arm[None], inward[:, None])
        slopes[:, :, first + 3 : first + 6] = inward[:, None]
        for k, number in enumerate(patch.chain.joints.tolist()):
            if patch.chain.sliding[k]:
                moved = np.einsum("mi,mi->m", axes[k], normal)[:, None]
            else:  # n . (axis x (x - origin)) = (n x axis) . (x - origin)
                off = x - origins[k][:, None]
                moved = np.einsum("mi,mni->mn", np.cross(normal, axes[k]), off)
            slopes[:, :, layout.joint[number]] += moved
        self._plane_slopes(slopes, x, state, layout)
        slopes /= -tau
        slopes[:, :, layout.tau] = -z  # to log tau
        return np.asarray(z), slopes, 1.0 / tau, np.asarray(-(inward @ M[:3, :3]) / tau)

    def _plane_slopes(
        self, slopes: FloatArray, x: FloatArray, state: PlaneState, layout: Layout
    ) -> None:
        """Of the distances to the height of each plane and its two tilts, in place."""
        width = 3 if layout.tilting else 1
        for number, normal in enumerate(state.normals):
            rows = np.flatnonzero(self.contacts.surface == number)
            column = layout.plane + width * number
            slopes[rows, :, column] = -1.0
            if layout.tilting:
                off = x[rows] - state.points[number]
                for k, tangent in enumerate(tangent_frames(normal), start=1):
                    slopes[rows, :, column + k] = off @ tangent

    def _add(
        self, name: str, state: PlaneState, layout: Layout, normal: FloatArray, slope: FloatArray
    ) -> None:
        """Add one patch's evidence to the upper triangle of `normal` and to `slope`."""
        patch = self.patches[name]
        z, slopes, k, shifts = self.rows(name, state, layout)
        weighed = weigh(z, self.contacts.active[name])
        w, g, _ = (one * patch.usable for one in weighed)
        main, depths = layout.main, layout.depth
        own, heights = layout.shift[name], layout.height[name]
        weighted = w[:, :, None] * slopes
        flat = slopes.reshape(-1, main)
        normal[:main, :main] += flat.T @ weighted.reshape(-1, main)
        slope[:main] += flat.T @ g.ravel()
        normal[:main, depths] += k * weighted.sum(axis=1).T
        normal[depths, depths] += k * k * w.sum(axis=1)
        slope[depths] += k * g.sum(axis=1)
        # The modules' shifts, alone and with main unknowns and depths.
        member = patch.member
        by_module = weighted.transpose(0, 2, 1) @ member  # (m, main, g)
        normal[:main, own] += np.einsum("mpg,mk->pgk", by_module, shifts)
        w_module = w @ member  # (m, g)
        normal[depths[:, None, None], own] += k * w_module[:, :, None] * shifts[:, None]
        square = np.einsum("mg,mi,mj->gij", w_module, shifts, shifts)
        normal[own[:, :, None], own[:, None]] += square
        slope[own] += np.einsum("mg,mk->gk", g @ member, shifts)
        # The taxels' heights, alone and with all other unknowns.
        normal[:main, heights] -= k * weighted.sum(axis=0).T
        normal[depths[:, None], heights] -= k * k * w
        normal[own[patch.module], heights[:, None]] -= k * np.einsum("mn,mk->nk", w, shifts)
        normal[heights, heights] += k * k * w.sum(axis=0)
        slope[heights] -= k * g.sum(axis=0)

    def contact_scores(self, state: PlaneState, layout: Layout) -> FloatArray:
        """(m, count) slopes of the log likelihood of each contact's readings."""
        m = len(self.contacts)
        scores = np.zeros((m, layout.count))
        for name, patch in self.patches.items():
            z, J, k, u = self.rows(name, state, layout)
            g = weigh(z, self.contacts.active[name])[1] * patch.usable
            scores[:, : layout.main] += np.einsum("mn,mnp->mp", g, J)
            scores[np.arange(m), layout.depth] += k * g.sum(axis=1)
            scores[:, layout.shift[name]] += (g @ patch.member)[:, :, None] * u[:, None]
            scores[:, layout.height[name]] -= k * g
        return scores

    def prior(self, state: PlaneState, layout: Layout, spreads: Spreads) -> FloatArray:
        """(count,) precisions of the priors."""
        precision = np.zeros(layout.count)
        for column in layout.mount.values():
            precision[column : column + 3] = MOUNT_TURN**-2
            precision[column + 3 : column + 6] = MOUNT_SHIFT**-2
        planes = len(state.normals)
        if layout.tilting:
            each = [MOUNT_SHIFT**-2, MOUNT_TURN**-2, MOUNT_TURN**-2]
            precision[layout.plane : layout.plane + 3 * planes] = each * planes
        else:
            precision[layout.plane : layout.plane + planes] = KNOWN_DEPTH**-2
        for column in layout.joint.values():
            precision[column] = self.joint_sigma**-2
        precision[layout.tau] = TAU_FOLD**-2
        depth = state.depths / spreads.depth
        precision[layout.depth] = (TAIL + 1.0) / (TAIL + depth**2) * spreads.depth**-2
        for name in self.patches:
            precision[layout.shift[name]] = spreads.shift**-2
            precision[layout.height[name]] = spreads.height**-2
        return precision

    def values(self, state: PlaneState, layout: Layout, start: PlaneState) -> FloatArray:
        """(count,) how far each unknown that has a prior is from its middle."""
        x = np.zeros(layout.count)
        for name, column in layout.mount.items():
            turn = state.mounts[name][:3, :3] @ start.mounts[name][:3, :3].T
            x[column : column + 3] = Rotation.from_matrix(turn).as_rotvec()
            x[column + 3 : column + 6] = state.mounts[name][:3, 3] - start.mounts[name][:3, 3]
        if not layout.tilting:
            x[layout.plane : layout.plane + len(state.normals)] = np.einsum(
                "pi,pi->p", state.points - start.points, start.normals
            )
        for number, column in layout.joint.items():
            x[column] = state.offsets[number]
        x[layout.tau] = np.log(state.tau / TAU)
        x[layout.depth] = state.depths
        for name in self.patches:
            x[layout.shift[name]] = state.shifts[name]
            x[layout.height[name]] = state.heights[name]
        return x

    def moved(self, state: PlaneState, layout: Layout, move: FloatArray) -> PlaneState:
        """The state after a step (count,)."""
        new = state.copy()
        for name, column in layout.mount.items():
            M = new.mounts[name].copy()
            M[:3, :3] = Rotation.from_rotvec(move[column : column + 3]).as_matrix() @ M[:3, :3]
            M[:3, 3] += move[column + 3 : column + 6]
            new.mounts[name] = M
            new.shifts[name] = new.shifts[name] + move[layout.shift[name]]
            new.heights[name] = new.heights[name] + move[layout.height[name]]
        width = 3 if layout.tilting else 1
        for number in range(len(new.normals)):
            column = layout.plane + width * number
            normal = state.normals[number]
            new.points[number] = new.points[number] + move[column] * normal
            if layout.tilting:
                u, v = tangent_frames(normal)
                turned = normal + move[column + 1] * u + move[column + 2] * v
                new.normals[number] = turned / np.linalg.norm(turned)
        for number, column in layout.joint.items():
            new.offsets[number] += move[column]
        new.tau = state.tau * float(np.exp(np.clip(move[layout.tau], -1.0, 1.0)))
        new.depths = state.depths + move[layout.depth]
        return new


def weigh(z: FloatArray, felt: BoolArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Information, score and loss of readings whose place on the logistic curve is z."""
    sigmoid = expit(z)
    chance = SENSELESS + (1 - 2 * SENSELESS) * sigmoid
    rise = (1 - 2 * SENSELESS) * sigmoid * (1.0 - sigmoid)
    information = rise**2 / (chance * (1.0 - chance))
    score = rise * (felt - chance) / (chance * (1.0 - chance))
    loss = -np.log(np.where(felt, chance, 1.0 - chance))
    return np.asarray(information), np.asarray(score), np.asarray(loss)


def patch_of(chain: Chain, modules: Sequence[int] | IntArray | None = None) -> Patch:
    """A patch with all its taxels; one module where none are given."""
    n = len(chain.taxels)
    given = np.zeros(n, np.int64) if modules is None else np.asarray(modules)
    _, module = np.unique(given, return_inverse=True)
    return Patch(chain, module.ravel().astype(np.int64), np.ones(n, np.bool_))
