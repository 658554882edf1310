"""What else a recipe or logs could mean: joints turned round or in another order, another mounting, other loads."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np

from pumaid.effects.base import Scope, load_refusal
from pumaid.errors import LogError, Note, Where, listed
from pumaid.estimation.evaluate import JointPrediction
from pumaid.estimation.fit import Fit
from pumaid.estimation.link_lengths import mean_motion
from pumaid.io.forms import yaml_text
from pumaid.joint_bins import JointBins
from pumaid.maths import Counts, Floats
from pumaid.preprocessing.joint_signals import UNIT_MATCH, other_units
from pumaid.rigid_body import PARAMETERS, RigidBody, base_parameters
from pumaid.robot import Robot
from pumaid.units import number

#: Bins of a joint that are looked at. Share of a missed joint's error to which turning a joint must bring it, and
#: anything else, since missing physics halves under many a change; and multiples that a joint's error may rise to.
MOST_BINS, FALLS, FALLS_FAR, RISES, RISES_FAR = 800, 0.5, 0.3, 1.05, 1.25
#: Bins that are enough for a search of a direction or scale.
SEARCHED = 200
#: Share of a joint's error from which a setup is taken to leave it as it is.
SAME = 0.9
#: Share of a missed joint's error to which currents without weight must bring it: inertia shows weight faintly.
FALLS_WEIGHTLESS = 0.7
#: Multiple of the least error of a missed joint under any setup that one which explains it may leave.
AT_LEAST = 1.5
#: Kinds of setups.
TURNED, ORDERED, SWAPPED, LOADED = "position-reversed", "order-wrong", "joints-swapped", "loads-differ"
MOUNTED, WEIGHTLESS, SCALED = "gravity-wrong", "weight-missing", "scale-wrong"
#: What a note on each says and what to do; and its few words beside another.
TEXTS = {
    TURNED: "positions of joint {joint} seem to be counted the other way{beside}: turned round, {falls}. Check"
    " log.signs.position and the signs in the DH table",
    ORDERED: "columns of the logs seem to be in another order{beside}: with joints {order} in the columns of 1, 2 and"
    " so on, {falls}. Give each joint its own column in the recipe's log block",
    SWAPPED: "currents of joints {swapped} seem to have changed places{beside}: put right, {falls}. Give each joint its"
    " own current in the recipe's log block",
    MOUNTED: "the arm seems to be mounted otherwise than the recipe says{beside}: with gravity along {gravity} of the"
    " base{opposite}, {falls}. Check gravity, and alpha and zero of the first joint",
    WEIGHTLESS: "gravity seems to be taken out of these currents already{beside}: without weight, {falls}, though"
    " inertia shows that links have mass. Log raw currents",
    SCALED: "positions seem to be in another unit than the recipe says{beside}: {scale} times as large, {falls}",
    LOADED: "the last link seems to carry another load in some files{beside}: with a load a file, {falls}. Identify"
    " the files apart; or, where you know the loads, say so in the recipe (kg, and m in the last link's frame), which"
    " gives torque constants too:\n{files}",
}
BESIDE = {TURNED: "a joint turned round", ORDERED: "another order of joints", LOADED: "another load in some files"}
BESIDE |= {MOUNTED: "another mounting", WEIGHTLESS: "gravity taken out", SCALED: "another unit of positions"}
BESIDE |= {SWAPPED: "two currents changed places"}
#: Share of a joint's current below which it shows no weight.
NO_WEIGHT = 0.02
#: rad; a base tilted by less is the effect `tilt`. Most directions of gravity that are tried, and the first step (rad).
TILTED, DIRECTIONS, STEP = 0.15, 60, 0.4
#: Logarithms of the scales of positions between which so many are tried, turns for radians among them, and of the least
#: change that an encoder's range explains: a spring bends positions by less.
SCALES, TRIED, RESCALED = (-np.log(7.0), np.log(7.0)), 18, np.log(1.1)
#: Share of the error to which another unit of positions surely brings it, which no spring does.
SURELY = 0.1
#: Another size of a count of position, and the multiple of a joint's error by which currents tell it from the recipe's.
OTHER_COUNT, DEPENDS = 1.25, 1.03
#: Number of a body's parameters that weight is told by; gravity (m/s2) along no axis, under which all of them count.
WEIGHT, OBLIQUE = 4, (3.0, 5.0, 8.0)


@dataclass(frozen=True, slots=True)
class Setup:
    """Another meaning of recipe and logs: its `kind`, and what it is of joints, in words or numbers.

    Positions are multiplied by `factors` (J,); `order` (J,) says which logged joint (from 0) is joint 1, 2 ..., and
    `currents` (J,) whose logged current is theirs; `gravity` is in axes of the base (m/s2); with `by_file` the last
    link carries another load in each file.
    """

    kind: str
    factors: tuple[float, ...]
    order: tuple[int, ...]
    currents: tuple[int, ...]
    gravity: tuple[float, float, float]
    by_file: bool = False


@dataclass(frozen=True, slots=True)
class Explanation:
    """A setup that explains a fit's misses: at joint `missed` (from 1) the error left (A), `now` and `then`."""

    setup: Setup
    missed: int
    now: float
    then: float


@dataclass(frozen=True, eq=False, slots=True)
class _Chosen:
    """Some bins of a joint (from 1): motion (J, N) each, the joint's own columns (N, k), current (N,), file of each."""

    joint: int
    motion: tuple[Floats, Floats, Floats]
    beside: Floats
    current: Floats
    weight: Floats
    file: Counts


class Setups:
    """Regressions of each joint's current by itself, at `most` bins, under any setup, of a fit that misses joints."""

    def __init__(self, fitted: Fit, missed: Sequence[int], *, most: int = MOST_BINS) -> None:
        self.fitted, self.robot, self.missed = fitted, fitted.model.robot, missed
        n, self.moves = self.robot.n_joints, any(row.bins.accelerates.any() for row in fitted.joints)
        self.body = _body(self.robot, self.moves)
        self.cells = tuple(_chosen(fitted, row.bins.joint, most) for row in fitted.joints)
        self.now = Setup("as it is", (1.0,) * n, tuple(range(n)), tuple(range(n)), self.robot.gravity)
        self.before = self.left(self.now)
        #: Files beyond the first, and runs a joint: four parameters a file cost as much as Schwarz's criterion says.
        self.files = max(int(cells.file.max(initial=0)) for cells in self.cells)
        self.runs = float(np.mean([len(row.bins.runs) for row in fitted.joints]))

    def left(self, setup: Setup) -> dict[int, float]:
        """RMSE (A) of each joint's bins by a regression on all parameters of links and on its own columns."""
        return {cells.joint: _rest(cells, self._columns(cells, setup)) for cells in self.cells}

    def _columns(self, cells: _Chosen, setup: Setup) -> Floats:
        place, order = setup.currents.index(cells.joint - 1), list(setup.order)
        factors = np.array(setup.factors)[:, None]
        q, v, a = ((factors * part)[order] for part in cells.motion)
        body = replace(self.body, robot=replace(self.robot, gravity=setup.gravity))
        columns = body.row(place + 1, (q, v, a)).T
        if setup.by_file:
            tip = columns[:, -len(body.counted[-1]) :][:, :WEIGHT]
            columns = np.hstack([columns, *(tip * (cells.file == k)[:, None] for k in np.unique(cells.file)[1:])])
        if order[place] == cells.joint - 1:
            return np.hstack([cells.beside, columns])
        speed = cells.motion[1][order[place]]
        return np.column_stack([np.ones_like(speed), np.sign(speed), speed, columns])

    def explanations(self, is_odd: bool = False) -> list[Explanation]:
        """Setups under which a missed joint's error falls far and no joint's rises; the best first.

        Where offsets are odd, a unit of positions need not explain as much.
        """
        thin = Setups(self.fitted, self.missed, most=SEARCHED)
        setups = (*self._reread(), *thin._mounted(), *thin._scaled())
        errors, out = ((setup, self.left(setup)) for setup in setups), list[tuple[bool, float, Explanation]]()
        # What raises a joint's error far explains no other joint.
        fair = [(x, after) for x, after in errors if all(after[k] <= RISES_FAR * y for k, y in self.before.items())]
        least = {joint: min((after[joint] for _, after in fair), default=0.0) for joint in self.before}
        bent = {x.joint: _rest(x, np.hstack([self._columns(x, self.now), _bent(x)])) for x in self.cells}
        for setup, after in fair:
            ratios = {joint: after[joint] / self.before[joint] for joint in after if self.before[joint] > 0.0}
            judged = [joint for joint in self.missed if joint in ratios]
            best = min(judged, key=lambda joint: ratios[joint], default=0)
            is_reread, raises = setup.kind in (TURNED, SWAPPED), max(ratios.values(), default=1.0) >= RISES
            is_best = is_reread or all(after[k] <= AT_LEAST * least[k] for k in judged)
            # Another mounting that raises no joint's error is no physics that one of them lacks.
            is_mounted = setup.kind == MOUNTED and not raises and len(ratios) > 1
            is_lax = is_reread or is_mounted or (is_odd and bool(self.units(setup)))
            falls = FALLS_WEIGHTLESS if setup.kind == WEIGHTLESS else FALLS if is_lax else FALLS_FAR
            # A joint whose error a setup leaves as it is says nothing of it: other physics may be missing there.
            is_best &= float(np.prod([after[k] / max(bent[k], 1e-12) for k in judged if ratios[k] < SAME])) < RISES
            if best and ratios[best] < falls and is_best:
                cost = self._cost(after) + setup.by_file * 2.0 * self.files * np.log(self.runs) / self.runs
                out.append((is_reread and raises, cost, Explanation(setup, best, self.before[best], after[best])))
        # What raises a joint's error a little explains nothing alone, but may be another reading of what does.
        return [x for _, _, x in sorted(out, key=lambda item: item[:2])] if not all(item[0] for item in out) else []

    def units(self, setup: Setup) -> list[str]:
        """Words for the recipe by which positions are as much larger."""
        scale = max(setup.factors, key=lambda factor: abs(factor - 1.0))
        return other_units(self.robot, "position", "rad", fits=lambda size: abs(scale / size - 1.0) < UNIT_MATCH)

    def _cost(self, after: dict[int, float]) -> float:
        return float(np.mean([np.log(max(after[k], 1e-12) / max(self.before[k], 1e-12)) for k in after]))

    def _reread(self) -> Iterator[Setup]:
        """A joint turned round; joints, or currents alone, in other orders; another load in each file."""
        n, joints = self.robot.n_joints, self.robot.joints
        for factors in (1.0 - 2.0 * np.eye(n)).tolist():
            yield replace(self.now, kind=TURNED, factors=tuple(factors))
        by_name = sorted(range(n), key=lambda k: joints[k].name)
        orders = [
            tuple(by_name.index(k) for k in range(n)),
            tuple(reversed(range(n))),
            *(tuple(b if k == a else a if k == b else k for k in range(n)) for a, b in combinations(range(n), 2)),
        ]
        for order in dict.fromkeys(orders):
            if order != self.now.order and all(joints[k].kind == joints[place].kind for place, k in enumerate(order)):
                yield replace(self.now, kind=ORDERED, order=order, currents=order)
            if order in orders[2:]:
                yield replace(self.now, kind=SWAPPED, currents=order)
        if self.files:
            yield replace(self.now, kind=LOADED, by_file=True)

    def _mounted(self) -> Iterator[Setup]:
        from scipy import optimize

        size = float(np.linalg.norm(self.robot.gravity))

        def along(down: Floats) -> Setup:
            x, y, z = (size * down / np.linalg.norm(down)).tolist()
            return replace(self.now, kind=MOUNTED, gravity=(x, y, z))

        # What a joint is asked for is affine in gravity.
        ends = [replace(self.now, gravity=end) for end in ((0.0, 0.0, 0.0), *(size * np.eye(3)).tolist())]
        columns = [[self._columns(cells, end) for end in ends] for cells in self.cells]

        def cost(down: Floats) -> float:
            x, y, z = down / np.linalg.norm(down)
            shares = (1.0 - x - y - z, x, y, z)
            return self._cost(
                {x.joint: _rest(x, np.tensordot(shares, part, 1)) for x, part in zip(self.cells, columns, strict=True)}
            )

        near = min(np.vstack([np.eye(3), -np.eye(3)] if self.moves else [np.eye(3)]), key=cost)
        start = min(near, np.array(self.robot.gravity) / size, key=cost)
        options = {"maxfev": DIRECTIONS, "initial_simplex": start + STEP * np.vstack([np.zeros(3), np.eye(3)])}
        best = optimize.minimize(cost, start, method="Nelder-Mead", options=options)
        # Where an axis of the base does as well as any direction, it is that.
        mounted = along(near if cost(near) < best.fun + 0.1 else best.x)
        cosine = float(np.dot(mounted.gravity, self.robot.gravity)) / size**2
        if np.arccos(min(cosine if self.moves else abs(cosine), 1.0)) > TILTED:
            yield mounted
        if self.moves:
            yield replace(self.now, kind=WEIGHTLESS, gravity=(0.0, 0.0, 0.0))

    def _scaled(self) -> Iterator[Setup]:
        from scipy import optimize

        def times(logarithm: Floats) -> Setup:
            factors = np.where(self.robot.is_revolute, np.exp(logarithm), 1.0)
            return replace(self.now, kind=SCALED, factors=tuple(factors.tolist()))

        best = optimize.brute(lambda logarithm: self._cost(self.left(times(logarithm))), [SCALES], Ns=TRIED)
        if abs(best[0]) > RESCALED:
            yield times(best)


def of_setups(fitted: Fit, missed: Sequence[int], *, is_odd: bool = False) -> list[LogError | Note]:
    """A note on the other meaning of recipe and logs that explains best what a fit misses at joints, if any.

    A refusal where that is another unit of positions, without doubt, as where offsets `is_odd`.
    """
    setups = Setups(fitted, missed) if missed else None
    candidates = setups.explanations(is_odd) if setups is not None else []
    if setups is None or not candidates:
        return []
    best, setup = candidates[0], candidates[0].setup
    turned, rivals = [k for k, factor in enumerate(setup.factors, start=1) if factor < 0.0], list[str]()
    for rival in (item for item in candidates[1:] if item.then < 1.5 * best.then):
        rivals += [f"joint {k}" for k, factor in enumerate(rival.setup.factors, start=1) if factor < 0.0]
        rivals += [BESIDE[rival.setup.kind]] if rival.setup.kind != TURNED else []
    joint = turned[0] if turned else None
    scale = max(setup.factors, key=lambda factor: abs(factor - 1.0))
    text = TEXTS[setup.kind].format(
        joint=joint,
        beside=f" (or {listed(rivals, separator=', or ')})" if rivals else "",
        falls=f"the error of joint {best.missed}, fitted alone, falls from {number(best.now)} to {number(best.then)} A",
        order=", ".join(str(k + 1) for k in np.argsort(setup.order)),
        swapped=" and ".join(str(k + 1) for k, logged in enumerate(setup.currents) if logged != k),
        gravity=[round(part, 2) + 0.0 for part in setup.gravity],
        opposite="" if setups.moves else " or the other way",
        scale=number(scale, 3),
        files=_loads_block(run.origin for row in fitted.joints for run in row.bins.runs),
    )
    if setup.kind == SCALED:
        size = number(setups.robot.log.conversion("position", 1).scale * scale, 3)
        words = (
            " or ".join(setups.units(setup))
            or f"position: {{column: ..., scale: {size}}} (a motor's turns, parts of a turn?)"
        )
        mend = f"put {words} into the recipe's log block"
        if is_odd or best.then < SURELY * best.now:
            return [LogError(setup.kind, text, mend=mend)]
        text = f"{text}: {mend}; a spring may look like it"
    return [Note(setup.kind, text, Where(joint=joint))]


def of_counts(fitted: Fit) -> list[Note]:
    """A note where the recipe says what a count of an encoder is, and no current of these motions depends on it."""
    log = fitted.model.robot.log
    if "position" not in log.conversions and log.units.get("position") != "tick":
        return []
    setups = Setups(fitted, (), most=SEARCHED)
    factors = tuple(np.where(setups.robot.is_revolute, OTHER_COUNT, 1.0).tolist())
    after = setups.left(replace(setups.now, factors=factors))
    if any(after[joint] > DEPENDS * before for joint, before in setups.before.items()):
        return []
    text = "what a count of position is stands in the recipe, and these currents would be explained as well by another:"
    return [Note("unit-shown", f"{text} viscous friction and inertia change with it. See the encoder's manual")]


def _loads_block(origins: Iterable[str]) -> str:
    """The recipe's lines on the loads of files, with masses where names of files tell them (``mass_200g.csv``)."""
    lines = []
    for name in sorted({Path(origin).name for origin in origins}):
        match = re.search(r"(\d+(?:\.\d+)?)_?(k?)g(?![A-Za-z])", name)
        mass = f"{float(match[1]) * (1.0 if match[2] else 1e-3):g}" if match else "KG"
        lines.append(f"  {yaml_text(name)}: {{payload: {{mass: {mass}, at: [X, Y, Z]}}}}")
    return "\n".join(["files:", *lines])


def of_weight(at_joints: Mapping[int, JointPrediction]) -> list[Note]:
    """A note on an arm with joints across gravity of which none bears weight."""
    shares = {}
    for joint, prediction in at_joints.items():
        is_told = {"gravity", f"gravity.l{joint}.x"} <= {*prediction.effects, *prediction.model.names}
        if is_told and load_refusal(prediction.model.robot, joint) is None:
            weight = prediction.parts[:, prediction.effects.index("gravity")]
            drawn = prediction.current_square[prediction.counted].sum() / prediction.samples[prediction.counted].sum()
            shares[joint] = float(np.sqrt(np.mean(weight**2) / max(drawn, np.finfo(float).tiny)))
    if not shares or max(shares.values()) >= NO_WEIGHT:
        return []
    text = f"no joint's current shows weight ({number(100.0 * max(shares.values()), 2)} % of it at most), which links"
    return [Note(WEIGHTLESS, f"{text} have: gravity seems to be taken out of these currents already. Log raw currents")]


def _body(robot: Robot, moves: bool) -> RigidBody:
    """Parameters that ask all that links can, under gravity of any direction: those of weight alone at rest."""
    counted = [{*numbers} for numbers in base_parameters(replace(robot, gravity=OBLIQUE)).counted]
    counted[-1] |= {*range(WEIGHT)}  # by which another load tells
    kinds = range(len(PARAMETERS) if moves else WEIGHT)
    return RigidBody(robot, tuple(tuple(k for k in kinds if k in numbers) for numbers in counted))


def _chosen(fitted: Fit, joint: int, most: int) -> _Chosen:
    row, model = fitted.by_bin[joint], fitted.model
    bins: JointBins = row.bins
    chosen = np.arange(0, len(bins), max(1, round(len(bins) / most)))
    position, velocity, pull = mean_motion(bins, chosen)
    accelerates = bins.accelerates[bins.run[chosen]]
    beyond = np.flatnonzero([column.scope is not Scope.LINK for column in model.columns])
    files = np.unique([run.origin for run in bins.runs], return_inverse=True)[1]
    beside, weight = row.bare[np.ix_(chosen, beyond)], np.sqrt(bins.count[chosen] / bins.count[chosen].sum())
    motion = position, velocity * accelerates, pull * accelerates
    return _Chosen(joint, motion, beside, bins.current[chosen], weight, files[bins.run[chosen]])


def _bent(cells: _Chosen) -> Floats:
    """(N, 7) what a spring, a counterbalance or a link that bends draws, which other setups may look like."""
    q = cells.motion[0][cells.joint - 1]
    return np.column_stack([q, *(wave(k * q) for k in (1, 2, 3) for wave in (np.cos, np.sin))])


def _rest(cells: _Chosen, columns: Floats) -> float:
    design = columns * cells.weight[:, None]
    size = np.linalg.norm(design, axis=0)
    is_there = size > 1e-9 * size.max(initial=0.0)
    design, wanted = design[:, is_there] / size[is_there], cells.current * cells.weight
    return float(np.linalg.norm(wanted - design @ np.linalg.lstsq(design, wanted, rcond=1e-6)[0]))
