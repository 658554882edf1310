"""Identification: runs, and effects beyond the paper's model, to every parameter with its honest uncertainty, and what
a user should know of the fit: each note with its slug, its test, what it says and what to do.
"""

import itertools
import math
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from pumaid import __version__
from pumaid.dataset import Dataset, Run, first_motions
from pumaid.effect_spec import expanded
from pumaid.effects import Family, Trace, load_refusal
from pumaid.errors import LogError, Note, Where, listed, refuse
from pumaid.estimate import GIVEN, IDENTIFIED, Estimate, JointFit, Value
from pumaid.estimation.covariance import interval, two_sided
from pumaid.estimation.curves import curve_values
from pumaid.estimation.evaluate import JointPrediction, fast_squares, predictions, rmse
from pumaid.estimation.fit import Fit, FitRow
from pumaid.estimation.gls import Progress
from pumaid.estimation.identifiability import Coverage, FittedParameters, outer_postures, reason
from pumaid.estimation.link_lengths import STEP, length_tests
from pumaid.estimation.noise import fit_each_run
from pumaid.estimation.nonlinear import EffectFit, Ends, ShapeLikelihood, fit_effects
from pumaid.estimation.setups import of_counts, of_setups, of_weight
from pumaid.joint_bins import JointBins
from pumaid.maths import Counts, Flags, Floats, inverse_root, least_squares
from pumaid.model import Model
from pumaid.robot import EffectChoice, Robot
from pumaid.units import number

#: RMSE over noise beyond which a model misses a joint. Logs of the arm that the model is of are within 1.3 times.
FAR, FAR_IN_BLOCKS = 2.0, 1.35
#: Standard errors by which a mean friction is surely more than a current ever was.
SURELY_MORE = 5.0
#: Share of a joint's current (RMS) that a misfit must be besides.
SEEN = 1e-3
#: A file is an outlier if its RMSE under a fit to the others exceeds theirs by this factor; the fit needs so many runs,
#: which show a direction of the parameters if they have this share of what they and the file tell of it.
FEWEST, DISOWNED, SHOWN = 8, 4.0, 0.25
#: What stands for the file of a current that is 0, and the share of a joint's bins from which it is looked at.
UNPOWERED, OFF = "samples without current", 0.02
#: Multiple of the median run's RMSE that makes a run an outlier, the chance that any run of a joint is by noise, and
#: share of the runs that may be: more are another matter.
ODD, FAMILYWISE, MOST_ODD = 5.0, 1e-3, 0.2
#: Multiple of the usual variance of a bin beyond which their mean is one of outliers (normal noise has 2.2 at most);
#: bins from which a run's own outliers are found.
SPIKY, ENOUGH = 15.0, 24
#: Replicates of a joint that show a change, and the p-value below which it is one.
FEWEST_REPEATS, CHANCE = 6, 1e-5
#: Share of the noise floor that a change must be to matter; no change below a share of the current does, either.
CHANGE = 0.5
#: Condition beyond which a change in proportion to the current is confounded with the others.
ALIKE = 30.0
#: What a change may be: its unit and what that is multiplied by, what it goes with, and its cause.
KINDS = (
    ("A", 1.0, "whichever way it moves", "likely a sensor offset, an encoder zero or its load changed"),
    ("A", 1.0, "in the direction of motion", "friction changed, as when it warms up ('pumaid diagnose' tells)"),
    ("%", 100.0, "in proportion to it", "its gain changed"),
)
#: Share of a joint's load on another's motor below which it is not spoken of.
SMALLEST_PART = 1e-3
#: Standard errors beyond which a gain ratio, and an inertia, has a sign.
SURELY, NEGATIVE = 5.0, 3.0
#: Chance at most, over all lengths, of calling a right one wrong.
CONTRADICTED = 3e-3
#: Ratio of neighbours' gains that is none if it may be zero and is smaller: published arms are within a factor of ten.
NO_RATIO = 0.1
#: Share of a joint's RMS current below which its Coulomb friction is none; of geared arms it is 0.1 to 0.6.
FRICTIONLESS = 0.1


#: Slug (and variant) -> what a note says and what to do.
TEXTS = {
    "friction-none": "the currents of joints {joints} show no friction, which motors with gears have: are they of an"
    " arm guided by hand, of torque sensors behind the gears, or simulated? Of an arm guided by hand they tell what its"
    " controller takes gravity for, and nothing of friction and inertia",
    "logs-disagree": "the model's error at joint {joint} is {misses} A RMS, and {file} is inconsistent with the other"
    " logs: {evidence}. Check that it is the same robot with the same payload, zeros, units and columns",
    "model-misses": "the model's error at joint {joint} is {misses} A RMS, its {level} A. Its intervals may not hold"
    " the truth; if no column is wrong, 'pumaid diagnose' tells what is missing",
    "run-stands-out": "{count} of {runs} runs of joint {joint} unlike the others: the model's error there is {error} A"
    " RMS, where the median run has {usual} A; the first begins at {start} s. Did the arm touch something? Estimates"
    " are biased by it, and no interval includes that",
    "current-spikes": "the current of joint {joint} has spikes: noise is {noise} A RMS, but {usual} A in a typical half"
    " of the data. Spikes that occur in one direction only bias friction and gravity: look at the samples",
    "repeats-differ": "joint {joint} draws {change} ± {error} {unit} {sign} {goes} in the last of {runs} repeated runs"
    " than in the first of them: {cause}. Estimates are averages of before and after",
    "few-runs": "joint {joint} has {runs} only: its intervals rest on the noise inside runs and do not include how"
    " repeated runs differ",
    "load-through-gears": "by the recipe's gears (coupling) {passed}; this model leaves that out, so gravity and gain"
    " ratios are biased{beside}",
    "friction-falls-with-speed": "friction of joint {joint} falls with speed going {way} ({slope}), which viscous"
    " friction does not: Stribeck friction dominates, or something else changed with speed",
    "sign-odd": "{name} is {sign} ({size}) although friction shows that the two currents have {same}. Check"
    " signs in the DH table, of the position columns and of gravity",
    "sign-odd, inertia": "inertia of joint {joint} comes out below zero ({size}, by the sign of its friction): its"
    " current or position is late or smoothed, or its position is in another unit",
    "length-wrong": "the motion contradicts the length {name} of joint {joint}, {length} m in the recipe: {fits}"
    "{beside}. Until it is right, ratios, inertia and friction are off by more than their errors; physics that 'pumaid"
    " diagnose' names may look like it",
    "ratio-none": "{name} comes out as none ({size}): the current of joint {joint} shows nothing of what the links"
    " beyond joint {outer} ask of it. Are they far lighter than what it carries before them? Else gravity or inertia"
    " was taken out of these currents, or they are simulated without; then their ratios and inertias are not to be"
    " relied on",
    "sign-odd, load": "{name} comes out as {size}, against the sign of friction: is the known load stated for the logs"
    " that carried it, and at the right place?",
    "offset-odd": "friction of joint {joint} has a mean of both ways of {offset} A, and its current never was more than"
    " {largest} A: weight and friction take each other away, as where positions are in another unit, gravity points"
    " elsewhere, or a constant force balances the arm. Neither is to be relied on",
    "effects-not-settled": "the fit with {names} did not converge; two of its effects may be confounded",
    "several-clocks": "the logs have {clocks} clocks: {name} starts its time anew in each",
}


def identify(
    dataset: Dataset,
    robot: Robot,
    *,
    effects: Sequence[EffectChoice] | None = None,
    recursive: bool = False,
    trust: bool = False,
    progress: Progress | None = None,
) -> Estimate:
    """Every parameter of the minimal model and of the effects, identified or not, with errors clustered by run.

    Rows are solved from the last joint to the first; then, unless `recursive`, all rows are refined together. Held-out
    runs are left out. `effects` are physics beyond the paper's model, the recipe's where not given; shapes that a
    choice leaves open are fitted. `progress` is called with the joint at work (0: all) and a word on what is done.

    Raises LogError: no-runs where there is no run to fit, scale-wrong where positions are in another unit, unless
    `trust`; and ModelError (unknown-effect, effect-joint, effect-shape,
    effect-twice) where an effect cannot be in the model.

    Source: S.-K. Lin, "Identification of a Class of Nonlinear Deterministic Systems with Application to Manipulators".
    """
    choices = expanded(robot.effects if effects is None else effects, robot)
    runs = tuple(run for run in dataset.runs if not run.heldout)
    if not runs:
        number = len(dataset.runs) or len(dataset.rejects)
        what = f"{number} runs, all held out" if dataset.runs else f"{number} stretches left out"
        where = Where(file=dataset.files[0].name if dataset.files else None)
        raise LogError(
            "no-runs", f"there is no run to fit ({what})", where, "see why with: pumaid segment LOGS --rejects"
        )
    model, begun = Model.of_runs(robot, runs), first_motions(dataset.runs)
    # The rigid body has an inertia of each joint already.
    choices = tuple(choice for choice in choices if not (model.is_dynamic and choice.effect == "inertia"))
    result = fit_effects(model, runs, choices, begun=begun, recursive=recursive, progress=progress)
    coverage = {joint.number: [run for run in runs if run.joint == joint.number] for joint in robot.joints}
    estimate = _estimate(result, choices, coverage, recursive=recursive)
    at_joints = predictions(estimate, dataset, robot)
    joints = [_joint_fit(result, joint, covered, at_joints.get(joint)) for joint, covered in coverage.items()]
    estimate = replace(
        estimate,
        joints=tuple(joints),
        logs={facts.name: facts.digest for facts in dataset.files},
        heldout=rmse((prediction, prediction.heldout) for prediction in at_joints.values()),
    )
    remarks = list(notes_on(result, estimate, robot=robot, at_joints=at_joints))
    refuse([] if trust else [item for item in remarks if isinstance(item, LogError)])
    notes = (item if isinstance(item, Note) else Note(item.slug, f"{item.what}; {item.mend}") for item in remarks)
    return replace(estimate, notes=(*dataset.notes, *notes))


def _estimate(result: EffectFit, choices: Sequence[EffectChoice], coverage: Coverage, *, recursive: bool) -> Estimate:
    fitted, model = result.fit, result.fit.model
    assert fitted.first is not None
    parameters = FittedParameters(fitted.first if recursive else fitted, coverage)
    parameters.profiles = _profiles(result, parameters)
    values = parameters.values()
    is_shape = np.array([column.shape is not None for column in model.columns], dtype=bool)
    return Estimate(
        robot=model.robot.name,
        joints=(),
        values=(*values, *_shapes(result, choices, values), *curve_values(fitted, parameters.covariance)),
        names=model.names,
        solution=np.where(is_shape, 0.0, fitted.values),
        covariance=parameters.covariance[: len(is_shape), : len(is_shape)],
        scales=fitted.scales(),
        blind=parameters.reach()[: len(is_shape)],
        effects=tuple(replace(choice, shape=shape) for choice, shape in zip(choices, result.shapes, strict=True)),
        combinations=parameters.combinations(values),
        recursive=FittedParameters(fitted.first, coverage).values(),
        method="recursive" if recursive else "joint",
        recipe_digest=model.robot.digest,
        geometry=model.robot.geometry,
        origin=model.robot.origin,
        version=__version__,
    )


def _shapes(result: EffectFit, choices: Sequence[EffectChoice], values: Sequence[Value]) -> list[Value]:
    """Shapes without a derivative: given ones, and instants and whole numbers that were searched for."""
    model, out = result.fit.model, []
    identified = {value.name for value in values if value.state == IDENTIFIED}
    for place, (choice, term) in enumerate(zip(choices, model.effects, strict=True)):
        if term.effect.is_free:
            continue
        shows = any(column.name in identified for column in model.columns if column.place == place)
        for column in replace(term, fitted=tuple(term.shape)).parts(model.robot, place):
            name = column.shape
            bare = Value(column.name, column.symbol, column.owner or None, column.unit)
            if name is None or (name in term.fitted and name not in choice.shape):
                continue
            if name in choice.shape:
                out.append(replace(bare, value=choice.shape[name], state=GIVEN))
            elif shows:
                out.append(replace(bare, value=term.shape[name], ci95=result.ranges.get((place, name))))
            else:
                out.append(replace(bare, **reason("no size", effect=term.effect.name)))
    return out


def _profiles(result: EffectFit, parameters: FittedParameters) -> dict[int, Ends]:
    """By column (from 0): profile-likelihood intervals of effects whose shapes were fitted, and of what moves along.

    Where the model's own likelihood is all that is known of a parameter's spread, clustered errors are; an interval
    reaches as much further.
    """
    model, out = result.fit.model, dict[int, Ends]()
    inverse = np.diag(result.fit.inverse)
    wide = np.array([interval(0.0, 1.0, dof)[1] for dof in parameters.freedoms])
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(inverse > 0, wide * np.sqrt(np.diag(parameters.covariance) / inverse), 0.0)
    for place, term in enumerate(model.effects):
        columns = {n: column for n, column in enumerate(model.columns) if column.place == place}
        lost = any(n in parameters.confounded for n in columns)
        if lost or not term.fitted or term.held or not all(reach[n] > 0 for n in columns):
            continue
        linear = [n for n, column in columns.items() if column.shape is None]
        profile = ShapeLikelihood(result.without(place), term.at(result.shapes[place]), result.fit.limit[linear])
        for n, column in columns.items():
            if column.shape is not None:
                error = float(np.sqrt(parameters.covariance[n, n]))
                out[n] = profile.interval(column.shape, error=error, reach=float(reach[n]))
        out |= dict(zip(linear, map(tuple, profile.linear(reach[linear]).tolist()), strict=True))
        names = profile.projector.solved.model.names
        same = {model.names.index(name): n for n, name in enumerate(names) if name in model.names}
        before = profile.others(reach[[*same, *range(len(model.names), len(reach))]])
        out = {n: tuple(before[k]) for n, k in same.items() if model.columns[n].owner == term.number} | out
    return out


def _joint_fit(result: EffectFit, joint: int, covered: Sequence[Run], prediction: JointPrediction | None) -> JointFit:
    """How well one joint is fitted; `prediction` is the model at all of its runs, None where there are none."""
    why = f"joint {joint} never moves alone in these logs"
    nothing = {"joint": joint, "runs": 0, "samples": 0, "rmse": None, "noise_floor": None, "noise_floor_reason": why}
    figures, fitted = {} if prediction is None else prediction.figures(), result.fit
    if prediction is None or not covered:
        return JointFit(**figures | nothing)
    return JointFit(
        **figures,
        run_level=None if joint in fitted.weak else float(fitted.noises[joint].level[0]),
        posture_groups=outer_postures(covered),
        kinds=dict(sorted(Counter(run.kind for run in prediction.bins.runs if not run.heldout).items())),
    )


def _note(kind: str, where: Where | None = None, **values: object) -> Note:
    where = where or Where()
    shown = {name: number(value) if isinstance(value, float) else value for name, value in values.items()}
    return Note(kind.split(",")[0], TEXTS[kind].format(joint=where.joint, **shown), where)


def notes_on(
    result: EffectFit, estimate: Estimate, *, robot: Robot, at_joints: Mapping[int, JointPrediction]
) -> Iterator[LogError | Note]:
    """All notes on a fit and on what was estimated; `at_joints` maps a joint to what is predicted of its runs."""
    fitted, effects = result.fit, result.fit.model.effects
    frictionless, missed = list(of_friction(fitted, estimate.values)), list(of_misfit(fitted, estimate.joints))
    # Beside another effect of speed, a viscous term is a part of friction only.
    of_speed = {term.joint for term in effects if term.effect.family is Family.SPEED}
    signs = [] if frictionless else list(of_signs(estimate.values, of_speed))
    wrong_signs = [note for note in signs if note.slug == "sign-odd"]
    odd = list(of_offsets(fitted, estimate.values))
    joints = dict.fromkeys(note.where.joint or 0 for note in (*missed, *odd))
    causes = of_setups(fitted, list(joints), is_odd=bool(odd))
    # An arm that swings freely has no current, and witnesses another setup.
    missed = [item for item in missed if isinstance(item, Note) or not causes]
    yield from (*frictionless, *causes, *odd, *of_counts(fitted), *of_weight(at_joints), *wrong_signs, *missed)
    uncoupled = list(of_ratios(estimate.values, robot))
    yield from uncoupled
    # What makes a model miss, as a zero or a clock, looks like lengths, too, and so do links that are not felt.
    if not (frictionless or missed or uncoupled):
        yield from of_lengths(fitted)
    yield from of_runs(fitted, at_joints)
    yield from of_drift(estimate.joints, at_joints)
    for joint in sorted(fitted.weak):
        runs = len(fitted.by_bin[joint].bins.runs)
        yield _note("few-runs", Where(joint=joint), runs=f"{runs} run{'s' if runs > 1 else ''}")
    yield from of_gears(fitted, robot)
    yield from (note for note in signs if note not in wrong_signs)
    if not result.is_settled:
        yield _note("effects-not-settled", names=", ".join(dict.fromkeys(term.effect.name for term in effects)))
    timed = [term.effect.name for term in effects if Trace.TIME in term.effect.trace and not term.is_carried]
    clocks = len({run.clock for row in fitted.rows for run in row.bins.runs})
    if timed and clocks > 1:
        yield _note("several-clocks", clocks=clocks, name=timed[0])


def of_friction(fitted: Fit, values: Sequence[Value]) -> Iterator[Note]:
    """Joints whose current hardly turns round with the direction, where these are more than half of those that move.

    Beside another effect Coulomb friction is a part of friction only.
    """
    certain, none = {value.name: value for value in values if value.std_error}, list[int]()
    for row in (row for row in fitted.joints if not any(t.touches(row.bins.joint) for t in fitted.model.effects)):
        ways = [certain.get(f"coulomb.j{row.bins.joint}.{way}") for way in ("plus", "minus")]
        (plus, error), (minus, other) = (
            (way.value or 0.0, way.std_error or 0.0) if way else (0.0, 0.0) for way in ways
        )
        farthest = abs(plus - minus) / 2.0 + math.hypot(error, other)
        none += [row.bins.joint] if all(ways) and farthest < FRICTIONLESS * math.sqrt(row.bins.mean_square) else []
    if len(none) > len(fitted.joints) / 2:
        yield _note("friction-none", joints=", ".join(map(str, none)))


def of_offsets(fitted: Fit, values: Sequence[Value]) -> Iterator[Note]:
    """Joints whose Coulomb friction has a mean of both ways that is more than their current ever was."""
    certain = {value.name: value for value in values if value.std_error}
    for row in fitted.joints:
        joint, largest = row.bins.joint, float(np.abs(row.bins.current).max())
        ways = [certain.get(f"coulomb.j{joint}.{way}") for way in ("plus", "minus")]
        sizes = [(way.value or 0.0, way.std_error or 0.0) for way in ways if way]
        offset, error = np.mean(sizes, axis=0) if len(sizes) > 1 else (0.0, 0.0)
        if abs(offset) - SURELY_MORE * error > largest:
            yield _note("offset-odd", Where(joint=joint), offset=float(offset), largest=largest)


def of_misfit(fitted: Fit, joints: Sequence[JointFit]) -> Iterator[LogError | Note]:
    """A note for each joint whose current the model does not explain, with the file that is to blame if one is.

    Noise is what is left of each run by its own harmonic, or the noise floor if that is less.
    """
    for system in fitted.rows:
        row, joint = fitted.by_bin[system.joint], next(fit for fit in joints if fit.joint == system.joint)
        misses, floor = joint.rmse or 0.0, joint.noise_floor or 0.0
        squares, samples = _inside(row)
        inside = float(np.sqrt(np.average(squares, weights=samples)))
        noise = inside if joint.noise_floor is None else min(inside, floor)
        far = FAR_IN_BLOCKS if row.bins.is_block.any() else FAR
        if misses <= max(far * noise, SEEN * math.sqrt(row.bins.mean_square)):
            continue
        name, evidence = _outlier_file(row, system.design)
        if name == UNPOWERED:
            what = (
                f"the current of joint {joint.joint} is exactly 0 for a while in which it moves, and there {evidence}:"
                " it was not measured, or the motor was off and something else moved the arm"
            )
            yield LogError("current-dropouts", what, Where(joint=joint.joint), "leave these currents empty")
            continue
        kind = "logs-disagree" if name else "model-misses"
        level = f"noise floor {number(floor)}" if 0.0 < floor < misses else f"noise inside runs {number(noise)}"
        facts = {"misses": misses, "level": level, "file": name, "evidence": evidence}
        yield _note(kind, Where(file=name, joint=joint.joint), **facts)


def _outlier_file(row: FitRow, design: Floats) -> tuple[str | None, str]:
    bins, suspects = row.bins, list[tuple[float, str, str]]()
    is_off = (bins.current == 0.0) & (np.mean(bins.current == 0.0) > OFF)
    origins = np.where(is_off, UNPOWERED, np.array([run.origin for run in bins.runs])[bins.run])

    def error(target: Flags, source: Flags, misfit: Floats = row.misfit) -> float:
        """RMSE (A) of some bins (N,) once the corrections that others show are taken out.

        What these hardly show beside the former stays as both have it together: it would be guessed.
        """
        given, sought = (design[rows].T @ (bins.count[rows, None] * design[rows]) for rows in (source, target))
        half = inverse_root(given + sought)
        shares, vectors = np.linalg.eigh(half.T @ given @ half)
        turned = half @ (vectors[:, shares > SHOWN] / np.sqrt(shares[shares > SHOWN]))
        correction = turned @ (turned.T @ (design[source].T @ (bins.count * misfit)[source]))
        residual = misfit[target] - design[target] @ correction
        return float(np.sqrt(np.average(residual**2 + bins.inside[target], weights=bins.count[target])))

    for name in dict.fromkeys(origins.tolist()):
        rest = origins != name
        runs = np.unique(bins.run[rest])
        if len(runs) < FEWEST:
            continue
        # The rest is judged by halves, each by a fit to the other, so that noise gains nothing; neighbouring runs go to
        # and fro, and pairs of them keep both directions in each half.
        first = rest & np.isin(bins.run, runs[np.isin(np.arange(1, len(runs) + 1) % 4, (0, 1))])
        second = rest & ~first
        usual = float(np.hypot(error(first, second), error(second, first)) / np.sqrt(2.0))
        missed = error(~rest, rest)
        why = f"its runs have {number(missed)} A RMS under a fit to the others, which have {number(usual)} A"
        # The misfit of the file with the other sign: what is drawn is that less the current twice.
        turned = error(~rest, rest, row.misfit - 2.0 * bins.current * ~rest)
        if turned < min(missed, DISOWNED * usual):
            why += f", and {number(turned)} A with its sign turned: its current has the other sign there"
        # What a fit of its own leaves of the file, too, the model lacks everywhere.
        least = max(usual, error(~rest, ~rest)) * (FAR if name == UNPOWERED else DISOWNED)
        suspects += [(missed / usual, name, why)] if missed > least else []
    return max(suspects, default=(0.0, None, ""))[1:]


def of_runs(fitted: Fit, at_joints: Mapping[int, JointPrediction]) -> Iterator[Note]:
    """Notes on single runs that the model misses far more than the others of their joint, and on noise of outliers.

    Both pass for noise everywhere else: they make intervals wide, and no other note tells what they move. Where the
    model misses a whole joint no run is named.

    Source
    ------
    F. R. Hampel, J. Am. Stat. Assoc. 69 (1974) 383-393: the median and the deviation from it, here of logarithms.
    """
    for row in fitted.joints:
        bins, samples = row.bins, row.bins.sums(row.bins.count)
        level = bins.sums(bins.count * row.misfit) / samples
        about = (row.misfit - level[bins.run]) ** 2 + bins.inside_left(row.drawn)
        rms = np.sqrt(bins.sums(bins.count * about) / samples)
        # What accelerates leaves more, by all that a change of speed does.
        steady = np.flatnonzero(~bins.accelerates)
        if len(steady) < FEWEST:
            continue
        size, usual = math.sqrt(bins.mean_square), float(np.median(rms[steady]))
        noise = float(np.median(np.sqrt(_inside(row)[0][steady])))
        is_met = usual > 0.0 and float(np.median(np.hypot(rms, level)[steady])) <= FAR * noise
        # Beyond a size and beyond what the others' scatter lets any run be by chance; the standard deviation of normal
        # values is 1.4826 times the median of their deviations.
        logs = np.log(np.maximum(rms[steady], np.finfo(float).tiny))
        off = logs - np.median(logs)
        scatter = max(1.4826 * float(np.median(np.abs(off))), np.finfo(float).eps)
        chance = len(steady) * np.array([two_sided(ratio, len(steady) - 1) for ratio in off / scatter])
        odd = steady[is_met & (rms[steady] > max(ODD * usual, SEEN * size)) & (chance < FAMILYWISE)]
        if 0 < len(odd) <= MOST_ODD * len(steady):
            first, error = bins.runs[odd[0]], float(np.sqrt(np.mean(rms[odd] ** 2)))
            where = Where(file=first.origin, row=first.first_row, joint=bins.joint)
            facts = {"count": len(odd), "runs": len(steady), "start": float(first.start)}
            yield _note("run-stands-out", where, error=error, usual=usual, **facts)
            continue
        sizes = [usual, float(np.sqrt(np.mean(rms[steady] ** 2)))] if len(odd) else _spikes(at_joints[bins.joint])
        if sizes and sizes[1] > SEEN * size:
            yield _note("current-spikes", Where(joint=bins.joint), usual=sizes[0], noise=sizes[1])


def _beside_harmonics(bins: JointBins) -> tuple[Floats, Counts]:
    """(N,) A that each run's own first harmonic, and in strokes its motion, leave; and (R,) their numbers of terms."""
    v, stroke = bins.samples.velocity[:, bins.joint - 1], bins.accelerates[bins.run]
    motion = [np.ones(len(v)), stroke * v, stroke * bins.samples.acceleration]
    drawn, terms = fit_each_run(bins, np.column_stack([bins.harmonic, *motion]))
    return bins.current - drawn, terms


def _inside(row: FitRow) -> tuple[Floats, Floats]:
    """(R,) A2 of a sample that each run's own first harmonic leaves, in a block what the fit leaves that comes and goes
    within some tenths of a second, and (R,) its samples.
    """
    bins = row.bins
    residual, terms = _beside_harmonics(bins)
    inside = bins.inside_left(bins.current - residual)
    samples = bins.sums(bins.count)
    squares = bins.sums(bins.count * (residual**2 + inside)) / np.maximum(samples - terms, 1.0)
    return np.where(bins.is_block, fast_squares(bins, row.misfit, bins.inside), squares), samples


def _spikes(prediction: JointPrediction) -> list[float]:
    """Usual and RMS noise (A) of fitted runs where it is mostly outliers, inside bins or from bin to bin; else none.

    Each run is judged by itself, since its speed says how quickly what the model lacks comes and goes.
    """
    bins = prediction.bins
    residual = np.split(_beside_harmonics(bins)[0], bins.first[1:])
    inside = np.split(bins.inside, bins.first[1:])
    long = np.flatnonzero(prediction.counted & ~bins.accelerates & (bins.lengths >= ENOUGH))
    # Third differences leave nothing of a load's course, and of independent noise 20 times its variance.
    squares = [np.diff(residual[n], n=3) ** 2 / 20.0 + inside[n][3:] for n in long]
    usual, mean = (np.array([part(values) for values in squares]) for part in (np.median, np.mean))
    is_noisy = usual > 1e-7 * mean  # else values are held
    if np.count_nonzero(is_noisy) < FEWEST or np.median(mean[is_noisy] / usual[is_noisy]) <= SPIKY:
        return []
    return [float(np.sqrt(np.median(usual[is_noisy]))), float(np.sqrt(mean[is_noisy].mean()))]


def of_drift(joints: Sequence[JointFit], at_joints: Mapping[int, JointPrediction]) -> Iterator[Note]:
    """A note for each joint whose current changed between the first and the last of its repeated runs.

    The same whichever way the joint moved, a sensor's zero or a load changed; with the motion, friction; in proportion,
    a gain.
    """
    for fit in joints:
        last = [pair for pair in at_joints[fit.joint].repeated if pair.is_last] if fit.joint in at_joints else []
        ways = np.array([pair.first.direction for pair in last], dtype=float)
        if min(np.count_nonzero(ways > 0), np.count_nonzero(ways < 0)) < FEWEST_REPEATS // 2:
            continue
        drawn = np.array([np.average(pair.first.bins.current, weights=pair.first.bins.count) for pair in last])
        design = np.column_stack([np.ones(len(last)), ways, drawn])
        if np.linalg.cond(design / np.maximum(np.abs(design).max(axis=0), 1e-12)) > ALIKE:
            design = design[:, :2]
        matters = max(CHANGE * (fit.noise_floor or 0.0), SEEN * float(np.sqrt(np.mean(drawn**2))))
        change, dof = np.array([pair.more for pair in last]), len(last) - design.shape[1]
        fitted = least_squares(design, change)
        sizes, variance = fitted.values, float(np.sum((change - design @ fitted.values) ** 2)) / max(dof, 1)
        errors = np.sqrt(np.maximum(variance * np.sum(fitted.half**2, axis=1), 1e-300))
        moved = np.abs(sizes) * np.sqrt(np.mean(design**2, axis=0))
        for n, (unit, factor, goes, cause) in enumerate(KINDS[: len(sizes)]):
            if two_sided(sizes[n] / errors[n], dof) >= CHANCE or moved[n] <= matters:
                continue
            facts = {"change": factor * abs(float(sizes[n])), "error": factor * float(errors[n]), "runs": len(last)}
            more = {"unit": unit, "sign": "more" if sizes[n] > 0 else "less", "goes": goes, "cause": cause}
            yield _note("repeats-differ", Where(joint=fit.joint), **facts, **more)


def of_gears(fitted: Fit, robot: Robot) -> Iterator[Note]:
    """Loads that the recipe's gears (`coupling`) pass to motors of other joints, where the model leaves them out."""
    # Power is the same on either side: what motors carry of the joints' loads, by joint and motor.
    share = np.linalg.inv(robot.shaft_speeds)
    modelled = {(term.joint, term.shape.get("on")) for term in fitted.model.effects}
    passed, parallel = [], []
    for joint, motor in itertools.product(range(1, robot.n_joints + 1), sorted(row.joint for row in fitted.rows)):
        part, is_modelled = float(share[joint - 1, motor - 1]), (joint, float(motor)) in modelled
        if joint <= motor or abs(part) < SMALLEST_PART or is_modelled or load_refusal(robot, joint) is not None:
            continue
        passed.append(
            f"motor {motor} carries {number(part, 2)} of joint {joint}'s load (--add coupling@{joint}:on={motor})"
        )
        if joint == motor + 1 and math.hypot(*robot.joint(joint).frame[:2, 2]) < 1e-6:
            parallel.append(
                f"; axes {motor} and {joint} are parallel, so no log tells this from gain_ratio.{motor}.{joint}, of"
                f" which what is found is {number(1.0 + part, 3)} times the ratio of the motors' gains"
            )
    if passed:
        yield _note("load-through-gears", passed="; ".join(passed), beside="".join(parallel))


def of_lengths(fitted: Fit) -> Iterator[Note]:
    """The length of the recipe that motion contradicts most, with those that would mend it nearly as well."""
    tests = sorted(length_tests(fitted), key=lambda test: -test.statistic)
    sure = [
        test
        for test in tests
        if abs(test.more) > STEP  # no recipe knows a length better
        and two_sided(test.more / max(test.error, 1e-12), test.dof) * len(tests) < CONTRADICTED
    ]
    for test in sure[:1] if tests[:1] == sure[:1] else ():
        length = getattr(fitted.model.robot.joint(test.joint), test.name)
        rivals = [f"{r.name} of joint {r.joint}" for r in sure[1:] if r.statistic > 0.5 * test.statistic]
        fits = f"{number(length + test.more)} ± {number(test.error, 2)} m would fit"
        beside = f" (or another {listed(rivals)})" if rivals else ""
        yield _note("length-wrong", Where(joint=test.joint), name=test.name, length=length, fits=fits, beside=beside)


def of_ratios(values: Sequence[Value], robot: Robot) -> Iterator[Note]:
    """Ratios of neighbours alike in kind that come out as none: whatever the links beyond ask must be felt."""
    for value in values:
        inner, outer = value.joint or 0, (value.joint or 0) + 1
        if value.name != f"gain_ratio.{inner}.{outer}" or value.ci95 is None:
            continue
        is_alike = robot.joint(inner).is_revolute == robot.joint(outer).is_revolute
        if is_alike and value.ci95[0] < 0.0 < value.ci95[1] and max(map(abs, value.ci95)) < NO_RATIO:
            size = f"{number(value.value or 0.0, 2)} ± {number(value.std_error or 0.0, 2)}"
            yield _note("ratio-none", Where(joint=inner), name=value.name, size=size, outer=outer)


def of_signs(values: Sequence[Value], of_speed: Collection[int | None] = ()) -> Iterator[Note]:
    """Gain ratios and inertias whose sign is surely not that by which the motors count their friction, and viscous
    terms, but at joints `of_speed`, of the sign opposite to their Coulomb friction.
    """
    certain = {value.name: value for value in values if value.value is not None and value.std_error and value.ci95}
    sizes = {value.name: value.value or 0.0 for value in values}
    ways: dict[int | None, float] = {}
    for value in certain.values():
        back = certain.get(value.name.replace(".plus", ".minus"))
        if value.name.startswith("coulomb") and value.name.endswith(".plus") and back and value.ci95 and back.ci95:
            surely = value.ci95[0] > back.ci95[1] or back.ci95[0] > value.ci95[1]
            ways[value.joint] = math.copysign(float(surely), (value.value or 0.0) - (back.value or 0.0))
    for value in certain.values():
        size, error, joint = value.value or 0.0, value.std_error or 0.0, value.joint or 0
        where, shown = Where(joint=joint), f"{number(size)} ± {number(error, 2)} {value.unit}"
        if value.name == f"gain_ratio.{joint}.{joint + 1}":
            pair = ways.get(joint, 0.0) * ways.get(joint + 1, 0.0)
            sign, same = ("negative", "the same sign") if pair > 0 else ("positive", "opposite signs")
            if size * pair < -SURELY * error * abs(pair):
                yield _note("sign-odd", where, name=value.name, sign=sign, size=size, same=same)
        if value.name.startswith("torque_constant") and size * ways.get(joint, 0.0) < -SURELY * error:
            yield _note("sign-odd, load", where, name=value.name, size=shown)
        if value.name.startswith(("inertia.j", "rotor.j")) and size * ways.get(joint, 0.0) < -NEGATIVE * error:
            yield _note("sign-odd, inertia", where, size=shown)
        friction = sizes.get(f"coulomb.j{joint}.plus", 0.0) - sizes.get(f"coulomb.j{joint}.minus", 0.0)
        is_sure = value.ci95 is not None and not value.ci95[0] <= 0.0 <= value.ci95[1]
        if value.name.startswith("viscous") and joint not in of_speed and friction * size < 0.0 and is_sure:
            way = "forward" if value.name.endswith("plus") else "backward"
            yield _note("friction-falls-with-speed", where, way=way, slope=shown)
