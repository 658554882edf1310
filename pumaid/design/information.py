"""Optimal design: what is assumed of an arm before it is measured (random robots of its geometry or an earlier model,
and a payload), the Fisher information of runs that are not made yet, the standard errors that it promises (Cramer-Rao
bound), and which runs make these smallest: the continuous optimum, and the greedy exchange algorithm.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from pumaid.design.candidate_runs import Block
from pumaid.effects import Samples
from pumaid.errors import ModelError
from pumaid.estimate import NOT_IDENTIFIABLE, Estimate
from pumaid.maths import Bilinear, Counts, Flags, Floats, Gains
from pumaid.model import Model, gravity_links, minimal
from pumaid.robot import Payload, Robot
from pumaid.simulation import BREAKAWAY, Constants, Friction, Links, Noise, Truth, constants, draw
from pumaid.trajectory import Motion, Plan, cruise, duration
from pumaid.units import number

#: Random robots for which a plan is made where no model is given.
DRAWN = 4
#: A, usual noise of a sample; a fifth of its variance is shared by all samples of a run.
NOISE = 0.02
#: kg and m of a payload at most.
_HEAVIEST, _FARTHEST = 1e5, 100.0


def loaded(truth: Truth, payload: Payload) -> Truth:
    """A prior robot with the payload in its hand; where only constants in A are known, the last gain is a usual one."""
    mass, *at = truth.robot.carried(payload)
    n, bare, gain = truth.robot.n_joints, truth.constants, truth.gain
    if truth.given_constants is not None:
        usual = np.copysign(draw(truth.robot, 0).gain[-1], truth.friction.coulomb_plus[-1])
        gain = usual * np.append(np.cumprod(bare.ratio[::-1])[::-1], 1.0)
    last = Links(np.append(np.zeros(n - 1), mass), np.vstack([np.zeros((n - 1, 3)), at]))
    more = constants(truth.robot, last, gain)
    return truth.with_constants(Constants(bare.x + more.x, bare.y + more.y, bare.mass + more.mass, bare.ratio))


@dataclass(frozen=True, eq=False, slots=True)
class Prior:
    """Robots for which a plan is made, and the sentences that say where they come from."""

    robots: tuple[Truth, ...]
    sentences: tuple[str, ...]


def typical_sizes(tables: Sequence[Mapping[str, float]], kinds: Mapping[str, str]) -> dict[str, float]:
    """Name -> typical size of a parameter (SI), of those that have `kinds`: the median over tables of values, one a
    robot, at least a tenth of the largest of its kind.
    """
    median = {name: float(np.median([abs(table[name]) for table in tables])) for name in kinds}
    largest = {kind: max(size for name, size in median.items() if kinds[name] == kind) for kind in kinds.values()}
    return {name: max(size, 0.1 * largest[kinds[name]]) or 1.0 for name, size in median.items()}


def prior_robots(
    robot: Robot, *, estimate: Estimate | None = None, payload: Payload | None = None, seed: int = 0
) -> Prior:
    """Robots to plan for, with a payload: that of an earlier model, else several of the arm's geometry.

    Raises ModelError (plan-impossible) where the payload is out of range.
    """
    if estimate is not None:
        prior = robot_of_estimate(robot, estimate)
    else:
        noise, seeds = Noise(np.full(robot.n_joints, NOISE)), [1000 * seed + k for k in range(DRAWN)]
        prior = Prior(
            tuple(replace(draw(robot, number), noise=noise) for number in seeds),
            (
                f"Noise of {NOISE:g} A a sample, a fifth of its variance a level of each run.",
                f"Masses, centres of mass and gains as of {DRAWN} robots drawn from the geometry; errors are their"
                " median.",
            ),
        )
    if payload is None:
        return prior
    mass, *at = (number(part, 3) for part in payload)
    if not (0.0 < payload[0] <= _HEAVIEST and max(map(abs, payload[1:])) <= _FARTHEST):
        raise ModelError(
            "plan-impossible",
            f"a payload of {mass} kg at ({', '.join(at)}) m is out of range",
            mend=f"give a mass above 0 and up to {_HEAVIEST:g} kg, and at most {_FARTHEST:g} m along each axis",
        )
    sentence = (
        f"The last link carries {mass} kg at ({', '.join(at)}) m of its frame; gravity parameters are those of the arm"
        " with it, ratios those of the bare arm."
    )
    return Prior(tuple(loaded(truth, payload) for truth in prior.robots), (sentence, *prior.sentences))


def robot_of_estimate(robot: Robot, estimate: Estimate) -> Prior:
    """The robot that an earlier model describes; what it could not identify is taken from a random robot."""
    drawn, n = draw(robot, 0), robot.n_joints
    shown = {value.name for value in estimate.values if value.state != NOT_IDENTIFIABLE}
    values = drawn.parameters()
    # A parameter that no run shows is zero in the solution; of a sum each term has a share.
    identified = {
        name: float(value)
        for name, value in zip(estimate.names, estimate.solution, strict=True)
        if name in values and (name in shown or abs(value) > 1e-12)
    }
    ratios = {f"gain_ratio.{i}.{i + 1}": float(estimate.scales[i - 1, i]) for i in range(1, n)}
    identified |= {name: ratio for name, ratio in ratios.items() if name in shown and np.isfinite(ratio)}
    missing = [name for name in values if name not in identified]
    values |= identified
    std = [fit.noise_floor or fit.rmse or NOISE for fit in estimate.joints]
    level = [fit.run_level or np.sqrt(0.2) * s for fit, s in zip(estimate.joints, std, strict=True)]
    noise = np.hypot(std, level)
    share = float(np.median(np.minimum((np.asarray(level) / noise) ** 2, 0.9)))

    def of_joints(form: str) -> Floats:
        return np.array([values.get(form.format(k), 0.0) for k in range(1, n + 1)])

    ratio = np.array([values[f"gain_ratio.{k}.{k + 1}"] for k in range(1, n)])
    x, y, mass = (of_joints(f"gravity.l{{}}.{part}") for part in ("x", "y", "mass"))
    bare = replace(
        drawn,
        friction=Friction(
            *map(of_joints, ("coulomb.j{}.plus", "coulomb.j{}.minus", "viscous.j{}.plus", "viscous.j{}.minus"))
        ),
        noise=Noise(noise, level_share=share),
        inertia=np.zeros(n),
        seed=None,
    )
    truth = replace(bare.with_constants(Constants(x, y, mass, ratio)), breakaway=np.full(n, BREAKAWAY))
    sentences = [
        f"Parameters as of the earlier model; noise as its runs had it, {', '.join(number(s, 2) for s in noise)} A a"
        f" sample, {100.0 * share:.0f} % of the variance a level of each run."
    ]
    if missing:
        sentences.append(f"The model does not tell {', '.join(missing)}: taken from a robot drawn from the geometry.")
    return Prior((truth,), tuple(sentences))


#: Samples a second that a forecast assumes, and points at which a run's regressors are averaged over its span.
RATE, _POINTS = 100.0, 48
#: Scaled information below this is rounding; ridge on it.
_BLIND, _RIDGE = 1e-11, 1e-9


def gravity_names(robot: Robot) -> tuple[str, ...]:
    """Names of all gravity parameters and gain ratios of neighbours, those that an arm does not have among them."""
    return (*gravity_links(robot), *(f"gain_ratio.{i}.{i + 1}" for i in range(1, robot.n_joints)))


def absent_names(robot: Robot) -> dict[str, str]:
    """Name -> why no run on this arm can show it."""
    structure = minimal(robot)
    return {**structure.absent, **{f"gain_ratio.{i}.{j}": why for (i, j), why in structure.redundant.items()}}


def shown_names(robot: Robot) -> tuple[str, ...]:
    """Those that some run on this arm can show."""
    absent = absent_names(robot)
    return tuple(name for name in gravity_names(robot) if name not in absent)


def parameter_names(robot: Robot, names: Sequence[str]) -> tuple[str, ...]:
    """Gravity parameters and ratios `names`, then the friction of every joint."""
    return (
        *names,
        *(
            f"{effect}.j{joint.number}.{side}"
            for joint in robot.joints
            for side in ("plus", "minus")
            for effect in ("coulomb", "viscous")
        ),
    )


def gravity_slopes(truths: Sequence[Truth], *, joint: int, holds: Floats, names: Sequence[str]) -> Floats:
    """(G, K, 3, p) derivative of a joint's gravity current a cos q + b sin q + c by each of p parameters, A per unit.

    It is that of a, b, c for G prior robots of one geometry in the postures `holds` (K, J), rad or m; `names` are
    gravity parameters and ratios.
    """
    robot, count = truths[0].robot, len(holds)
    ends = np.concatenate([holds, holds])
    ends[:count, joint - 1], ends[count:, joint - 1] = 0.0, 0.5 * np.pi
    model, ratios = Model(robot), [f"gain_ratio.{i}.{i + 1}" for i in range(1, robot.n_joints)]
    regressors = model.base(Samples(joint, ends, np.zeros_like(ends), direction=np.ones(len(ends))))
    system = Bilinear(np.full(2 * count, joint - 1), regressors, np.zeros(2 * count), model.owners - 1)
    place = {name: k for k, name in enumerate((*model.names, *ratios))}
    chain = Gains(robot.n_joints)
    chain.parent[1:] = range(robot.n_joints - 1)
    # One column more for names that the arm does not have.
    out = np.zeros((len(truths), 2 * count, len(place) + 1))
    for k, table in enumerate(truth.parameters() for truth in truths):
        gains = chain.with_ratios(np.array([table[ratio] for ratio in ratios]))
        out[k, :, :-1] = system.jacobian(gains, np.array([table[name] for name in model.names]))
    out = out[..., [place.get(name, -1) for name in names]]
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
        friction = np.zeros((count, len(rows), 3, 4))
        friction[..., 2, :] = np.column_stack(
            [signed > 0, np.maximum(signed, 0.0), signed < 0, np.minimum(signed, 0.0)]
        )
        design = np.concatenate([slopes, friction], axis=-1)
        squares = np.swapaxes(design, -1, -2) @ moments[:, number] @ design
        columns = np.append(np.arange(len(names)), len(names) + 4 * (joint - 1) + np.arange(4))
        places = (width**2 * np.arange(count)[:, None, None] + width * columns[:, None] + columns).ravel()
        index = np.tile(places, len(rows)), len(places) * np.arange(len(rows) + 1)
        parts.append(
            sparse.csr_array((np.swapaxes(squares, 0, 1).ravel(), *index), shape=(len(rows), count * width**2))
        )
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
        return replace(
            self,
            blocks=tuple(self.blocks[k] for k in candidates.tolist()),
            posture=self.posture[candidates],
            seconds=self.seconds[candidates],
            squares=self.squares[candidates],
        )


def candidate_information(
    truths: Sequence[Truth], blocks: Sequence[Block], *, names: Sequence[str]
) -> "CandidateInformation":
    """What candidates tell G prior robots of the gravity parameters and ratios `names`, and of all friction."""
    robot = truths[0].robot
    lasting = {
        part: duration(robot, Plan(robot.name, Block((0.0,) * robot.n_joints, part).motions))
        for part in {block.sweeps for block in blocks}
    }
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
    values, vectors = np.linalg.eigh(information[np.ix_(seen_at, seen_at)] / np.outer(size[seen_at], size[seen_at]))
    blind = values < _BLIND * max(values.max(initial=0.0), 1.0)
    shows = ~np.any(np.abs(vectors[:, blind]) > 1e-4, axis=1)
    errors = np.sqrt(vectors[:, ~blind] ** 2 @ (1.0 / values[~blind])) / size[seen_at]
    return {
        names[k]: float(error) for k, error, is_shown in zip(seen_at.tolist(), errors, shows, strict=True) if is_shown
    }


def predicted_errors(truths: Sequence[Truth], motions: Sequence[Motion], names: Sequence[str]) -> dict[str, float]:
    """Name -> predicted standard error: the median over prior robots; parameters that any of them hides are out.

    Runs that are kept for judging promise nothing.
    """
    whole = parameter_names(truths[0].robot, names)
    fitted = run_information(truths, [motion for motion in motions if motion.purpose == "fit"], names)
    return median_errors(whole, np.asarray(fitted.sum(axis=0)).reshape(len(truths), len(whole), len(whole)))


def median_errors(names: Sequence[str], information: Floats) -> dict[str, float]:
    """Name -> median of the predicted standard errors by G informations (G, p, p); what any does not show is out."""
    tables = [standard_errors(names, part) for part in information]
    shared = [name for name in tables[0] if all(name in table for table in tables)]
    return {name: float(np.median([table[name] for table in tables])) for name in shared}


#: Scores within this share of the best are equal, so that rounding does not decide between two candidates.
EQUAL = 1e-6
#: How often a candidate is taken at most, and how many are evaluated exactly where slopes have ranked them.
_OFTEN, _EVALUATED = 4, 12
#: Least fall of the value that an exchange must bring, rounds at most, and removals tried a round.
_ENOUGH, _ROUNDS, _TRIED = 1e-4, 60, 6
#: Steps of the continuous design, how near its optimum it ends (of a logarithm), the power of a step, and the steps
#: after which candidates with less than a share of the mean candidate's time are dropped.
_STEPS, _NEAR, _STRIDE, _SORTED, _IDLE = 120, 0.005, 0.7, (8, 16, 28), 0.05


def rounded(scores: Floats) -> Floats:
    """Scores as multiples of `EQUAL` of the greatest."""
    return np.asarray(np.round(scores / (np.max(np.abs(scores), initial=0.0) or 1.0) / EQUAL))


@dataclass(frozen=True, eq=False, slots=True)
class Criterion:
    """Logarithm of the geometric mean of standard errors, averaged over prior robots; smaller is better.

    Source
    ------
    F. Pukelsheim, Optimal Design of Experiments, ch. 6 and 7 (D-optimality but for correlations).
    """

    size: Floats  # (p,) typical size of each parameter
    counted: Flags  # (p,) which parameters count

    def value(self, information: Floats) -> Floats:
        """(...) for information (..., G, p, p) of G robots."""
        return np.asarray(np.log(self.errors(information) / self.size)[..., self.counted].mean(axis=(-1, -2)))

    def slope(self, information: Floats) -> Floats:
        """(G, p, p): more information M lowers the value by half the sum of the products of its elements with M's."""
        inverse, share = _inverse(information), self.counted / np.count_nonzero(self.counted)
        variance = np.einsum("gpp->gp", inverse)
        return np.asarray(inverse @ ((share / variance)[..., None] * inverse)) / len(information)

    def errors(self, information: Floats) -> Floats:
        """(..., p) standard errors."""
        return np.sqrt(np.einsum("...pp->...p", _inverse(information)))


def _inverse(information: Floats) -> Floats:
    scale = np.sqrt(np.einsum("...pp->...p", information))
    scale = np.where(scale > 0, scale, 1.0)
    both = scale[..., :, None] * scale[..., None, :]
    return np.asarray(np.linalg.inv(information / both + _RIDGE * np.eye(information.shape[-1])) / both)


class ContinuousDesign:
    """The optimum if candidates could be made in fractions: `total` s shared out by the multiplicative algorithm.

    `counts` (L,) are how often each candidate is made, and `worth` (L,), 0 to 1, what one second more of each candidate
    would bring, as a share of the best.

    Source
    ------
    S. D. Silvey, D. M. Titterington and B. Torsney, Communications in Statistics A 7 (1978) 1379-1389.
    """

    def __init__(self, candidates: CandidateInformation, criterion: Criterion, total: float) -> None:
        active, part = np.arange(len(candidates)), candidates
        counts = np.full(len(candidates), total / float(np.sum(candidates.seconds)))
        for step in range(_STEPS):
            if step in _SORTED:
                spent = counts * part.seconds
                is_used = spent > _IDLE * spent.mean()
                active, counts = active[is_used], counts[is_used]
                part = candidates.only(active)
            rate = np.maximum(part.products(criterion.slope(part.information(counts))), 0.0) / part.seconds * total
            if rate.max() < 1.0 + 2.0 * _NEAR and step > _SORTED[-1]:
                break
            counts = counts * rate**_STRIDE
            counts *= total / np.sum(counts * part.seconds)
        self.counts = np.zeros(len(candidates))
        self.counts[active] = counts
        rate = candidates.products(criterion.slope(candidates.information(self.counts))) / candidates.seconds
        self.worth = rate / float(rate.max())


@dataclass(frozen=True, eq=False, slots=True)
class Exchange:
    """Greedy choice and exchange of C candidate runs under a budget (s).

    Source
    ------
    V. V. Fedorov, Theory of Optimal Experiments, ch. 3 (exchange algorithm).
    """

    candidates: CandidateInformation
    criterion: Criterion
    opening: Floats  # (C,) s of the first candidate of its posture
    budget: float

    def value(self, counts: Counts) -> float:
        """The criterion of a set (C,)."""
        return float(self.criterion.value(self.candidates.information(counts)))

    def falls(self, counts: Counts) -> Floats:
        """(C,) about how much the criterion falls by one more of each candidate."""
        return 0.5 * self.candidates.products(self.criterion.slope(self.candidates.information(counts)))

    def cost(self, counts: Counts) -> float:
        """s of a set (C,)."""
        used = np.flatnonzero(counts)
        _, first = np.unique(self.candidates.posture[used], return_index=True)
        return float(counts[used] @ self.candidates.seconds[used] + self.opening[used[first]].sum())

    def filled(self, counts: Counts) -> Counts:
        """A set (C,) with candidates added until none fits into the budget."""
        while (best := self._best_addition(counts)) is not None:
            counts = _changed(counts, best, 1)
        return counts

    def exchanged(self, counts: Counts, *, required: Counts, tell: Callable[[float], None] = lambda _: None) -> Counts:
        """A set (C,) after exchanges, while they lower the value; `required` (C,) stay; `tell` gets each new value."""
        value = self.value(counts)
        for _ in range(_ROUNDS):
            free = np.flatnonzero(counts > required)
            worth = rounded((self.falls(counts) / self.candidates.seconds)[free])
            for candidate in free[np.argsort(worth, kind="stable")[:_TRIED]]:  # the least useful for their cost
                fewer = _changed(counts, candidate, -1)
                best = self._best_addition(fewer)
                if best is None or best == candidate:
                    continue
                trial = self.filled(_changed(fewer, best, 1))
                if self.value(trial) < value - _ENOUGH:
                    counts, value = trial, self.value(trial)
                    tell(value)
                    break
            else:
                break
        return counts

    def _best_addition(self, counts: Counts) -> int | None:
        is_open = np.isin(self.candidates.posture, self.candidates.posture[counts > 0])
        costs = self.candidates.seconds + np.where(is_open, 0.0, self.opening)
        fits = (costs <= self.budget - self.cost(counts)) & (counts < _OFTEN)
        if not fits.any():
            return None
        rate = np.where(fits, self.falls(counts) / costs, -np.inf)
        top = np.flatnonzero(fits)
        top = top[np.argsort(-rounded(rate[top]), kind="stable")[:_EVALUATED]]
        more = self.candidates.information(counts) + self.candidates.each(top)
        return int(top[np.argmax(rounded((self.value(counts) - self.criterion.value(more)) / costs[top]))])


def _changed(counts: Counts, candidate: int, by: int) -> Counts:
    return counts + by * (np.arange(len(counts)) == candidate)
