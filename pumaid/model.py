"""The model of the currents: which parameters an arm has, its names and columns, and what it says of loads."""

import copy
import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from weakref import WeakKeyDictionary

import numpy as np

from pumaid.dataset import Run
from pumaid.effect_spec import Column, EffectTerm, terms_of
from pumaid.effects import Loads, Samples, Scope, catalogue
from pumaid.effects.formula import swept
from pumaid.estimate import Estimate
from pumaid.joint_bins import JointBins
from pumaid.maths import Flags, Floats, Recursion, independent
from pumaid.rigid_body import base_parameters, of_body, of_payload, weight_name
from pumaid.robot import Robot

#: Name of the columns of what a rigid body has beside weight.
INERTIA = "inertia"
#: Name of the column of known loads, by which gains are known in A/(N m), or A/N.
KNOWN_LOAD = "known_load"
#: Units of a rotor's inertia, of masses and of first moments, of a joint that slides and of one that turns.
UNITS = {
    "rotor": ("A s2/m", "A s2/rad"),
    "m": ("A s2/m", "A s2/m2"),
    **dict.fromkeys(("mx", "my", "mz"), ("A s2", "A s2/m")),
}
#: Share of the most that a known load asks of any joint, above which a joint feels it.
FELT = 0.01
#: Random postures a joint: several times the most columns that a row can have (2 n + 4 for n = 10 joints).
POSTURES = 120


@dataclass(frozen=True, slots=True)
class Structure:
    """The minimal parameters of an arm.

    `absent` maps names of gravity parameters that no motion can show, `redundant` pairs (i, i+1) of joints (from 1)
    whose ratio of gains none can, to why; `embodied` are prismatic joints whose constant load hides in their Coulomb
    terms (eq. 32, 33).
    """

    absent: dict[str, str] = field(default_factory=dict)
    embodied: tuple[int, ...] = ()
    redundant: dict[tuple[int, int], str] = field(default_factory=dict)


def gravity_links(robot: Robot) -> dict[str, int]:
    """Name of each parameter of gravity -> number of its link."""
    return {
        f"gravity.l{joint.number}.{parameter.name}": joint.number
        for joint in robot.joints
        for parameter in catalogue()["gravity"].parameters(robot, joint.number)
    }


def in_motion(robot: Robot) -> Structure:
    """The parameters of gravity that no motion of all joints shows; ratios of gains are left to the data."""
    shown, weightless = {column.name for column in body_columns(robot)}, minimal(robot).absent
    other = "no motion shows the weight of link {} ({}) apart from that of other links"
    named = {name: other.format(link, robot.joint(link).name) for name, link in gravity_links(robot).items()}
    return Structure({name: weightless.get(name, why) for name, why in named.items() if name not in shown})


@lru_cache(maxsize=16)  # one command makes many models of one arm
def minimal(robot: Robot, *, seed: int = 0) -> Structure:
    """Derive the minimal parameters from random postures (by `seed`) and random parameters of the arm.

    A friction term absorbs what a gravity column shares with it. Source: S.-K. Lin, Theorem 3 and Corollary 4, found
    here by rank instead of by their case rules.
    """
    rng = np.random.default_rng(seed)
    n, names, gravity = robot.n_joints, [*gravity_links(robot)], catalogue()["gravity"]
    owners = np.array([*gravity_links(robot).values()]) - 1
    recursion = Recursion(owners, n)
    truth = rng.uniform(0.5, 2.0, len(owners)) * rng.choice([-1.0, 1.0], len(owners))
    absent: dict[str, str] = {}
    embodied: list[int] = []
    for row in reversed(range(n)):
        samples = Samples(row + 1, rng.uniform(-np.pi, np.pi, (POSTURES, n)), np.zeros((POSTURES, n)))
        parts = [gravity.columns(robot, samples, number=link) for link in range(1, n + 1)]
        rows = np.hstack([part * (link >= row) for link, part in enumerate(parts)])
        sign = rng.choice([-1.0, 1.0], POSTURES)
        matrix, owned, roots = recursion.design(row, rows)
        friction = np.column_stack([sign > 0, sign < 0]).astype(float)
        # Columns that are zero but for rounding (twists of 90 degrees are not exact) are zero.
        matrix[:, np.linalg.norm(matrix, axis=0) <= 1e-9 * np.sqrt(POSTURES)] = 0.0
        sure = independent(np.hstack([friction, matrix]), first=2)[2:]
        constant = bool(rows[:, owned].any()) and not sure[: len(owned)].any()
        if constant and not robot.joint(row + 1).is_revolute:
            embodied.append(row + 1)
        recursion.values[owned] = np.where(sure[: len(owned)], truth[owned], 0.0)
        absent |= {names[k]: _why_absent(robot, row + 1, constant) for k in owned[~sure[: len(owned)]].tolist()}
        for root, is_sure in zip(roots, sure[len(owned) :], strict=True):
            if is_sure:
                recursion.gains.parent[root], recursion.gains.edge[root] = row, float(rng.uniform(0.5, 2.0))
    redundant = {
        (inner.number, outer.number): f"joint {inner.number} ({inner.name}) does not feel the weight that joint"
        f" {outer.number} ({outer.name}) carries, in any posture"
        for inner, outer in itertools.pairwise(robot.joints)
        if not np.isfinite(recursion.gains.ratio(inner.number - 1, outer.number - 1))
    }
    return Structure(absent, tuple(sorted(embodied)), redundant)


def _why_absent(robot: Robot, link: int, constant: bool) -> str:
    name = f"joint {link} ({robot.joint(link).name})"
    if robot.joint(link).is_revolute:
        return f"{name} turns about the direction of gravity in every posture and so carries no weight"
    if constant:
        return (
            f"the angle between {name} and gravity never changes, so its constant load cannot be told from Coulomb"
            f" friction and is part of coulomb.j{link}.plus and .minus"
        )
    return f"{name} stays perpendicular to gravity in every posture and so carries no weight"


class Model:
    """The arm's base model (gravity, Coulomb, viscous), and the columns of `effects`, shapes filled in, last.

    Where joints accelerate (`is_dynamic`) it has the rigid body's base parameters, weight among them. Where the last
    link carried known loads, the gain of the joint `scaled` (from 1; else 0) in A/(N m), or A/N, is a parameter.
    """

    def __init__(
        self, robot: Robot, effects: Sequence[EffectTerm] = (), *, is_dynamic: bool = False, scaled: int = 0
    ) -> None:
        self.robot, self.is_dynamic, self.scaled = robot, is_dynamic, scaled
        self.structure: Structure = in_motion(robot) if is_dynamic else minimal(robot)
        body = body_columns(robot) if is_dynamic else []
        chosen = sorted(
            (effect for effect in catalogue().values() if effect.base),
            key=lambda effect: (effect.scope is not Scope.LINK, effect.name),
        )
        terms = [EffectTerm(effect, number) for effect in chosen for number in range(1, robot.n_joints + 1)]
        parts = [part for term in terms for part in term.parts(robot, None) if part.name not in self.structure.absent]
        paper = [replace(part, span=math.inf) for part in parts]
        # What a joint further outward feels of known loads has a gain of its own, for it is next to nothing.
        gains = [
            Column(f"{KNOWN_LOAD}.{'j' if n > scaled else 'l'}{n}", f"eta{n}", "A/N", n, KNOWN_LOAD, scope=scope)
            for n, scope in enumerate([Scope.LINK] + [Scope.JOINT] * (robot.n_joints - scaled), start=scaled)
        ]
        self._base = (*(column for column in body if column.effect == INERTIA), *paper, *(gains if scaled else []))
        names = [column.name for column in self._base]
        #: Columns of the rigid body's base parameters, in their order.
        self.inertial = np.array([names.index(column.name) for column in body], dtype=np.int64)
        self._base_designs = WeakKeyDictionary[JointBins, Floats]()  # shared by models with other effects
        self._choose(effects)

    def _choose(self, effects: Sequence[EffectTerm]) -> None:
        parts = [term.parts(self.robot, place) for place, term in enumerate(effects)]
        self.effects = tuple(effects)
        self.columns: tuple[Column, ...] = (*self._base, *itertools.chain.from_iterable(parts))
        self.names = tuple(column.name for column in self.columns)
        self.owners = np.array([column.owner for column in self.columns], dtype=int)
        self.is_scaled = np.array([column.scope is Scope.LINK for column in self.columns], dtype=bool)
        self.is_weight = np.array([column.effect == "gravity" for column in self.columns], dtype=bool)
        self.is_geared = np.array([not name.startswith("rotor.") for name in self.names], dtype=bool)
        kinds = [None if column.place is None else self.effects[column.place].effect for column in self.columns]
        self.is_wave = np.array([kind is not None and kind.periodic is not None for kind in kinds], dtype=bool)
        self.is_load = self.is_weight | self.is_scaled & [column.effect == KNOWN_LOAD for column in self.columns]

    def with_effects(self, effects: Sequence[EffectTerm]) -> "Model":
        """The same arm with these effects instead of its own."""
        other = copy.copy(self)
        other._choose(effects)
        return other

    @classmethod
    def of_runs(cls, robot: Robot, runs: Iterable[Run], effects: Sequence[EffectTerm] = ()) -> "Model":
        """The model that `runs` ask for: with inertia where a run accelerates."""
        chosen = list(runs)
        scaled = outermost_loaded(robot, chosen)
        return cls(robot, effects, is_dynamic=any(run.accelerates for run in chosen), scaled=scaled)

    @classmethod
    def of_estimate(cls, robot: Robot, estimate: Estimate) -> "Model":
        """The model that `estimate` is a fit of, with the derivatives by shapes that it fitted."""
        values = dict(zip(estimate.names, estimate.solution, strict=True))
        effects = []
        for term in terms_of(estimate.effects):
            parts = list(replace(term, fitted=tuple(term.shape)).parts(robot, 0))
            fitted = tuple(part.shape for part in parts if part.shape is not None and part.name in values)
            sizes = tuple(float(values[part.name]) for part in parts if part.shape is None)
            effects.append(replace(term, fitted=fitted, sizes=sizes))
        is_dynamic = any(name.startswith((f"{INERTIA}.l", "rotor.")) for name in estimate.names)
        scaled = next((int(name.rsplit("l", 1)[1]) for name in estimate.names if f"{KNOWN_LOAD}.l" in name), 0)
        return cls(robot, effects, is_dynamic=is_dynamic, scaled=scaled)

    def regressor(self, samples: Samples) -> Floats:
        """(M, p) A in joint `samples.joint` per unit of every parameter, those of links in units of their own gain.

        Samples have loads where an effect needs them.
        """
        return np.hstack([self.base(samples), self.beyond(samples)])

    def design(self, bins: JointBins, gravity: Loads | None = None) -> Floats:
        """(N, p) means of the regressor over the bins of one joint.

        `gravity` is what a fitted model says of gravity at the bins' nodes, where an effect needs it.
        """
        out, base = np.zeros((len(bins), len(self.columns)), order="F"), self._base_means(bins).T
        acting = np.flatnonzero(base.any(axis=1))  # a quarter of them, by whole columns
        out.T[acting] = base[acting]
        places = np.array([-1 if column.place is None else column.place for column in self.columns])
        for place, term in enumerate(self.effects):
            if term.touches(bins.joint):
                out[:, places == place] = self._means(bins, term, gravity)
        return out

    def at_nodes(self, bins: JointBins, gravity: Loads | None = None) -> Floats:
        """(k N, p) the same at the nodes of bins; in the paper's model nothing accelerates at constant speed."""
        base = self._base_at_nodes(bins)
        return np.hstack([base, self.beyond(replace(bins.nodes[0], loads=gravity))]) if self.effects else base

    def _base_means(self, bins: JointBins) -> Floats:
        """(N, b) means of the paper's model over bins, kept as long as these are."""
        if bins not in self._base_designs:
            self._base_designs[bins] = np.asfortranarray(bins.averaged(self._base_at_nodes(bins)))
        return self._base_designs[bins]

    def _means(self, bins: JointBins, term: EffectTerm, gravity: Loads | None) -> Floats:
        """(N, k) means of an effect's columns over bins; where neither loads nor shapes change them kept with these."""
        key = term.effect, term.joint
        if key in bins.kept:
            return bins.kept[key]
        means = bins.averaged(term.columns(self.robot, replace(bins.nodes[0], loads=gravity)))
        if not (term.needs_loads or term.shape):
            bins.kept[key] = means
        return means

    def _base_at_nodes(self, bins: JointBins) -> Floats:
        nodes, k, turns = bins.nodes[0], bins.nodes[1].shape[1], self.robot.joint(bins.joint).is_revolute
        moves = np.repeat((bins.accelerates & ~bins.is_block)[bins.run], k)
        rows, out = np.zeros(0, np.int64), np.zeros((len(nodes), len(self._base)))
        if bins.rigid_body is not None and self.is_dynamic:
            rows = np.flatnonzero(np.repeat(np.isfinite(bins.rigid_body[:, 0]), k))
        if len(rows) < len(nodes):
            out = swept(nodes, k * bins.lengths, lambda knots: self.base(knots, (Scope.LINK,)), turns=turns)
        self.base(replace(nodes, acceleration=np.where(moves, nodes.acceleration, 0.0)), (Scope.JOINT,), out)
        if bins.rigid_body is not None and len(rows):
            # In blocks of any motion what the rigid body asks was averaged with the current.
            out[np.ix_(rows, self.inertial)] = bins.rigid_body[rows // k]
        for payload in {run.payload for run in bins.runs if self.scaled and run.payload}:
            rows = np.repeat([run.payload == payload for run in bins.runs], k * bins.lengths)
            place = max(bins.joint, self.scaled) - self.robot.n_joints - 1
            out[rows, place] = nodes.bodies[rows] @ of_payload(payload)[:10]
        return out

    def known_load(self, bins: JointBins, weights: Floats, *, at_nodes: bool = False) -> Floats:
        """(N,) A that known loads ask in some bins, or (k N,) at their nodes; `weights` are of every parameter."""
        is_known = np.array([column.effect == KNOWN_LOAD for column in self._base])
        base = self._base_at_nodes(bins) if at_nodes else self._base_means(bins)
        return np.asarray(base[:, is_known] @ weights[: len(is_known)][is_known])

    def base(
        self, samples: Samples, scopes: Sequence[Scope] = (Scope.LINK, Scope.JOINT), out: Floats | None = None
    ) -> Floats:
        """(M, b) of the paper's model, with what the rigid body asks where the moving joint accelerates alone; what is
        not of `scopes` stays as it is in `out`, or zero.
        """
        out, columns = np.zeros((len(samples), len(self._base))) if out is None else out, enumerate(self._base)
        for (name, owner), group in itertools.groupby(columns, lambda item: (item[1].effect, item[1].owner)):
            effect = catalogue().get(name)
            if (
                effect
                and effect.base
                and effect.scope in scopes
                and (owner == samples.joint or (effect.scope is Scope.LINK and owner > samples.joint))
            ):
                names = [parameter.name for parameter in effect.parameters(self.robot, owner)]
                values = effect.columns(self.robot, samples, number=owner)
                for index, column in group:
                    out[:, index] = values[:, names.index(column.name.rsplit(".", 1)[1])]
        if self.is_dynamic and Scope.JOINT in scopes and samples.acceleration.any():
            pull = np.zeros((self.robot.n_joints, len(samples)))
            pull[samples.joint - 1] = samples.acceleration
            weightless = replace(self.robot, gravity=(0.0, 0.0, 0.0))
            body = replace(base_parameters(self.robot), robot=weightless, constants=None)
            rows = body.row(samples.joint, (samples.position.T, np.zeros_like(pull), pull))
            out[:, self.inertial[-len(rows) :]] += rows.T
        return out

    def moments(self, solution: Floats) -> Floats:
        """(J, 2) first moment of each link, in its own gain: k_x and k_y, or mass and nothing of what slides."""
        out, numbers = np.zeros((self.robot.n_joints, 2)), np.flatnonzero(self.is_weight)
        out[self.owners[numbers] - 1, [self.names[n].endswith(".y") * 1 for n in numbers]] = solution[numbers]
        return out

    def rubs(self, solution: Floats) -> Floats:
        """(2, J, 2) Coulomb (A) and viscous friction (A s/rad or A s/m) of each joint, forward and backward."""
        joints, ways = range(1, self.robot.n_joints + 1), ("plus", "minus")
        names = itertools.product(("coulomb", "viscous"), joints, ways)
        places = [self.names.index(f"{effect}.j{joint}.{way}") for effect, joint, way in names]
        return solution[places].reshape(2, -1, 2)

    def friction(self, samples: Samples, solution: Floats) -> Floats:
        """(M,) A that the moving joint draws by the paper's model beside its load; `solution` (p,) are parameters."""
        base = self.base(replace(samples, acceleration=np.zeros(len(samples))), (Scope.JOINT,))
        return np.asarray(base @ solution[: base.shape[1]])

    def beyond(self, samples: Samples) -> Floats:
        """(M, e) the columns of chosen effects, in the order in which they come after the paper's model."""
        places = np.array([column.place for column in self.columns[len(self._base) :]], dtype=int)
        out = np.zeros((len(samples), len(places)))
        if not len(samples.bodies):
            still = 0.0 * samples.position.T
            samples = replace(samples, bodies=of_body(self.robot, samples.joint, (samples.position.T, still, still)))
        for place, term in enumerate(self.effects):
            if term.touches(samples.joint):
                out[:, places == place] = term.columns(self.robot, samples)
        return out

    def factors(self, scales: Floats, joint: int) -> Floats:
        """(p,) what multiplies each parameter in joint `joint`: ratios (J, J) for links, NaN where unknown; else 1."""
        return np.where(self.is_scaled, scales[joint - 1][self.owners - 1], 1.0)

    def needs_loads(self) -> bool:
        """Whether a chosen effect is made from the fitted loads."""
        return any(term.needs_loads for term in self.effects)

    def predict(self, estimate: Estimate, samples: Samples) -> Floats:
        """(M,) current (A) of joint `samples.joint` by the fitted model; unknown ratios count as zero."""
        factors = np.nan_to_num(self.factors(estimate.scales, samples.joint))
        return np.asarray(self.regressor(samples) @ (factors * estimate.solution))


def outermost_loaded(robot: Robot, runs: Sequence[Run]) -> int:
    """The outermost joint (from 1) that felt the weight of known loads in its runs, or the last; 0 without loads."""
    peaks = np.zeros(robot.n_joints)
    for run, payload in ((run, run.payload) for run in runs if run.payload):
        position = np.nan_to_num(run.posture)[:, None] + np.zeros((1, len(run.bins)))
        position[run.joint - 1] = run.bins.position[:, run.joint - 1]
        torque = of_body(robot, run.joint, (position, 0.0 * position, 0.0 * position)) @ of_payload(payload)[:10]
        peaks[run.joint - 1] = max(peaks[run.joint - 1], float(np.abs(torque).max()))
    felt = np.flatnonzero(peaks > FELT * peaks.max()) if peaks.any() else [robot.n_joints - 1]
    return int(felt[-1]) + 1 if any(run.payload for run in runs) else 0


def body_columns(robot: Robot) -> list[Column]:
    """The base parameters of the rigid body as parameters of a model; of what is weight, too, the name counts."""
    columns = []
    for link, part in base_parameters(robot).names:
        turns, symbol = robot.joint(link).is_revolute, f"I{link}{part.removeprefix('rotor')}"
        effect, name = INERTIA, f"rotor.j{link}" if part == "rotor" else f"{INERTIA}.l{link}.{part}"
        weight = weight_name(robot, link, part)
        if weight:
            effect, name = "gravity", f"gravity.l{link}.{weight}"
        unit = UNITS.get(part, ("A s2 m", "A s2/rad"))[turns]
        columns.append(Column(name, symbol, unit, link, effect, scope=Scope.LINK))
    return columns


def loads_at(model: Model, bins: JointBins, *, solution: Floats, scales: Floats, at_nodes: bool = False) -> Loads:
    """`loads` at bins, or at their nodes, those in blocks of any motion with the joint's inertial load.

    In other runs all joints but the moving one stand, so that a few instants say what they are at all.
    """
    samples, times = (bins.nodes[0], bins.nodes[1].shape[1]) if at_nodes else (bins.samples, 1)
    n, turns = model.robot.n_joints, model.robot.joint(samples.joint).is_revolute

    def table(knots: Samples) -> Floats:
        knot = loads(model, knots, solution=solution, scales=scales)
        return np.column_stack([knot.moving, knot.across**2, knot.tilts, knot.by_joint, knot.slopes])

    values = swept(samples, times * bins.lengths, table, turns=turns)
    load, across, tilts, elsewhere, slopes = np.split(values, [1, 2, 4, 4 + n], axis=1)
    moving, weights = load[:, 0], np.nan_to_num(model.factors(scales, bins.joint)) * solution
    rate = slopes[:, bins.joint - 1] * samples.velocity[:, bins.joint - 1]
    if bins.rigid_body is not None and model.is_dynamic:
        # The gear does not bear the rotor's inertia, which is in the motor's current.
        torque, whole = (bins.rigid_body @ part[model.inertial] for part in (weights * model.is_geared, weights))
        of_blocks = np.repeat([torque, bins.rates(whole)], times, axis=1)
        moving, rate = np.where(np.isfinite(of_blocks), of_blocks, [moving, rate])
    if model.scaled:
        moving = moving + model.known_load(bins, weights, at_nodes=at_nodes)
    drawn, rubs = moving + model.friction(samples, solution), model.rubs(solution)
    return Loads(moving, elsewhere, slopes, tilts, np.sqrt(np.maximum(across[:, 0], 0.0)), drawn, rate, rubs)


def loads(model: Model, samples: Samples, *, solution: Floats, scales: Floats) -> Loads:
    """Gravity's currents, their slopes and the base model's prediction at M instants of one moving joint.

    With h the regrouped first moment of all links from joint i outward (base axes, in joint i's gain), gravity's moment
    about joint i is g x h and its current z_i . (g x h); a slope follows from which of z_i, h and g turn. `solution`
    (p,) are parameters and `scales` (J, J) ratios of gains as in `Estimate`; an unknown ratio counts as zero in the
    moving joint's own load and makes other joints' loads NaN.

    Source: S.-K. Lin, eq. (11), (25), in the directions of the axes.
    """
    robot, number = model.robot, samples.joint
    i, g = number - 1, np.asarray(robot.gravity, dtype=float)
    across_axes, z, levers = (_axes if len(samples) <= MOST_KEPT else _axes.__wrapped__)(robot, samples)
    turns, constants = robot.is_revolute, model.moments(solution)
    weights, heavy = np.where(turns, 0.0, constants[:, 0]), np.asarray(constants.any(axis=1))
    moments = across_axes[0] * constants[:, :1] + across_axes[1] * constants[:, 1:]
    if not turns.all():
        moments = np.where(turns[:, None], moments, (robot.displacements(samples.position) * weights)[..., None] * z)
    elsewhere = np.einsum("mkp,mkp->mk", levers, np.where(heavy[None, :], np.triu(scales), 0.0) @ moments)
    elsewhere[:, ~turns] = (-(z @ g) * weights)[:, ~turns]
    ratios = np.nan_to_num(scales[i])
    parts = moments * ratios[None, :, None]
    parts[:, :i] = 0.0
    load = np.einsum("mk,mk->m", levers[:, i], parts.sum(axis=1)) if turns[i] else elsewhere[:, i]
    slopes = _slopes(i, z=z, levers=levers, parts=parts, weights=weights * ratios, g=g, turns=turns)
    turned = [np.cross(g, axis) for axis in np.eye(3)[:2]]
    felt = np.einsum("mjk,j->mk", moments, felt_ratios(heavy, scales, i))
    if turns[i]:
        tilts = np.column_stack([np.einsum("mk,mk->m", np.cross(z[:, i], way), felt) for way in turned])
        moment = np.cross(g, felt)
        across = np.linalg.norm(moment - z[:, i] * np.einsum("mk,mk->m", z[:, i], moment)[:, None], axis=1)
    else:
        tilts = np.column_stack([-(z[:, i] @ way) * weights[i] for way in turned])
        across = np.zeros(len(samples))
    drawn, rate = load + model.friction(samples, solution), slopes[:, i] * samples.velocity[:, i]
    return Loads(load, elsewhere, slopes, tilts, across, drawn, rate, model.rubs(solution))


#: Instants beyond which their axes are not kept: all that are take 0.2 GB on six joints.
MOST_KEPT = 16_000


@lru_cache(maxsize=24)  # the same in every fit to some bins
def _axes(robot: Robot, samples: Samples) -> tuple[Floats, Floats, Floats]:
    """(2, M, J, 3) x and y axes of the links, (M, J, 3) z axes, and these across gravity."""
    frames = robot.rotations(samples.position)
    z = frames[..., 2].copy()
    return np.array([frames[..., 0], frames[..., 1]]), z, np.cross(z, robot.gravity)


def felt_ratios(heavy: Flags, scales: Floats, i: int) -> Floats:
    """(J,) ratios by which joint i (from 0) counts the links' moments: its own where they are known, else those of the
    next joint outward whose are (a moment across an upright axis is never told in its own gain)."""
    links = np.arange(len(scales))
    for k in range(i, len(scales)):
        beyond = heavy & (links >= k)
        if np.all(np.isfinite(scales[k][beyond])):
            return np.where(beyond, scales[k], 0.0)
    return np.zeros(len(scales))


def _slopes(i: int, *, z: Floats, levers: Floats, parts: Floats, weights: Floats, g: Floats, turns: Flags) -> Floats:
    """(M, J) derivative of joint i's load by each joint's position (i from 0)."""
    links = np.arange(z.shape[1])
    if not turns[i]:
        return np.where(turns & (links < i), -np.cross(z, z[:, i : i + 1]) @ g * weights[i], 0.0)
    # As far as joint i all of it turns, as if gravity turned the other way.
    whole = np.cross(parts.sum(axis=1), z[:, i])
    beyond = np.cross(z, np.cumsum(parts[:, ::-1], axis=1)[:, ::-1])
    inner, outer = levers @ whole[:, :, None], np.where(turns[:, None], beyond, z * weights[:, None])
    turned = np.where(turns, -inner[:, :, 0], 0.0)
    return np.where(links <= i, turned, (outer @ levers[:, i, :, None])[:, :, 0])
