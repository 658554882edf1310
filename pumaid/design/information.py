"""Fisher information of runs that are not made yet, and the standard errors that it promises (Cramer-Rao bound)."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.design.candidate_runs import Block, JointCandidates, seconds_of
from pumaid.effects import catalogue
from pumaid.robot import Robot
from pumaid.samples import Samples
from pumaid.simulation.virtual_robot import Noise, Truth
from pumaid.structure import Structure
from pumaid.trajectory import Motion, cruise

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]

#: Samples a second that a forecast assumes.
RATE = 100.0
#: Points at which a run's regressors are averaged over its span.
_POINTS = 48
#: Scaled information below this is rounding.
_RIDGE, _BLIND = 1e-9, 1e-11
_FRICTION = (("coulomb", "plus"), ("viscous", "plus"), ("coulomb", "minus"), ("viscous", "minus"))


def gravity_names(robot: Robot) -> tuple[str, ...]:
    """Names of all gravity parameters and gain ratios of neighbours, also of those that the arm cannot show."""
    gravity, names = catalogue()["gravity"], list[str]()
    for joint in robot.joints:
        names += [f"gravity.l{joint.number}.{part.name}" for part in gravity.parameters(robot, joint.number)]
    return (*names, *(f"gain_ratio.{i}.{i + 1}" for i in range(1, robot.n_joints)))


def absent_names(structure: Structure) -> dict[str, str]:
    """Name -> why no run on this arm can show it."""
    ratios = {f"gain_ratio.{i}.{j}": why for (i, j), why in structure.redundant.items()}
    return {**structure.absent, **ratios}


def existing_names(robot: Robot, structure: Structure) -> tuple[str, ...]:
    """Gravity parameters and gain ratios that the arm has."""
    absent = absent_names(structure)
    return tuple(name for name in gravity_names(robot) if name not in absent)


def parameter_names(robot: Robot, names: Sequence[str]) -> tuple[str, ...]:
    """Gravity parameters and ratios `names`, then the friction of every joint."""
    friction = (f"{effect}.j{joint.number}.{side}" for joint in robot.joints for effect, side in _FRICTION)
    return (*names, *friction)


def gravity_slopes(truths: Sequence[Truth], *, joint: int, holds: Floats, names: Sequence[str]) -> Floats:
    """(G, K, 3, p) derivative of a joint's gravity current a cos q + b sin q + c by each of p parameters, A per unit.

    It is that of a, b, c for G prior robots of one geometry in the postures `holds` (K, J), rad or m; `names` are
    gravity parameters and ratios.
    """
    robot, count = truths[0].robot, len(holds)
    ends = np.concatenate([holds, holds])
    ends[:count, joint - 1], ends[count:, joint - 1] = 0.0, 0.5 * np.pi
    samples, gravity = Samples(joint, ends, np.zeros_like(ends)), catalogue()["gravity"]
    place = {name: k for k, name in enumerate(names)}
    # One column more, into which goes what is not among the names.
    out = np.zeros((len(truths), 2 * count, len(names) + 1))
    values = [truth.parameters() for truth in truths]
    ratios = np.array([[v[f"gain_ratio.{i}.{i + 1}"] for i in range(1, robot.n_joints)] for v in values])
    for link in range(joint, robot.n_joints + 1):
        labels = [f"gravity.l{link}.{part.name}" for part in gravity.parameters(robot, link)]
        scale = ratios[:, joint - 1 : link - 1].prod(axis=1)[:, None, None]
        columns = scale * gravity.columns(robot, samples, number=link)
        out[:, :, [place.get(label, -1) for label in labels]] = columns
        sizes = np.array([[v[label] for label in labels] for v in values])
        load = np.einsum("gmp,gp->gm", columns, sizes)
        for i in range(joint, link):
            out[:, :, place.get(f"gain_ratio.{i}.{i + 1}", -1)] += load / ratios[:, i - 1, None]
    out = out[..., :-1]
    cosine, sine = out[:, :count], out[:, count:]
    nothing = np.zeros_like(cosine)
    parts = [cosine, sine, nothing] if robot.joints[joint - 1].is_revolute else [nothing, nothing, cosine]
    return np.stack(parts, axis=2)


def run_moments(span: tuple[float, float], seconds: float, noise: Noise, *, joint: int) -> Floats:
    """(3, 3) information (1/A2) of a run on its cos q, sin q and constant parts.

    Its speed is constant between two positions `span` (rad or m), for so many seconds. Samples are correlated (AR(1)),
    and all samples of a run share a random level.
    """
    q = np.linspace(*span, _POINTS)
    parts = np.column_stack([np.cos(q), np.sin(q), np.ones(_POINTS)])
    phi = noise.correlation(RATE)
    slow = noise.sample_std[joint - 1] ** 2 * (1 + phi) / (1 - phi)
    level = noise.level_std[joint - 1] ** 2
    samples = max(seconds * RATE, 1.0)
    gram, total = samples * parts.T @ parts / _POINTS, samples * parts.mean(axis=0)
    return np.asarray((gram - np.outer(total, total) * level / (slow + samples * level)) / slow)


def run_information(motion: Motion, slopes: Floats, truths: Sequence[Truth]) -> Floats:
    """(G, K, p + 4, p + 4) information of a run in the K postures of `slopes` on p parameters and its friction."""
    robot, (*batch, p) = truths[0].robot, slopes.shape
    span, seconds = cruise(robot, motion)
    moments = np.stack([run_moments(span, seconds, truth.noise, joint=motion.joint) for truth in truths])
    design = np.zeros((*batch, p + 4))
    design[..., :p] = slopes
    back = motion.end < motion.start
    first = p + 2 * int(back)
    design[..., 2, first : first + 2] = 1.0, -motion.velocity if back else motion.velocity
    return np.asarray(np.swapaxes(design, -1, -2) @ moments[:, None] @ design)


def _columns(joint: int, count: int) -> Counts:
    """Places of the parameters of which a joint's runs tell: `count` gravity parameters and ratios, its friction."""
    return np.append(np.arange(count), count + 4 * (joint - 1) + np.arange(4))


@dataclass(frozen=True, eq=False)
class CandidateInformation:
    """L candidates, joint by joint: a sweep in a posture each, and what it tells."""

    joints: tuple[JointCandidates, ...]  # postures and sweeps of every joint
    joint: Counts  # (L,) from 1, rising
    hold: Counts  # (L,) which of its joint's postures
    sweep: Counts  # (L,) which of its joint's sweeps
    seconds: Floats  # (L,) s, rests included
    squares: Floats  # (G, L, q q) information of G robots on gravity, ratios and the joint's friction
    names: tuple[str, ...]  # (p,) gravity parameters and ratios, then friction

    def __len__(self) -> int:
        return len(self.joint)

    def _parts(self) -> Iterator[tuple[slice, Counts]]:
        """Candidates of each joint, and which of `names` they tell of."""
        bounds = np.searchsorted(self.joint, np.arange(1, len(self.joints) + 2))
        for joint, (first, end) in enumerate(itertools.pairwise(bounds), start=1):
            yield slice(first, end), _columns(joint, len(self.names) - 4 * len(self.joints))

    def information(self, counts: Floats) -> Floats:
        """(G, p, p) of all candidates, each made `counts` (L,) times."""
        out = np.zeros((len(self.squares), len(self.names), len(self.names)))
        for rows, columns in self._parts():
            used = rows.start + np.flatnonzero(counts[rows])
            total = counts[used] @ self.squares[:, used]
            out[:, columns[:, None], columns] += total.reshape(-1, len(columns), len(columns))
        return out

    def each(self, candidates: Sequence[int]) -> Floats:
        """(N, G, p, p) information of N candidates."""
        out = np.zeros((len(candidates), len(self.squares), len(self.names), len(self.names)))
        parts = list(self._parts())
        for k, candidate in enumerate(candidates):
            _, columns = parts[int(self.joint[candidate]) - 1]
            square = self.squares[:, candidate]
            out[k][:, columns[:, None], columns] = square.reshape(-1, len(columns), len(columns))
        return out

    def products(self, slope: Floats) -> Floats:
        """(L,) trace of slope times information of each candidate, summed over the robots (G, p, p)."""
        out = np.empty(len(self))
        for rows, columns in self._parts():
            part = slope[:, columns[:, None], columns].reshape(len(slope), -1, 1)
            out[rows] = (self.squares[:, rows] @ part).sum(axis=0)[:, 0]
        return out

    def only(self, candidates: Counts) -> CandidateInformation:
        """These candidates, rising."""
        index = {name: getattr(self, name)[candidates] for name in ("joint", "hold", "sweep", "seconds")}
        return replace(self, squares=self.squares[:, candidates], **index)

    def candidate(self, number: int) -> Block:
        """A candidate by its number (from 0)."""
        return self.joints[int(self.joint[number]) - 1].candidate(int(self.hold[number]), int(self.sweep[number]))

    def find(self, joint: int, hold: int, sweep: int) -> int | None:
        """The candidate of a joint (from 1), posture and sweep; None where it is not usable."""
        at = np.flatnonzero((self.joint == joint) & (self.hold == hold) & (self.sweep == sweep))
        return int(at[0]) if len(at) else None


def candidate_information(
    truths: Sequence[Truth], joints: Sequence[JointCandidates], *, names: Sequence[str]
) -> CandidateInformation:
    """The information of all usable candidates for G prior robots on the gravity parameters and ratios `names`."""
    robot, index, seconds, squares = truths[0].robot, [], [], []
    for part in joints:
        where = np.argwhere(part.usable)
        index.append(np.column_stack([np.full(len(where), part.joint), where]))
        lasting = np.array([seconds_of(robot, sweep) for sweep in part.sweeps])
        seconds.append(lasting[where[:, 1]])
        slopes = gravity_slopes(truths, joint=part.joint, holds=part.holds, names=names)
        width = slopes.shape[-1] + 4
        table = np.zeros((len(truths), len(part.holds), len(part.sweeps), width, width))
        for k in range(len(part.sweeps)):
            for motion in part.candidate(0, k).motions:
                table[:, :, k] += run_information(motion, slopes, truths)
        squares.append(table[:, where[:, 0], where[:, 1]].reshape(len(truths), len(where), width**2))
    joint, hold, sweep = np.concatenate(index).T
    parameters = parameter_names(robot, names)
    return CandidateInformation(
        tuple(joints), joint, hold, sweep, np.concatenate(seconds), np.concatenate(squares, axis=1), parameters
    )


def plan_information(truths: Sequence[Truth], motions: Iterable[Motion], *, names: Sequence[str]) -> Floats:
    """(G, p, p) information, for G prior robots, of the runs that are to be fitted; of `names` and all friction."""
    robot, fitted = truths[0].robot, [motion for motion in motions if motion.purpose == "fit"]
    out = np.zeros((len(truths), *[len(parameter_names(robot, names))] * 2))
    for joint in sorted({motion.joint for motion in fitted}):
        runs = [motion for motion in fitted if motion.joint == joint]
        holds, which = np.unique([motion.hold for motion in runs], axis=0, return_inverse=True)
        slopes = gravity_slopes(truths, joint=joint, holds=holds, names=names)
        columns = _columns(joint, len(names))
        for motion, hold in zip(runs, which, strict=True):
            out[:, columns[:, None], columns] += run_information(motion, slopes[:, [hold]], truths)[:, 0]
    return out


def standard_errors(names: Sequence[str], information: Floats) -> dict[str, float]:
    """Name -> predicted standard error (SI) by the information (p, p), without parameters that it does not show."""
    size = np.sqrt(np.diag(information))
    seen_at = np.flatnonzero(size > 0)
    scaled = information[np.ix_(seen_at, seen_at)] / np.outer(size[seen_at], size[seen_at])
    values, vectors = np.linalg.eigh(scaled)
    blind = values < _BLIND * max(values.max(initial=0.0), 1.0)
    shows = ~np.any(np.abs(vectors[:, blind]) > 1e-4, axis=1)
    errors = np.sqrt(vectors[:, ~blind] ** 2 @ (1.0 / values[~blind])) / size[seen_at]
    labels = [names[k] for k in seen_at.tolist()]
    return {name: float(error) for name, error, is_shown in zip(labels, errors, shows, strict=True) if is_shown}


def predicted_errors(truths: Sequence[Truth], motions: Sequence[Motion], names: Sequence[str]) -> dict[str, float]:
    """Name -> predicted standard error: the median over prior robots; parameters that any of them hides are out."""
    whole = parameter_names(truths[0].robot, names)
    tables = [standard_errors(whole, part) for part in plan_information(truths, motions, names=names)]
    shared = [name for name in tables[0] if all(name in table for table in tables)]
    return {name: float(np.median([table[name] for table in tables])) for name in shared}
