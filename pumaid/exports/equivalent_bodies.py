"""Torque constants, and links whose weight and inertia then ask of every joint what the model asks."""

import itertools
import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag
from scipy.stats import f as fisher

from pumaid.errors import ModelError, Where
from pumaid.exports.formulas import Formulas, base_places
from pumaid.exports.possible_bodies import possible
from pumaid.maths import Floats
from pumaid.model import minimal
from pumaid.rigid_body import PARAMETERS, asked, of_bodies, regrouping, whole
from pumaid.robot import Robot, turn_of_z
from pumaid.simulation.virtual_robot import carried_moment, link_of
from pumaid.trajectory import accelerations, highest_speeds

#: Least mass of a link, as a share of the mass whose weight at 0.3 m is the arm's largest load.
LIGHTEST = 0.02
#: m; the centre of mass of a link lies this far from its axis, or as far as the next joint, where its mass is free.
REACH = 0.15
#: Share of what a slide carries, less the links beyond, that the next link before those may have at most.
CARRIED = 0.5
#: kg/m3 of the ball whose moment of inertia stands in for the link's.
DENSITY = 2700.0
#: Random states in which the loads of the bodies are held against the model's, with this seed.
POSTURES, SEED = 200, 0
#: A distance from what is possible that noise exceeds with a smaller chance than this has another reason.
BY_CHANCE = 1e-3
#: What is said of a slide of which Coulomb friction has taken up the weight.
UNTOLD = "joint {}: its load is part of its Coulomb friction and cannot be told as a mass"
#: Share of a joint's load below which a difference is rounding.
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False, slots=True)
class Bodies:
    """A chain of rigid bodies in frames of the recipe, its torque constants, its friction, and how it is mounted.

    `parameters` are as in `rigid_body.PARAMETERS`; where the model has no inertia, their moments are fictitious, of
    balls of aluminium, and rotors have none. `friction` and `damping` are means of both directions, never negative.
    `mount` turns axes of the base into those of a world in which gravity is along -z. `remarks` are for the user.
    """

    parameters: Floats  # (J, 11)
    torques: Floats  # (J,) N m/A or N/A
    friction: Floats  # (J,) N m or N
    damping: Floats  # (J,) N m s/rad or N s/m
    mount: Floats  # (3, 3)
    remarks: tuple[str, ...]


def bodies(formulas: Formulas, given: Mapping[int, float] | None) -> Bodies:
    """Bodies with the model's loads, by the torque constants of some joints (from 1), N m/A or N/A, none zero.

    A link's first moment, lengths taken out again, fixes mass times centre of mass; the mass is chosen so that the
    centre lies on the link, and such that what a slide carries is what its own load says. A model with inertia then
    moves masses, centres and moments (`_with_inertia`). Where torque constants contradict the identified ratios, each
    joint's own link keeps its load in its own joint and the rest is reported.
    ModelError [torque-constants]: a slide carries less than nothing, or less than a slide beyond it.

    Source
    ------
    S.-K. Lin, eq. (13)-(15), solved for m_i c_i.
    """
    robot = formulas.robot
    torques, ratios, remarks = known_constants(formulas, given)
    remarks += _assume(torques, ratios, formulas)
    wanted = formulas.moments * torques[:, None]
    carried, hidden = _carried(formulas, torques)
    masses, centres = _links(robot, wanted, carried=carried)
    parameters = _balls(masses, centres, (3.0 * masses / (4.0 * np.pi * DENSITY)) ** (1.0 / 3.0))
    if formulas.is_dynamic:
        parameters, message, weighs = _with_inertia(formulas, torques, _balls(masses, centres, REACH), carried=carried)
        remarks.append(message)
        hidden = hidden if weighs else [UNTOLD.format(joint) for joint in minimal(robot).embodied]
    friction, damping, cut = friction_torques(formulas, torques)
    g = np.array(robot.gravity, dtype=float)
    remarks += hidden
    for i in range(len(torques) - 1):
        ratio, stated = ratios[i, i + 1], torques[i + 1] / torques[i]
        if ratio != 0.0 and abs(stated - ratio) > ROUNDING * abs(ratio):
            way = " (of the other sign)" if stated * ratio < 0.0 else ""
            remarks.append(
                f"torque constants of joints {i + 1} and {i + 2} make eta{i + 1}/eta{i + 2} = {stated:.4g}{way}, the"
                f" logs say {ratio:.4g}"
            )
    remarks += [*_off(formulas, torques, parameters), *cut]
    return Bodies(
        parameters=parameters,
        torques=torques,
        friction=friction,
        damping=damping,
        mount=turn_of_z(-g).T if g.any() else np.eye(3),
        remarks=tuple(remarks),
    )


def _balls(masses: Floats, centres: Floats, radius: Floats | float) -> Floats:
    tensors = np.outer(0.4 * masses * np.square(radius), [part[0] == part[1] for part in PARAMETERS[4:10]])
    return of_bodies(masses, centres, tensors)


def _with_inertia(formulas: Formulas, torques: Floats, balls: Floats, *, carried: Floats) -> tuple[Floats, str, bool]:
    """(J, 11) parameters of possible links near `balls` (J, 11) that have the model's base parameters, or of those that
    are the fewest standard errors off; what is to be said; and whether slides weigh what `_carried` says of them.
    """
    links, parts = base_places(formulas.robot)
    guess, covariance = balls.copy(), _errors(formulas, torques)
    guess[:, 10] = np.where(formulas.robot.is_revolute, REACH**2, 1.0) * balls[:, 0]
    sums, wanted = _conditions(formulas, torques, carried)
    hidden = len(wanted) - len(links)
    parameters, off = possible(guess, sums, wanted, covariance=block_diag(covariance, np.zeros((hidden, hidden))))
    weighs = off is None or hidden == 0
    if not weighs:
        sums, wanted = sums[: len(links)], wanted[: len(links)]
        parameters, off = possible(guess, sums, wanted, covariance=covariance)
    if off is None:
        message = (
            "the data determine sums of the links' inertial parameters: of all possible links with these sums, those"
        )
        return parameters, f"{message} nearest to balls of {2.0 * REACH:g} m are written", weighs
    errors, runs = np.sqrt(np.diag(covariance)), max(fit.runs for fit in formulas.estimate.joints)
    moved = np.abs(sums @ parameters.ravel() - wanted) / np.where(errors > 0.0, errors, np.inf)
    link, part = (places[np.argmax(moved)] for places in (links, parts))
    message = (
        f"no possible links have the model's inertial parameters: the nearest are written, {off:.3g} standard errors"
        f" away, most of it in {PARAMETERS[part]} of link {link + 1} ({moved.max():.2g})"
    )
    if fisher.sf(off**2 / len(wanted), len(wanted), runs) < BY_CHANCE:
        message += "; noise alone does not do that: see torque constants, lengths and missing effects"
    return parameters, message, weighs


def _conditions(formulas: Formulas, torques: Floats, carried: Floats) -> tuple[Floats, Floats]:
    """(P, 11 J) sums of parameters of links that loads depend on, and their values (P,) by the model.

    Behind the base parameters come weights, N, of slides of which Coulomb friction has taken them up, where what these
    carry is known.
    """
    robot, (links, parts) = formulas.robot, base_places(formulas.robot)
    base, still = np.zeros_like(formulas.bodies), np.zeros((robot.n_joints, 1))
    base[links, parts] = (formulas.bodies * torques[:, None])[links, parts]
    sums, constant = regrouping(robot)
    weight = -carried * (robot.rotations(still.T)[0, :, :, 2] @ np.array(robot.gravity, dtype=float))
    beside = (weight - asked(robot, base, (still, still, still))[:, 0])[~robot.is_revolute]
    hidden = np.isin(np.flatnonzero(~robot.is_revolute) + 1, minimal(robot).embodied) & np.isfinite(beside)
    return np.vstack([sums, constant[hidden]]), np.append(base[links, parts], beside[hidden])


def _carried(formulas: Formulas, torques: Floats) -> tuple[Floats, list[str]]:
    robot, said = formulas.robot, []
    out = np.full(robot.n_joints, np.nan)
    structure = minimal(robot)
    z = robot.rotations(np.zeros((1, robot.n_joints)))[0, :, :, 2]
    lacking = {lack.name for lack in formulas.undetermined}
    last = 0.0
    for joint in reversed([joint.number for joint in robot.joints if not joint.is_revolute]):
        i, mass = joint - 1, formulas.moments[joint - 1, 0] * torques[joint - 1]
        if joint in structure.embodied:
            mass = -0.5 * formulas.coulomb[i].sum() * torques[i] / float(z[i] @ np.array(robot.gravity))
            if mass <= last:
                said.append(UNTOLD.format(joint))
                continue
            said.append(
                f"joint {joint}: its load is part of its Coulomb friction; the mean of both directions, a mass of"
                f" {mass:.4g} kg, is written as its weight"
            )
        elif f"gravity.l{joint}.mass" in structure.absent or (f"gravity.l{joint}.mass" in lacking and mass <= last):
            continue
        elif mass <= last:
            beyond = f", and a slide beyond it carries {last:.4g} kg" if last else ""
            raise ModelError(
                "torque-constants",
                f"joint {joint} would carry {mass:.4g} kg{beyond}: no masses weigh that",
                Where(joint=joint),
                "check the sign of its torque constant, or write a form without masses (c, python, json, matlab)",
            )
        out[i] = last = mass
    return out, said


def _links(robot: Robot, wanted: Floats, *, carried: Floats) -> tuple[Floats, Floats]:
    n, absent = robot.n_joints, minimal(robot).absent
    unfelt = [f"gravity.l{joint.number}.x" in absent for joint in robot.joints]
    turns = robot.is_revolute
    largest = float(np.abs(wanted[turns]).max(initial=0.0)) / 0.3
    least = LIGHTEST * (max(largest, float(np.nanmax(carried, initial=0.0))) or 1.0)
    masses, centres = np.zeros(n), np.zeros((n, 3))
    k = np.zeros(3)  # the constant first moment about the joint beyond, in the frame beyond
    for i in reversed(range(n)):
        rest, step = np.zeros(3), 0.0
        if i < n - 1:
            rest = carried_moment(robot, i, masses.sum(), k=k)
            step = float(np.linalg.norm(link_of(robot, i)))
        need, outer = wanted[i] - rest[:2], masses.sum()
        limits = carried[:i][np.isfinite(carried[:i])]  # of the slides before it, the last of which counts
        heaviest = CARRIED * (limits[-1] - outer) if limits.size else np.inf
        if turns[i] and not unfelt[i]:
            masses[i] = min(max(least, float(np.hypot(*need)) / max(REACH, step)), heaviest)
            centres[i, :2] = need / masses[i]
        else:
            masses[i] = min(least, heaviest) if turns[i] or np.isnan(carried[i]) else carried[i] - outer
        k = masses[i] * centres[i] + rest
    return masses, centres


def _errors(formulas: Formulas, torques: Floats) -> Floats:
    """(P, P) covariance of base parameters, each in its own link: the model's, which comes of few runs and so misses
    most directions, with as many runs as parameters of one that has its standard errors and the correlations that
    random motions would leave; and what the data do not tell, of any plausible size.

    Source: O. Ledoit and M. Wolf, J. Multivariate Analysis 88 (2004) 365-411, for such means, here with another target.
    """
    robot, (links, parts), fits = formulas.robot, base_places(formulas.robot), formulas.estimate.joints
    places = links * len(PARAMETERS) + parts
    noise = torques * [fit.rmse or 1.0 for fit in fits]
    table = [rows / size for rows, size in zip(whole(robot).rows(*_motion(formulas)), noise, strict=True)]
    matrix = np.hstack([np.pad(rows, ((len(table[0]) - len(rows), 0), (0, 0))) for rows in table])[places]
    expected = np.linalg.inv(np.corrcoef(matrix))
    measured, blind = formulas.covariance()
    measured, blind = measured * np.outer(torques[links], torques[links]), torques[links][:, None] * blind
    scale = np.sqrt(np.diag(measured) / np.diag(expected))
    runs = max(fit.runs for fit in fits)
    expected = expected * np.outer(scale, scale)
    return np.asarray((runs * measured + len(links) * expected) / (runs + len(links)) + blind @ blind.T)


def _motion(formulas: Formulas) -> tuple[Floats, Floats, Floats]:
    """(J, N) random positions, velocities and accelerations, the latter zero where the model has no inertia."""
    robot, rng = formulas.robot, np.random.default_rng(SEED)
    limits = np.where(robot.is_revolute, np.pi, 0.5), highest_speeds(robot), accelerations(robot)
    position, *rates = (rng.uniform(-1.0, 1.0, (robot.n_joints, POSTURES)) * limit[:, None] for limit in limits)
    velocity, acceleration = (part * formulas.is_dynamic for part in rates)
    return position, velocity, acceleration


def _off(formulas: Formulas, torques: Floats, parameters: Floats) -> Iterator[str]:
    robot, motion = formulas.robot, _motion(formulas)
    position, velocity, acceleration = (part.T for part in motion)
    wanted = formulas.weight(position) * torques
    if formulas.is_dynamic:
        wanted += formulas.inertia(position, velocity, acceleration) * torques
    off = asked(robot, parameters, motion).T - wanted
    hidden = np.array(minimal(robot).embodied, dtype=int) - 1
    off[:, hidden] -= off[:, hidden].mean(axis=0)
    weight = float(parameters[:, 0].sum() * np.linalg.norm(robot.gravity))
    scale = max(float(np.abs(wanted).max()), REACH * weight)
    sizes, loads = (np.sqrt(np.mean(values**2, axis=0)) for values in (off, wanted))
    for joint, size, load in zip(robot.joints, sizes, loads, strict=True):
        if size > ROUNDING * scale:
            unit, share = "N m" if joint.is_revolute else "N", f" ({100.0 * size / load:.2g} %)" if load else ""
            yield (
                f"joint {joint.number}: the bodies ask {size:.3g} {unit} RMS more or less than the model, whose load is"
                f" {load:.3g} {unit} RMS there{share}"
            )


def read_constants(text: str, joints: int) -> dict[int, float]:
    """Joint (from 1) -> N m/A, or N/A of a slide, from ``k1,k2,...`` of all joints or ``2=31.5,...`` of some of them.

    A ModelError [torque-constants] says that it is neither, or not of this arm, or that a constant is zero.
    """
    words, constants = [word.rpartition("=") for word in text.split(",")], dict[int, float]()
    with suppress(ValueError):
        constants = {
            int(joint) if is_named else place: float(value)
            for place, (joint, is_named, value) in enumerate(words, start=1)
        }
    is_complete = len(constants) == len(words) and ("=" in text or len(words) == joints)
    are_numbers = all(math.isfinite(value) and value != 0.0 for value in constants.values())
    if not (is_complete and are_numbers and set(constants) <= set(range(1, joints + 1))):
        raise ModelError(
            "torque-constants",
            f"{text!r} is not one torque constant a joint, none of them zero, for {joints} joints",
            Where(field="--torque-constants"),
            "write as many numbers as the arm has joints (k1,k2,...), or JOINT=NUMBER,... for some of them",
        )
    return constants


def known_constants(formulas: Formulas, given: Mapping[int, float] | None = None) -> tuple[Floats, Floats, list[str]]:
    """(J,) torque constants, NaN where none is known; (J, J) ratios of gains that tie them, 0 where none; and remarks.

    Known are those `given` by joint (from 1), else those that known loads showed, else, of logs in N m, 1; and those
    that identified ratios of gains tie to one of them.
    """
    estimate, n, remarks, ratios = formulas.estimate, formulas.robot.n_joints, list[str](), formulas.ratios.copy()
    loaded = {
        value.joint or 0: value.value
        for value in estimate.values
        if value.name.startswith("torque_constant.") and value.value is not None
    }
    in_torque = range(1, n + 1) if formulas.robot.log.units.get("current") == "Nm" else ()
    constants = given or loaded or dict.fromkeys(in_torque, 1.0)
    for value in sorted(
        [value for value in estimate.values if value.name.startswith("gain_ratio.")],
        key=lambda value: value.value is not None,
    ):
        inner, outer = map(int, value.name.split(".")[1:])
        has_no_sign = value.ci95 is not None and value.ci95[0] <= 0.0 <= value.ci95[1]
        if value.value is None or has_no_sign:
            ratios[:inner, outer - 1 :] = 0.0
        else:
            ratios[inner - 1, outer - 1] = value.value
        remarks += [f"joints {inner} and {outer}: not even the sign of their ratio of gains is told"] * has_no_sign
    out = np.array([constants.get(joint) or np.nan for joint in range(1, n + 1)])
    _spread(out, ratios)
    follows = len(constants) < np.isfinite(out).sum()
    remarks += ["torque constants that were not given follow from the identified ratios of gains"] if follows else []
    return out, ratios, remarks


def _assume(constants: Floats, ratios: Floats, formulas: Formulas) -> Iterator[str]:
    """Fill in unknown constants, and say so: the largest of each group is 1, so signed that friction opposes motion."""
    while np.isnan(constants).any():
        group, is_open = np.full(len(constants), np.nan), np.isnan(constants)
        group[np.argmax(is_open)] = 1.0
        _spread(group, ratios)
        tied = np.isfinite(group) & is_open
        opposing = np.nansum(np.where(tied, np.sign(group), 0.0) * (formulas.coulomb[:, 0] - formulas.coulomb[:, 1]))
        constants[tied] = group[tied] / np.abs(group[tied]).max() * (-1.0 if opposing < 0.0 else 1.0)
        rest = ", the others follow from the identified ratios of gains" if tied.sum() > 1 else ""
        numbers = ", ".join(str(place + 1) for place in np.flatnonzero(tied))
        yield (
            f"no torque constant of joint{'s' if tied.sum() > 1 else ''} {numbers} was given: the largest there is"
            f" taken as 1 N m/A (N/A){rest}; torques and masses there are right but for one factor"
            " (--torque-constants JOINT=K)"
        )


def friction_torques(formulas: Formulas, torques: Floats) -> tuple[Floats, Floats, list[str]]:
    """(J,) Coulomb friction, N m or N, and (J,) damping, N m s/rad or N s/m, means of both directions; and remarks.

    Neither is negative: what would push along the motion is 0, and told.
    """
    dry = 0.5 * (formulas.coulomb[:, 0] - formulas.coulomb[:, 1]) * torques
    rise = formulas.viscous.mean(axis=1) * torques
    remarks = [
        f"{what} of joint {place + 1} comes out as {sizes[place]:.3g} with this constant, along motion: 0 is written"
        for sizes, what in ((dry, "Coulomb friction"), (rise, "damping"))
        for place in np.flatnonzero(sizes < 0.0)
    ]
    return np.maximum(dry, 0.0), np.maximum(rise, 0.0), remarks


def _spread(constants: Floats, ratios: Floats) -> None:
    """Fill in, outward from joints that are known, those that a ratio ties to one of them; nearest first."""
    n = len(constants)
    pairs = sorted(itertools.permutations(range(n), 2), key=lambda pair: abs(pair[0] - pair[1]))
    for _ in range(n):
        for source, joint in pairs:
            ratio = ratios[min(source, joint), max(source, joint)]
            if np.isfinite(constants[source]) and np.isnan(constants[joint]) and ratio != 0.0:
                constants[joint] = constants[source] * (ratio if joint > source else 1.0 / ratio)
