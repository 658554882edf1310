"""A model against measurement, on any logs, and the residual budget: on what the rest depends, and what is noise."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import SimpleNamespace
from typing import cast

import numpy as np

from pumaid.dataset import Dataset
from pumaid.diagnosis.candidates import Candidates, Expansion, Spectrum, spectrum
from pumaid.diagnosis.score_test import replicate_test, score_candidates, sign_flips
from pumaid.effect_spec import EffectTerm
from pumaid.errors import Note, listed
from pumaid.estimate import Estimate
from pumaid.estimation.evaluate import (
    TOGETHER,
    Budget,
    BudgetPart,
    Comparison,
    JointScore,
    RunScore,
    predictions,
    rmse,
)
from pumaid.estimation.fit import Fit, FitRow
from pumaid.estimation.noise import noise_of
from pumaid.joint_bins import JointBins, joint_bins
from pumaid.maths import Counts, Floats
from pumaid.model import KNOWN_LOAD
from pumaid.preprocessing.hold_out import held_out_otherwise
from pumaid.preprocessing.replicates import noise_floor, pairs
from pumaid.results.documents import check_same_recipe
from pumaid.robot import Joint, Robot

Key = tuple[str, str]

#: A: an RMSE below this is rounding.
ROUNDING = 1e-7
#: Chance that anything at a joint is called more than noise where all is noise; the test of the dependences by sign
#: flips and that of repeated runs share it. Fewest runs whose flipped signs can show anything at `FALSE_ALARM`.
FALSE_ALARM, FEWEST_RUNS = 0.05, 6
#: Most dependences looked at closely at one joint. Postures beyond which the rest count as one.
MOST_TAKEN, MOST_POSTURES = 20, 24
#: Share of the mean square that a dependence must take, and that a ripple must: ripples come in numbers.
LEAST, LEAST_RIPPLE = 0.02, 0.004
#: Directions of which less than this share remains beside what was taken out are not looked at. Least share of a run's
#: noise that is taken for left where the fit may have taken the rest away.
LEAST_BESIDE, LEAST_FREE = 1e-3, 0.2
#: Waves over the longest run from which a wave is a ripple, and the degree of each run's polynomial taken out before.
FEWEST_WAVES, SMOOTH = 5.0, 8
#: Smooth over position: harmonics of a turn and the degree of a polynomial over the span; that of a slide.
HARMONICS, DEGREE, SLIDING_DEGREE = 3, 5, 9
#: Half waves over the campaign (a warm-up, a drift or a step shows in these) and over the speeds; lengths of a start,
#: shares of the span.
SLOW, SPEEDS, STARTS = 6, 4, (0.01, 0.03, 0.1)

RIPPLE, RIPPLE_NAME = ("fast", "position"), "fast/position"
#: Part and variable of each dependence that is tried -> the effects that look like it.
POINTS_TO: dict[Key, tuple[str, ...]] = {
    ("smooth", "position"): ("spring", "counterbalance", "flexibility"),
    ("smooth", "direction"): ("position_friction", "load_friction"),
    ("smooth", "posture"): ("tilt", "zero_offset", "flexibility", "coupling"),
    ("smooth", "load"): ("flexibility",),
    RIPPLE: ("ripple",),
    ("start", "travel"): ("presliding", "inertia"),
    ("odd", "direction"): ("warmup", "thermal_friction"),
    ("odd", "speed"): ("stribeck", "viscous_power"),
    ("odd", "load"): ("load_friction",),
    ("odd", "lag"): ("delay",),
    ("odd", "posture"): ("side_load_friction", "load_friction", "coupling"),
    ("even", "direction"): ("payload",),
    ("even", "posture"): ("tilt", "zero_offset", "coupling", "payload"),
    ("even", "speed"): ("torque_droop", "saturation"),
    ("even", "load"): ("torque_droop", "saturation"),
    ("time", "time"): ("warmup", "friction_step"),
    ("time", "load"): ("torque_constant_drift", "payload"),
    ("time", "even"): ("payload",),
    ("time", "temperature"): ("thermal_friction", "warmup"),
}
#: Names of dependences as candidates; parts that point to causes, in the order in which they are told.
KEYS = {"/".join(key): key for key in POINTS_TO}
CAUSES = tuple(dict.fromkeys(part for part, _ in POINTS_TO))


def budget(
    bins: JointBins,
    residual: Floats,
    joint: Joint,
    *,
    load: Floats | None = None,
    mean_square: float | None = None,
    floor: float | None = None,
    is_fitted: bool = True,
) -> Budget:
    """Split the mean square of what a model leaves at one joint into parts that add up to it.

    Dependences on position, direction, posture, speed, load, time, temperature and the start of a run, and ripples, are
    score-tested like effects and taken out one after the other, the largest first. What each takes, less what noise
    brings into its directions, is its part. What repeats between replicates and is none of these is unassigned, and
    without replicates what differs from run to run, which may be either; the rest is noise.

    `residual` (N,) A is measured less predicted at the bins, `load` (N,) A what gravity draws by the model (that of the
    bins where they know it), `mean_square` (A2) and `floor` (A) are those of samples and of replicates where they are
    known better than from the bins; `is_fitted` says that the model was fitted to these very runs, so that friction is
    at its best.

    Source
    ------
    R. A. Fisher, The Design of Experiments, for the test by flipped signs; P. H. Westfall and S. S. Young,
    Resampling-Based Multiple Testing (1993), for many tests at once.
    """
    if load is None and bins.samples.loads is not None:
        load = bins.samples.loads.moving
    floor = noise_floor(pairs(bins.runs))[0] if floor is None else floor
    samples, square = float(bins.count.sum()), float(bins.count @ residual**2)
    if mean_square is None:
        mean_square = (square + float(bins.count @ bins.inside_left(bins.current - residual))) / samples
    search = _Decomposition(
        *(bins, residual, columns_of(bins, joint, load)),
        inside=max(mean_square * samples - square, 0.0),
        is_fitted=is_fitted,
    )
    if mean_square > ROUNDING**2:
        search.run()
    varies, speeds = bool(bins.accelerates.any()), len(bins.speeds)
    limits = {
        "few-runs": len(bins.runs) < FEWEST_RUNS,
        "no-replicates": not bins.pairs,
        "one-direction": len(bins.directions) == 1,
        "one-posture": len(bins.postures) == 1,
        "one-speed": speeds == 1 and not varies,
        "two-speeds": speeds == 2 and not varies,
        "strokes": bool((bins.accelerates & ~bins.is_block).any()),
        "several-clocks": len({run.clock for run in bins.runs}) > 1,
        "no-load": load is None,
    }
    return Budget(
        mean_square=mean_square,
        parts=search.parts(joint, mean_square),
        runs=len(bins.runs),
        replicates=sum(len(group) for group in bins.groups if len(group) > 1),
        floor=None if floor is None else floor**2,
        limits=tuple(slug for slug, is_so in limits.items() if is_so),
    )


def columns_of(bins: JointBins, joint: Joint, load: Floats | None) -> dict[Key, Floats]:
    """(N, K) columns of every dependence that these bins can show; those that turn round with the direction are odd.

    `load` (N,) is what gravity draws by the model (A), or None.
    """
    samples, run = bins.samples, bins.run
    position, s = samples.position[:, bins.joint - 1], samples.direction[:, None]
    span = float(np.ptp(position)) or 1.0
    speed = np.abs(samples.velocity[:, bins.joint - 1])
    v = (speed / (speed.max() or 1.0))[:, None]
    age = samples.time / (samples.time.max() or 1.0)
    number = np.zeros(len(bins.runs), dtype=np.int64)  # of the posture, the most frequent first
    for place, group in enumerate(sorted(bins.postures, key=len, reverse=True)):
        number[list(group)] = min(place, MOST_POSTURES)
    posture = np.asarray((number[run, None] == np.arange(number.max() + 1)).astype(float))
    by_speed = _half_waves(v[:, 0], SPEEDS)
    share = 2.0 * (position - position.min()) / span - 1.0
    smooth = np.polynomial.legendre.legvander(share, DEGREE if joint.is_revolute else SLIDING_DEGREE)[:, 1:]
    first = posture * 0.0
    if joint.is_revolute:
        turns = np.arange(1, HARMONICS + 1) * position[:, None]
        smooth = np.hstack([np.cos(turns), np.sin(turns), smooth])
        first = np.hstack([posture * np.cos(turns[:, :1]), posture * np.sin(turns[:, :1])])
    # Time within each recording and direction, since recordings cannot be compared in time.
    clock = np.unique([run_of.clock for run_of in bins.runs], return_inverse=True)[1][run]
    ages = _centred(_half_waves(age, SLOW), bins.count, 2 * clock + (samples.direction > 0))
    measured, together = np.isfinite(samples.temperature), np.zeros(len(bins), np.int64)
    degrees = np.where(measured, samples.temperature, 0.0)[:, None]
    warmth = _centred(degrees, bins.count * measured, together) * measured[:, None]
    posture = _centred(posture, bins.count, together)
    load = np.zeros(len(bins)) if load is None else load
    rise, way, size = bins.rises(load), bins.rises(position / span), np.abs(load).max() or 1.0
    slope = np.divide(rise, way, out=np.zeros(len(bins)), where=way != 0.0)
    out = {
        ("smooth", "position"): _centred(smooth, bins.count, run),
        ("smooth", "direction"): _centred(s * smooth, bins.count, run),
        ("smooth", "posture"): _centred(first, bins.count, run),
        ("start", "travel"): _centred(s * np.exp(-samples.travel[:, None] / span / np.array(STARTS)), bins.count, run),
        ("odd", "direction"): s * v ** [0.0, 1.0],
        ("odd", "speed"): s * by_speed,
        ("odd", "posture"): s * posture,
        ("even", "direction"): v ** [0.0, 1.0],
        ("even", "posture"): posture,
        ("even", "speed"): by_speed,
        ("time", "time"): s * ages,
        ("time", "even"): ages,
        ("time", "temperature"): np.hstack([s * warmth, warmth]),
        ("smooth", "load"): _centred((load * slope)[:, None], bins.count, run),
        ("odd", "load"): s * np.abs(load)[:, None] ** [1.0, 2.0],
        ("odd", "lag"): s * v * slope[:, None],
        ("even", "load"): np.column_stack([load * np.abs(load) / size, load**3 / size**2]),
        ("time", "load"): _half_waves(age, 2) * load[:, None],
    }
    return {key: out[key] for key in POINTS_TO if key in out and np.isfinite(out[key]).all() and out[key].any()}


def _half_waves(share: Floats, count: int) -> Floats:
    return np.asarray(np.cos(np.pi * share[:, None] * np.arange(1, count + 1)))


def _centred(columns: Floats, weight: Floats, label: Counts) -> Floats:
    total = np.bincount(label, weight)
    means = [np.bincount(label, weight * column) / np.where(total > 0, total, 1.0) for column in columns.T]
    return columns - np.array(means).T[label]


@dataclass(frozen=True, eq=False, slots=True)
class Portion:
    """What could be taken out of a residual, or was.

    `chance` is that of as much anywhere at the joint by noise; `basis` (N, k) is orthonormal under the weights of the
    bins; `square` and `within` (A2 times samples) are the residual along it, and what it varies inside bins;
    `frequency` (rad of phase per rad or m) is that of a ripple, else 0.
    """

    key: Key
    chance: float
    basis: Floats
    square: float
    within: float = 0.0
    frequency: float = 0.0


class _Decomposition:
    """The residual of one joint while it is taken apart."""

    def __init__(
        self, bins: JointBins, residual: Floats, columns: dict[Key, Floats], *, inside: float, is_fitted: bool
    ) -> None:
        self.bins, self.weight, self.residual, self.inside = bins, bins.count, residual, inside
        self.total = float(self.weight @ residual**2) + inside
        # A fit has taken away what each joint has for itself in every model: friction by direction, and inertia.
        # Gravity is shared with other joints, which may have bent it.
        sides = bins.samples.direction[:, None] * [1.0, -1.0] > 0
        speed = np.abs(bins.samples.velocity[:, [bins.joint - 1]])
        friction = np.hstack([sides, sides * speed, bins.samples.acceleration[:, None]]).astype(float)
        self.basis = _orthonormal(friction if is_fitted else friction[:, :0], self.weight, friction[:, :0])
        everything = _orthonormal(np.hstack(list(columns.values())), self.weight, self.basis)
        self.noise = noise_of(bins, residual - everything @ (everything.T @ (self.weight * residual)))
        self.columns = columns if len(bins.runs) >= FEWEST_RUNS else {}
        self.tests = 1 + bool(bins.pairs)
        self.taken: list[Portion] = []
        self.waves: list[float] = []
        self.chance: dict[Key, float] = {}

    def run(self) -> None:
        """Take the residual apart until nothing in it is more than noise."""
        cost = np.log(len(self.bins.runs))
        for _ in range(MOST_TAKEN):
            passing = self._passing()
            if not passing:
                return
            largest = max(passing, key=lambda portion: portion.square - cost * self._noise(portion.basis))
            least = LEAST_RIPPLE if largest.key == RIPPLE else LEAST
            if largest.key == RIPPLE:
                self.waves.append(largest.frequency)
            else:
                del self.columns[largest.key]
            if largest.square - self._noise(largest.basis) >= least * self.total:
                self.residual = self.residual - largest.basis @ self._along(largest.basis)
                self.basis = np.hstack([self.basis, largest.basis])
                self.taken.append(largest)

    def _passing(self) -> list[Portion]:
        fit, joint, rough, out = self._fit(), self.bins.joint, self._rough(), []
        noise = noise_of(self.bins, rough, pairs=())
        white, key = noise.whiten(self.bins, rough), (RIPPLE_NAME, joint)
        waves = spectrum(key, self.bins, noise, white=white, without=self.waves, fewest_periods=FEWEST_WAVES)
        bases = {key: _orthonormal(values, self.weight, self.basis) for key, values in self.columns.items()}
        terms = [
            EffectTerm(Expansion("/".join(key), basis.shape[1], partial(lambda values, _: values, basis)), joint)
            for key, basis in bases.items()
            if basis.shape[1]
        ]
        table = replace(
            score_candidates(fit, Candidates({term.key: (term,) for term in terms})),
            spectra=() if waves is None else (waves,),
        )
        surprises = {test.added.key: test.surprise(fit.scale) for test in table.trials}
        surprises |= {spectrum.key: spectrum.surprise(fit.scale) for spectrum in table.spectra}
        flips, done = sign_flips(table), {portion.key for portion in self.taken}
        for name, surprise in surprises.items():
            cause, beyond = KEYS[name[0]], surprise - flips.handicaps[name]
            chance = self.tests * float(1 + np.count_nonzero(flips.largest >= beyond)) / (1 + len(flips.largest))
            if cause not in done:
                self.chance[cause] = min(chance, 1.0)
            if chance <= FALSE_ALARM and cause == RIPPLE and waves is not None:
                out.append(self._ripple(chance, waves))
            elif chance <= FALSE_ALARM:
                out.append(Portion(cause, chance, bases[cause], float(np.sum(self._along(bases[cause]) ** 2))))
        return out

    def _fit(self) -> Fit:
        row = FitRow(self.bins, self.noise, self.basis, self.residual)
        return cast(
            Fit,
            SimpleNamespace(
                joints=(row,),
                by_bin={self.bins.joint: row},
                inverse=np.linalg.pinv(row.jacobian.T @ row.jacobian, hermitian=True),
                scale=1.0,
                model=SimpleNamespace(robot=None),  # a dependence asks for no robot
                signs=lambda term: np.zeros(term.effect.width),
            ),
        )

    def _rough(self) -> Floats:
        out = np.empty_like(self.residual)
        for rows in np.split(np.arange(len(out)), self.bins.first[1:]):
            steps = np.linspace(-1.0, 1.0, len(rows))
            smooth = np.linalg.qr(np.polynomial.legendre.legvander(steps, min(SMOOTH, len(rows) // 2)))[0]
            out[rows] = self.residual[rows] - smooth @ (smooth.T @ self.residual[rows])
        return out

    def _ripple(self, chance: float, waves: Spectrum) -> Portion:
        frequency, (nodes, _), root = waves.peak(), self.bins.nodes, np.sqrt(self.weight)
        angle = frequency * nodes.position[:, self.bins.joint - 1]
        turning = np.column_stack([np.cos(angle), np.sin(angle)])
        both = np.hstack([turning * (nodes.direction > 0)[:, None], turning * (nodes.direction < 0)[:, None]])
        means = self.bins.averaged(both)
        size = np.linalg.lstsq(means * root[:, None], self.residual * root, rcond=1e-9)[0]
        within = float(self.weight @ self.bins.variance(both @ size, both @ size))
        basis = _orthonormal(means, self.weight, self.basis)
        return Portion(RIPPLE, chance, basis, float(np.sum(self._along(basis) ** 2)), within, frequency)

    def _along(self, basis: Floats) -> Floats:
        return np.asarray(basis.T @ (self.weight * self.residual))

    def _noise(self, basis: Floats) -> float:
        """Square (A2 times samples) that noise brings into directions, by what each run has there beside their fit."""
        weighted, rest = self.weight[:, None] * basis, self.residual - basis @ self._along(basis)
        free = np.maximum(1.0 - self.bins.sums(weighted * basis), LEAST_FREE)
        return float(np.sum(self.bins.sums(weighted * rest[:, None]) ** 2 / free))

    def parts(self, joint: Joint, total: float) -> tuple[BudgetPart, ...]:
        """Every part; they add up to the mean square `total` (A2)."""
        samples, inside, explained = float(self.weight.sum()), self.inside, dict.fromkeys(CAUSES, 0.0)
        for portion in self.taken:
            within = min(portion.within, inside)
            inside -= within
            explained[portion.key[0]] += (max(portion.square - self._noise(portion.basis), 0.0) + within) / samples
        rest = max(total - sum(explained.values()), 0.0)
        level = float(np.mean(noise_of(self.bins, self.residual).level ** 2))
        repeated, chance = self._unassigned(level)
        unassigned = min(repeated, rest)
        shared = min(level if self.bins.pairs else 0.0, rest - unassigned)
        return (
            BudgetPart("noise_shared", shared),
            BudgetPart("noise_inside", rest - unassigned - shared),
            *(self._cause(name, joint, explained[name]) for name in CAUSES),
            BudgetPart("unassigned", unassigned, chance, unassigned > 0.0 and chance is not None),
        )

    def _unassigned(self, level: float) -> tuple[float, float | None]:
        """A2 that repeats and has no name, with its chance; what may be noise or not in few runs, without repeats."""
        least = LEAST * self.total / float(self.weight.sum())
        square = float(np.average(self.residual**2, weights=self.weight))
        if square <= ROUNDING**2:
            return 0.0, None
        if len(self.bins.runs) < FEWEST_RUNS:
            slow = square - float(np.average(self._rough() ** 2, weights=self.weight))
            return (slow if slow >= least else 0.0), None
        if not self.bins.pairs:
            return level, None
        repeated = replicate_test(self.bins, self.residual, self.noise.whiten(self.bins, self.residual))
        if repeated is None:
            return 0.0, None
        chance, shared = min(self.tests * repeated.p_value, 1.0), repeated.share * square
        return (shared if chance <= FALSE_ALARM and shared >= least else 0.0), chance

    def _cause(self, name: str, joint: Joint, mean_square: float) -> BudgetPart:
        portions = sorted((item for item in self.taken if item.key[0] == name), key=lambda item: -item.square)
        tried = [item.chance for item in portions] or [chance for key, chance in self.chance.items() if key[0] == name]
        turn, gearing = (1.0, joint.gear_ratio) if joint.is_revolute else (2.0 * np.pi, None)
        cycles = tuple(item.frequency / turn for item in portions if item.frequency)
        return BudgetPart(
            name=name,
            mean_square=mean_square,
            p_value=min(tried, default=None),
            is_more=bool(portions),
            against=tuple(dict.fromkeys(item.key[1] for item in portions)),
            cycles=cycles,
            per="" if not cycles else "turn" if joint.is_revolute else "m",
            gearing=tuple(number / gearing for number in cycles) if gearing else (),
            points_to=tuple(dict.fromkeys(effect for item in portions for effect in POINTS_TO[item.key])),
        )


def _orthonormal(columns: Floats, weight: Floats, taken: Floats) -> Floats:
    """(N, k) directions of columns, orthonormal under the weights and free of the orthonormal columns `taken`."""
    weighted = weight[:, None] * columns
    gram, cross = columns.T @ weighted, taken.T @ weighted
    size = np.sqrt(np.diagonal(gram))
    unit = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0)
    values, vectors = np.linalg.eigh((gram - cross.T @ cross) * np.outer(unit, unit))
    visible = values > LEAST_BESIDE
    turn = unit[:, None] * vectors[:, visible] / np.sqrt(values[visible])
    return np.asarray(columns @ turn - taken @ (cross @ turn))


def compare(estimate: Estimate, dataset: Dataset, robot: Robot) -> Comparison:
    """Score a model on logs: per joint and per run.

    A run's RMSE and bias are exact over its samples; predictions and their parts are given at its bins. Runs that the
    plan holds out are scored apart; those that the fitted data could not tell enough of are flagged.

    Raises
    ------
    ModelError [model-other-recipe], [unknown-effect]
        The model was identified with another recipe, or holds an effect that the catalogue does not have.

    Source
    ------
    S.-K. Lin, section IV: the estimated against the measured current, and the standard deviation in Table I.
    """
    check_same_recipe(estimate, robot)
    at_joints = predictions(estimate, dataset, robot)
    files = {facts.name for facts in dataset.files if facts.digest in estimate.logs.values()}
    is_fitted = [not run.heldout and run.origin in files for run in dataset.runs]
    joints, scores = [], dict[int, RunScore]()
    for joint in robot.joints:
        numbers = [n for n, run in enumerate(dataset.runs) if run.joint == joint.number]
        if not numbers:
            why = f"joint {joint.number} never moves alone in these logs"
            joints.append(JointScore(joint.number, 0, 0, noise_floor_reason=why))
            continue
        prediction, were_fitted = at_joints[joint.number], [is_fitted[n] for n in numbers]
        of_runs = list(prediction.run_scores(were_fitted))
        scores |= dict(zip(numbers, of_runs, strict=True))
        score = prediction.joint_score(of_runs)
        counted = [n for n, is_counted in enumerate(prediction.counted) if is_counted]
        has_load = all(
            name == "gravity" or "gravity" not in name.split(TOGETHER) for n in counted for name in of_runs[n].parts
        )
        loads = [of_runs[n].parts.get("gravity", np.zeros(len(of_runs[n].predicted))) for n in counted]
        runs = [of_runs[n].run for n in counted]
        is_whole = prediction.counted.all() and len(prediction.bins) == sum(len(run.bins) for run in runs)
        split = budget(
            prediction.bins if is_whole else joint_bins(robot, runs, is_settled=False)[0],
            np.concatenate([of_runs[n].residual for n in counted]),
            joint,
            load=np.concatenate(loads) if has_load else None,
            mean_square=(score.rmse or 0.0) ** 2,
            floor=score.noise_floor,
            is_fitted=all(were_fitted[n] for n in counted),
        )
        joints.append(replace(score, budget=split))
    return Comparison(
        robot=robot.name,
        joints=tuple(joints),
        runs=tuple(scores[n] for n in range(len(dataset.runs))),
        rmse=rmse((prediction, prediction.counted) for prediction in at_joints.values()),
        logs={facts.name: facts.digest for facts in dataset.files},
        notes=tuple(_notes(estimate, dataset, joints)),
        heldout=rmse((prediction, prediction.heldout) for prediction in at_joints.values()),
        recipe_digest=robot.digest,
        version=estimate.version,
    )


def _notes(estimate: Estimate, dataset: Dataset, joints: Sequence[JointScore]) -> list[Note]:
    notes = [*dataset.notes, *held_out_otherwise(estimate, dataset)]
    digests = {facts.digest for facts in dataset.files}
    fitted = digests & set(estimate.logs.values())
    if digests and fitted == digests and not any(joint.heldout_runs for joint in joints):
        which = "the log was" if len(fitted) == 1 else f"all {len(fitted)} logs were"
        text = (
            f"{which} fitted, so the error is what is left after fitting;"
            " logs that the model never saw show what it predicts"
        )
        notes.append(Note("compared-with-fitted", text))
    carried = sorted({run.origin for run in dataset.runs if run.payload})
    if carried and not any(KNOWN_LOAD in name for name in estimate.names):
        text = f"the model knows no torque constants, so it predicts {listed(carried, 3)} without the known load"
        notes.append(Note("payload-unused", text))
    lost = sum(joint.undetermined for joint in joints)
    if lost:
        which = "1 run needs" if lost == 1 else f"{lost} runs need"
        text = f"{which} something that the fitted logs did not determine, so its error says little of the model"
        notes.append(Note("prediction-undetermined", text))
    return notes
