"""Fisher information of runs that are not made yet, and the standard errors that it promises (Cramer-Rao bound)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from pumaid.design.candidate_runs import Block
from pumaid.effects import Samples, catalogue
from pumaid.maths import Counts, Floats
from pumaid.model import Structure
from pumaid.robot import Robot
from pumaid.simulation.virtual_robot import Noise, Truth
from pumaid.trajectory import Motion, Plan, cruise, duration

#: Samples a second that a forecast assumes.
RATE = 100.0
#: Points at which a run's regressors are averaged over its span.
_POINTS = 48
#: Scaled information below this is rounding.
_BLIND = 1e-11
_FRICTION = (("coulomb", "plus"), ("viscous", "plus"), ("coulomb", "minus"), ("viscous", "minus"))


def gravity_names(robot: Robot) -> tuple[str, ...]:
    """Names of all gravity parameters and gain ratios of neighbours, also of those that the arm cannot show."""
    parts = {joint.number: catalogue()["gravity"].parameters(robot, joint.number) for joint in robot.joints}
    names = [f"gravity.l{number}.{part.name}" for number, listed in parts.items() for part in listed]
    return (*names, *(f"gain_ratio.{i}.{i + 1}" for i in range(1, robot.n_joints)))


def absent_names(structure: Structure) -> dict[str, str]:
    """Name -> why no run on this arm can show it."""
    ratios = {f"gain_ratio.{i}.{j}": why for (i, j), why in structure.redundant.items()}
    return {**structure.absent, **ratios}


def existing_names(robot: Robot, structure: Structure) -> tuple[str, ...]:
    """Gravity parameters and gain ratios that the arm has."""
    return tuple(name for name in gravity_names(robot) if name not in absent_names(structure))


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


def run_moments(ends: Floats, seconds: Floats, noise: Noise, *, joint: int) -> Floats:
    """(M, 3, 3) information (1/A2) of M runs on their cos q, sin q and constant parts.

    Their speed is constant between two positions `ends` (M, 2), rad or m, for so many seconds (M,). Samples are
    correlated (AR(1)), and all samples of a run share a random level.
    """
    q = np.linspace(ends[:, 0], ends[:, 1], _POINTS, axis=1)
    parts = np.stack([np.cos(q), np.sin(q), np.ones_like(q)], axis=2)
    phi = noise.correlation(RATE)
    slow = noise.sample_std[joint - 1] ** 2 * (1 + phi) / (1 - phi)
    level = noise.level_std[joint - 1] ** 2
    samples = np.maximum(seconds * RATE, 1.0)[:, None, None]
    gram, mean = parts.transpose(0, 2, 1) @ parts / _POINTS, parts.mean(axis=1)
    shared = samples * level / (slow + samples * level)
    return np.asarray(samples * (gram - shared * mean[:, :, None] * mean[:, None, :]) / slow)


def run_information(truths: Sequence[Truth], motions: Sequence[Motion], names: Sequence[str]) -> sparse.csr_array:
    """(M, G p p) information of M runs, for G prior robots, on `names` and all friction (`parameter_names`)."""
    robot, count = truths[0].robot, len(truths)
    width = len(names) + 4 * robot.n_joints
    parts, order = [sparse.csr_array((0, count * width**2))], list[int]()
    for joint in sorted({motion.joint for motion in motions}):
        rows = [k for k, motion in enumerate(motions) if motion.joint == joint]
        holds, posture = np.unique([motions[k].hold for k in rows], axis=0, return_inverse=True)
        ways = {(m.start, m.end, m.velocity): cruise(robot, m) for m in (motions[k] for k in rows)}
        way = {key: number for number, key in enumerate(ways)}
        number = np.array([way[motions[k].start, motions[k].end, motions[k].velocity] for k in rows])
        ends, seconds = (np.array(part) for part in zip(*ways.values(), strict=True))
        moments = np.stack([run_moments(ends, seconds, truth.noise, joint=joint) for truth in truths])
        slopes = gravity_slopes(truths, joint=joint, holds=holds, names=names)[:, posture]
        signed = np.array([np.sign(motions[k].end - motions[k].start) * motions[k].velocity for k in rows])
        sides = np.column_stack([signed > 0, np.maximum(signed, 0.0), signed < 0, np.minimum(signed, 0.0)])
        friction = np.zeros((count, len(rows), 3, 4))
        friction[..., 2, :] = sides
        design = np.concatenate([slopes, friction], axis=-1)
        squares = np.swapaxes(design, -1, -2) @ moments[:, number] @ design
        columns = np.append(np.arange(len(names)), len(names) + 4 * (joint - 1) + np.arange(4))
        places = (width**2 * np.arange(count)[:, None, None] + width * columns[:, None] + columns).ravel()
        index = np.tile(places, len(rows)), len(places) * np.arange(len(rows) + 1)
        shape = (len(rows), count * width**2)
        parts.append(sparse.csr_array((np.swapaxes(squares, 0, 1).ravel(), *index), shape=shape))
        parts[-1].eliminate_zeros()  # a joint's runs tell nothing of inner links
        order += rows
    return sparse.csr_array(sparse.vstack(parts, format="csr")[np.argsort(order)])


@dataclass(frozen=True, eq=False)
class CandidateInformation:
    """L candidates, and what they tell G prior robots of p parameters."""

    blocks: tuple[Block, ...]  # (L,) a sweep in a posture each
    posture: Counts  # (L,) number of the joint's posture, from 0
    seconds: Floats  # (L,) s, rests included
    squares: sparse.csr_array  # (L, G p p) information
    names: tuple[str, ...]  # (p,) gravity parameters and ratios, then friction

    def __len__(self) -> int:
        return len(self.blocks)

    def information(self, counts: Floats | Counts) -> Floats:
        """(G, p, p) of all candidates, each made `counts` (L,) times."""
        return np.asarray(counts @ self.squares).reshape(-1, len(self.names), len(self.names))

    def each(self, candidates: Counts) -> Floats:
        """(N, G, p, p) information of N candidates."""
        return self.squares[candidates].toarray().reshape(len(candidates), -1, len(self.names), len(self.names))

    def products(self, slope: Floats) -> Floats:
        """(L,) trace of slope times information of each candidate, summed over the robots (G, p, p)."""
        return np.asarray(self.squares @ slope.ravel())

    def only(self, candidates: Counts) -> "CandidateInformation":
        """These candidates."""
        blocks = tuple(self.blocks[k] for k in candidates.tolist())
        posture, seconds = self.posture[candidates], self.seconds[candidates]
        return replace(self, blocks=blocks, posture=posture, seconds=seconds, squares=self.squares[candidates])


def candidate_information(
    truths: Sequence[Truth], blocks: Sequence[Block], *, names: Sequence[str]
) -> "CandidateInformation":
    """What candidates tell G prior robots of the gravity parameters and ratios `names`, and of all friction."""
    robot = truths[0].robot
    standing = (0.0,) * robot.n_joints
    ways = {block.sweeps for block in blocks}
    lasting = {part: duration(robot, Plan(robot.name, Block(standing, part).motions)) for part in ways}
    runs = [block.motions for block in blocks]
    owner = np.repeat(np.arange(len(blocks)), [len(part) for part in runs])
    squares = run_information(truths, [motion for part in runs for motion in part], names)
    summed = sparse.csr_array((np.ones(len(owner)), (owner, np.arange(len(owner)))), shape=(len(blocks), len(owner)))
    numbers = {place: k for k, place in enumerate(dict.fromkeys((block.joint, block.hold) for block in blocks))}
    return CandidateInformation(
        tuple(blocks),
        np.array([numbers[block.joint, block.hold] for block in blocks]),
        np.array([lasting[block.sweeps] for block in blocks]),
        sparse.csr_array(summed @ squares),
        parameter_names(robot, names),
    )


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
    """Name -> predicted standard error: the median over prior robots; parameters that any of them hides are out.

    Runs that are kept for judging promise nothing.
    """
    whole = parameter_names(truths[0].robot, names)
    fitted = run_information(truths, [motion for motion in motions if motion.purpose == "fit"], names)
    information = np.asarray(fitted.sum(axis=0)).reshape(len(truths), len(whole), len(whole))
    tables = [standard_errors(whole, part) for part in information]
    shared = [name for name in tables[0] if all(name in table for table in tables)]
    return {name: float(np.median([table[name] for table in tables])) for name in shared}
