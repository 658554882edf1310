"""What the best possible test can see: the whitened score test with the true noise, after the paper's base model.

Runs are the rows in which the commanded speed is constant and the loop has settled; of strokes and any motion, those
in which a joint moves. The noise of run r of joint j is

    sigma_jr^2 AR(memory_j)  +  (step^2 / 12) white  +  level_jr^2 (one constant for the whole run),

and is whitened exactly but for the first sample's transient. The base model is linearised at the truth: gravity's
independent link parameters (shared by all joints, each joint in its own gain), the gain of every joint, and Coulomb and
viscous friction of both directions of every joint; of any motion all link parameters, and inertia of every joint where
it accelerates. A signature f (A) with d free amplitudes has the noncentrality

    lambda = |W f|^2 - |projection of W f on W (base columns)|^2,

and is at its detection limit where a test of d degrees of freedom at the level 0.05 / TESTS rejects with 80 % power.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.signal import lfilter
from scipy.stats import chi2, ncx2

from blind_world.motion import FREE, sparseness
from blind_world.world import World, loudness

Floats = NDArray[np.float64]

#: Independent looks that a search over catalogue, joints and shapes amounts to: a two-sided z of 4.0.
TESTS = 800
LEVEL, POWER = 0.05, 0.8
#: Share of the highest speed below which a joint that accelerates counts as resting.
SLOW = 0.03
#: Eigenvalues of the scaled normal equations below this share of the largest are directions that nothing determines.
RANK = 1e-10


def threshold(freedoms: int) -> float:
    """Noncentrality at which a chi-square test of `freedoms` at LEVEL / TESTS has the power POWER."""
    critical = chi2.isf(LEVEL / TESTS, freedoms)
    return float(brentq(lambda size: ncx2.sf(critical, freedoms, size) - POWER, 1.0, 200.0))


class Oracle:
    """The base model's whitened normal equations for one world; `joints`: rows of each joint's fitted runs."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.loud = loudness(world)
        run, held = world.motion.run, world.heldout
        self.fitted = (run >= 0) & ~held[run]
        self.joints = [self.moving(j)[self.fitted[self.moving(j)]] for j in range(world.arm.n)]
        self.white = [self.whitened(j, rows, self.base(j, rows)) for j, rows in enumerate(self.joints)]
        self.root = inverse_root(np.sum([block.T @ block for block in self.white], axis=0))

    def moving(self, joint: int) -> NDArray[np.int64]:
        """Rows of runs of `joint`, held-out ones too; where it accelerates, without those in which it nearly rests."""
        world, rows = self.world, self.world.rows(joint)
        slow = -1.0 if world.campaign.is_steady else SLOW * world.arm.speed[joint]
        return rows[(world.motion.run[rows] >= 0) & (np.abs(world.motion.velocity[rows, joint]) > slow)]

    def base(self, joint: int, rows: NDArray[np.int64]) -> Floats:
        """(M, p) columns of the base model, A per unit, at rows in which `joint` moves."""
        motion, arm, campaign = self.world.motion, self.world.arm, self.world.campaign
        p, n = motion.regressor.shape[-1], arm.n
        out = np.zeros((len(rows), p + 6 * n))
        if campaign.design == FREE:
            at = np.arange(len(motion.regressor)) * sparseness(campaign.rate)
            out[:, :p] = np.column_stack([np.interp(rows, at, column) for column in motion.regressor[:, joint].T])
            out[:, p + joint] = motion.torque[rows, joint]
        else:
            out[:, :p], out[:, p + joint] = motion.regressor[rows], motion.load[rows]
        out *= arm.gain[joint]
        v = motion.velocity[rows, joint]
        first = p + n + 4 * joint
        out[:, first : first + 4] = np.column_stack([v > 0, v <= 0, np.maximum(v, 0), np.minimum(v, 0)])
        if not campaign.is_steady:
            out[:, p + 5 * n + joint] = motion.acceleration[rows, joint]
        return out

    def whitened(self, joint: int, rows: NDArray[np.int64], values: Floats) -> Floats:
        """(M, ...) `values` at rows of runs of `joint`, with the noise's covariance made the identity."""
        noise, run = self.world.noise, self.world.motion.run[rows]
        out = np.empty_like(values, dtype=float)
        keep = noise.memory[joint]
        starts = np.flatnonzero(np.append(True, np.diff(run) != 0))
        for begin, end in zip(starts, np.append(starts[1:], len(rows)), strict=True):
            loud = self.loud[run[begin]]
            sigma = noise.sigma[joint] * loud
            grain = (noise.step / sigma) ** 2 / 12.0
            level = noise.level[joint] * loud / sigma
            block = np.column_stack([np.ones(end - begin), values[begin:end].reshape(end - begin, -1) / sigma])
            block = _arma(block, keep, grain)
            one = block[:, 0]
            size = float(one @ one)
            share = (1.0 - 1.0 / np.sqrt(1.0 + level**2 * size)) / size
            block = block[:, 1:] - share * one[:, None] * (one @ block[:, 1:])
            out[begin:end] = block.reshape(out[begin:end].shape)
        return out

    def noncentrality(self, signature: Mapping[int, Floats]) -> float:
        """Of a signature: by joint (from 0), A at the rows `joints`; joints left out feel nothing."""
        size, along = 0.0, np.zeros(len(self.root))
        for joint, values in signature.items():
            white = self.whitened(joint, self.joints[joint], values)
            size += float(white @ white)
            along += self.white[joint].T @ white
        return max(size - float(np.square(self.root.T @ along).sum()), 0.0)

    def multiples(self, signatures: Sequence[Mapping[int, Floats]], freedoms: Sequence[int]) -> Floats:
        """Sizes of several effects, as multiples of each one's limit when all others are in the model."""
        k = len(signatures)
        gram, across = np.zeros((k, k)), np.zeros((len(self.root), k))
        for joint, rows in enumerate(self.joints):
            still = np.zeros(len(rows))
            columns = [signature.get(joint, still) for signature in signatures]
            white = self.whitened(joint, rows, np.array(columns).reshape(k, len(rows)).T)
            gram, across = gram + white.T @ white, across + self.white[joint].T @ white
        clear = gram - across.T @ self.root @ (self.root.T @ across) + 1e-6 * np.eye(k)
        alone = 1.0 / np.diag(np.linalg.inv(clear))
        return np.sqrt(np.maximum(alone, 0.0) / [threshold(count) for count in freedoms])

    def felt(self, current: Floats) -> dict[int, Floats]:
        """Currents (N, J) at the rows of each joint's fitted runs."""
        return {joint: current[rows, joint] for joint, rows in enumerate(self.joints)}

    def fit(self, measured: Floats, effects: list[Floats], start: Floats, about: float = 1.0) -> tuple[Floats, Floats]:
        """Weighted fit of the base model and of known signatures to `measured`.

        All are (N, J) A; `start` are the currents of the true base model, about which it is linearised. Returns changes
        of the base parameters, and an amplitude of each signature (1 where it is as it was hidden); what no run tells
        of these stays where `start` is, and at `about`, to which an amplitude is known within 1.
        """
        p = len(self.root)
        gram, right = np.zeros((p + len(effects),) * 2), np.zeros(p + len(effects))
        for joint, rows in enumerate(self.joints):
            known = np.column_stack([(measured - start)[rows, joint], *(one[rows, joint] for one in effects)])
            white = self.whitened(joint, rows, known)
            block = np.column_stack([self.white[joint], white[:, 1:]])
            gram += block.T @ block
            right += block.T @ white[:, 0]
        gram[range(p, len(gram)), range(p, len(gram))] += 1.0
        right[p:] += about
        root = inverse_root(gram)
        found = root @ (root.T @ right)
        return found[:p], found[p:]


def inverse_root(gram: Floats) -> Floats:
    """(p, r) root, with root @ root.T the generalised inverse of normal equations (p, p)."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram), 1e-30))
    values, vectors = np.linalg.eigh(gram * scale * scale[:, None])
    good = values > RANK * values[-1]
    return np.asarray(scale[:, None] * vectors[:, good] / np.sqrt(values[good]))


def _arma(block: Floats, keep: float, grain: float) -> Floats:
    """Innovations of AR(1) noise of unit variance plus white noise of variance `grain`, scaled to unit variance."""
    total = (1.0 - keep**2) + grain * (1.0 + keep**2)
    ratio = total / (2.0 * grain * keep) if grain * keep > 1e-12 * total else np.inf
    lag = 0.0 if np.isinf(ratio) else ratio - np.sqrt(ratio**2 - 1.0)
    spread = np.sqrt(total / (1.0 + lag**2))
    out = lfilter([1.0, -keep], [1.0, -lag], block, axis=0) / spread
    out[0] = block[0] / np.sqrt(1.0 + grain)
    return np.asarray(out)
