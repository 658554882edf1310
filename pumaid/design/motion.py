"""Trajectories of all joints that tell most: the best of many random ones, improved while that helps.

What they tell is the information of the fit that `identify` makes of their blocks, on gravity, inertia, friction and
ratios of gains; the criterion is that of runs at constant speed (`pumaid.design.information`).
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np
from scipy.linalg import toeplitz

from pumaid.design.candidate_runs import home
from pumaid.design.collision import TOLERANCE, Collision
from pumaid.design.information import RATE, Criterion, Prior, median_errors, prior_robots, typical_sizes
from pumaid.design.plan import check_minutes, plan, with_forecast
from pumaid.errors import ModelError, Note, Where
from pumaid.estimate import Estimate
from pumaid.maths import Bilinear, Floats, Gains, pseudo_inverse
from pumaid.model import INERTIA, Model, body_columns, in_motion
from pumaid.preprocessing.binning import BLOCKS, LONGEST_BLOCK, SHORTEST_BLOCK
from pumaid.preprocessing.parallel_filter import SHORTEST_CELL, STICKING
from pumaid.rigid_body import TENSOR, base_parameters, base_values, of_bodies, of_payload
from pumaid.robot import Payload, Robot
from pumaid.simulation import Truth, draw
from pumaid.simulation.mujoco_engine import tensors
from pumaid.trajectory import (
    PART,
    QUICKEST_SLIDE,
    QUICKEST_TURN,
    REST,
    Plan,
    Trajectory,
    accelerations,
    highest_speeds,
    span,
)
from pumaid.units import number

#: s of a series' period, about; s that a trajectory lasts at least, and repeats.
PERIOD, LEAST, LEAST_REPEATS = 20.0, 24.0, 2
#: Hz of a series' highest harmonic, and knots in its period.
HIGHEST, KNOTS = 0.5, 10.0
#: Share of each limit that is used.
USED = 0.98
#: s of rest between two picks; picks of a round at most; share of the time that they are planned for.
PAUSE, MOST_PICKS, FILLED = 0.2, 20, 0.9
#: s between the positions that are held against what is forbidden: none goes farther from the line between two of them
#: than the tolerance of distances.
DENSE = 0.01
#: Shares of the room that a series takes, the first in which it is clear.
SHARES = (1.0, 0.7, 0.5, 0.3)
#: Random trajectories, and changes of the best that are tried after them; fall of the criterion that is one.
DRAWN, TRIED, FALL = 60, 240, 1e-4
#: First size of a change, and by what it grows where that helps and shrinks where not.
CHANGE, LARGER, SMALLER = 0.5, 1.5, 0.97
#: s between instants at which a forecast looks at a trajectory.
STEP = 0.05
#: Places that are tried for one that can be reached.
_TRIES = 20


def inertial_values(truth: Truth, payload: Payload | None = None) -> dict[str, float]:
    """Name -> value (A, SI) of the parameters of a rigid body that are not weight, of the arm that a prior robot is of.

    A robot that is known by constants in amperes alone has those of one drawn from the geometry.
    """
    arm = draw(truth.robot, truth.seed or 0)
    about = tensors(arm)[:, *np.transpose(list(TENSOR.values()))]
    parameters = of_bodies(arm.links.mass, arm.links.centre, about, rotors=arm.inertia / arm.gain)
    parameters[-1] += 0.0 if payload is None else of_payload(truth.robot.carried(payload))
    return {
        column.name: float(value * arm.gain[column.owner - 1])
        for column, value in zip(body_columns(arm.robot), base_values(arm.robot, parameters), strict=True)
        if column.effect == INERTIA
    }


class MotionInformation:
    """What trajectories tell each of G prior robots of one geometry.

    `names` (p,) are the parameters of the model of any motion, then ratios of neighbours' gains; `sizes` (p,) what is
    usual of each.
    """

    def __init__(self, prior: Prior, *, estimate: Estimate | None = None, payload: Payload | None = None) -> None:
        self.robots = prior.robots
        self.robot = robot = prior.robots[0].robot
        self._model, n = Model(robot, is_dynamic=True), robot.n_joints
        ratios = [f"gain_ratio.{i}.{i + 1}" for i in range(1, n)]
        self.names = (*self._model.names, *ratios)
        tables = [truth.parameters() | inertial_values(truth, payload) for truth in prior.robots]
        if estimate is not None:
            fitted = dict(zip(estimate.names, estimate.solution.tolist(), strict=True))
            tables = [table | {name: fitted[name] for name in table if fitted.get(name)} for table in tables]
        values = np.array([[table[name] for name in self.names] for table in tables])
        chain = Gains(n)
        chain.parent[1:] = range(n - 1)
        p = len(self._model.names)
        owners = self._model.owners - 1
        #: (G, J, p, P) derivatives of what each joint draws per unit of its regressors.
        self._turn = np.array(
            [
                [
                    Bilinear(np.full(p, j), np.eye(p), np.zeros(p), owners).jacobian(chain.with_ratios(v[p:]), v[:p])
                    for j in range(n)
                ]
                for v in values
            ]
        )
        kinds = {column.name: f"{column.effect} {column.unit}" for column in self._model.columns}
        self.sizes = np.array([*typical_sizes(tables, kinds | dict.fromkeys(ratios, "ratio")).values()])

    def of(self, made: Trajectory) -> Floats:
        """(G, p, p) information of all repeats of a trajectory: the inverse of the covariance that the fit has.

        The fit is weighted as if noise were white but for a level of each block; in truth levels last for `PART` s and
        begin anywhere, so that a part of them stays (the sandwich of least squares).
        """
        blocks = max(round(made.cycle / min(max(made.seconds / BLOCKS, SHORTEST_BLOCK), LONGEST_BLOCK)), 1)
        count = blocks * round(made.cycle / blocks / STEP)
        time = np.linspace(0.0, made.cycle, count, endpoint=False) + 0.5 * made.cycle / count
        position, velocity, acceleration = made.at(time)
        rows = base_parameters(self.robot).rows(position.T, velocity.T, acceleration.T)
        friction, noise = self.robot.shaft_velocity(velocity), self.robots[0].noise
        sizes = np.array([truth.noise.std for truth in self.robots])
        slides = np.abs(velocity) - 1.5 * SHORTEST_CELL * np.abs(acceleration) > STICKING
        phi, share = noise.correlation(RATE), noise.level_share
        white = (1.0 - share) * (1.0 + phi) / (1.0 - phi) / (made.cycle / count * RATE)
        slow = toeplitz(share * np.maximum(1.0 - time / PART, 0.0))
        inner, outer = (np.zeros((len(self.robots), len(self.names), len(self.names))) for _ in range(2))
        for j in range(self.robot.n_joints):
            v, names = (
                friction[:, j],
                [f"{kind}.j{j + 1}.{side}" for side in ("plus", "minus") for kind in ("coulomb", "viscous")],
            )
            rubs = np.column_stack([v > 0.0, np.maximum(v, 0.0), v < 0.0, np.minimum(v, 0.0)])
            columns = [*self._model.inertial[-len(rows[j]) :], *map(self._model.names.index, names)]
            design = np.where(slides[:, j, None], np.column_stack([rows[j].T, rubs]), 0.0)
            parts, ones = (part.reshape(blocks, count // blocks, -1) for part in (design, slides[:, j]))
            count_of = ones.sum(axis=1, keepdims=True)
            weighted = parts - ones * (share / (white + count_of * share)) * parts.sum(axis=1, keepdims=True)
            weighted = weighted.reshape(design.shape) / white
            turn = self._turn[:, j, columns] / sizes[:, j, None, None]
            both = design.T @ weighted, weighted.T @ (white * weighted + slow @ weighted)
            for total, gram in zip((inner, outer), both, strict=True):
                total += np.swapaxes(turn, 1, 2) @ gram @ turn
        return made.repeats * np.array([a @ pseudo_inverse(b)[0] @ a for a, b in zip(inner, outer, strict=True)])

    def errors(self, information: Floats) -> dict[str, float]:
        """Name -> predicted standard error: the median over prior robots; parameters that any of them hides are out."""
        return median_errors(self.names, information)


class Shapes:
    """What trajectories of an arm keep to.

    `low_high` (2, J) are the lowest and highest position that one may take, in the middle of which the arm is at home;
    `speeds` and `accelerations` (J,) are those that it has at most.
    """

    def __init__(self, robot: Robot, collision: Collision) -> None:
        self.collision, places = collision, home(robot).tolist()
        self.low_high = np.array([span(joint, at) for joint, at in zip(robot.joints, places, strict=True)]).T
        quickest = np.where(robot.is_revolute, QUICKEST_TURN, QUICKEST_SLIDE)
        self.speeds = USED * np.minimum(highest_speeds(robot), quickest)
        self.accelerations = USED * accelerations(robot)

    def clear(self, made: Trajectory) -> Trajectory | None:
        """It, where a round of it strikes nothing."""
        collision, dense = self.collision, np.linspace(0.0, made.cycle, int(made.cycle / DENSE) + 1)
        is_free = collision.is_free or collision.first_hit_along(replace(made, repeats=1).at(dense)[0]) is None
        return made if is_free else None


class Fourier(Shapes):
    """Series of every joint that begin and end a period at rest: rows of sines, of cosines, of centres and of shares.

    Source: J. Swevers et al., IEEE Trans. Robotics and Automation 13 (1997) 730-740.
    """

    kind = "fourier"

    def __init__(self, robot: Robot, collision: Collision, seconds: float) -> None:
        super().__init__(robot, collision)
        self.repeats = max(int(seconds / PERIOD), LEAST_REPEATS)
        self.period = seconds / self.repeats
        self.orders = np.arange(1, int(HIGHEST * self.period) + 1)[:, None]

    def drawn(self, rng: np.random.Generator) -> Floats:
        """A random one: (2 H + 2, J) for H harmonics."""
        n, h = len(self.speeds), len(self.orders)
        series = rng.normal(size=(2, h, n)) * self.orders ** -rng.uniform(0.0, 1.5)
        whole = np.vstack([*series, rng.random(n), np.ones(n)])
        for share in SHARES[1:]:
            if self.collision.is_free or self.trajectory(whole) is not None:
                break
            whole[-1] = share
        return whole

    def varied(self, rng: np.random.Generator, values: Floats, size: float) -> Floats:
        """Another near it, at one joint."""
        out, j = values.copy(), int(rng.integers(values.shape[1]))
        series = out[:-2, j]
        series += size * np.sqrt(np.mean(series**2)) * rng.normal(size=len(series))
        out[-2, j] = np.clip(out[-2, j] + size * rng.normal(), 0.0, 1.0)
        out[-1, j] = np.clip(out[-1, j] * np.exp(0.3 * size * rng.normal()), SHARES[-1], 1.0)
        return out

    def trajectory(self, values: Floats) -> Trajectory | None:
        """It, as large as the limits allow; None where it strikes something."""
        sines, cosines = np.split(values[:-2], 2)
        # At rest at the beginning: neither speed nor acceleration.
        sines = sines - self.orders * ((self.orders.T @ sines) / np.sum(self.orders**2))
        cosines = cosines - self.orders**2 * ((self.orders.T**2 @ cosines) / np.sum(self.orders**4))
        time = np.linspace(0.0, self.period, int(KNOTS * HIGHEST * self.period) + 1)
        w = 2.0 * np.pi / self.period * self.orders
        sine, cosine = np.sin(time[:, None] * w.T), np.cos(time[:, None] * w.T)
        q = sine @ sines + cosine @ cosines
        v, a = cosine @ (w * sines) - sine @ (w * cosines), -sine @ (w**2 * sines) - cosine @ (w**2 * cosines)
        made = Trajectory(time, q, v, a, self.repeats, self.kind)
        q_all, v_all, a_all = replace(made, repeats=1).at(np.linspace(0.0, self.period, 4 * len(time)))
        room = np.diff(self.low_high, axis=0)[0]
        factors = room / np.ptp(q_all, axis=0), self.speeds / _peak(v_all), self.accelerations / _peak(a_all)
        scale = USED * values[-1] * np.min(factors, axis=0)
        middle = scale * 0.5 * (q_all.max(axis=0) + q_all.min(axis=0))
        free = room - scale * np.ptp(q_all, axis=0)
        q = scale * q - middle + self.low_high.mean(axis=0) + (values[-2] - 0.5) * free
        v, a = scale * v, scale * a
        v[[0, -1]], a[[0, -1]] = 0.0, 0.0
        return self.clear(Trajectory(time, q, v, a, self.repeats, self.kind))


class Picks(Shapes):
    """Straight moves of least jerk from place to place and back to the first: (M, J) places as shares of the room."""

    kind = "picks"

    def __init__(self, robot: Robot, collision: Collision, seconds: float) -> None:
        super().__init__(robot, collision)
        rng = np.random.default_rng(0)
        usual = np.mean(self._lasting(rng.random((100, robot.n_joints)))) + PAUSE
        self.seconds, self.count = seconds, int(np.clip(FILLED * seconds / (LEAST_REPEATS * usual), 2, MOST_PICKS))

    def _lasting(self, values: Floats) -> Floats:
        # Of a move of least jerk the speed is 15/8, and the acceleration 10/sqrt(3), over way and time.
        way = np.abs(np.diff(values, axis=0)) * np.diff(self.low_high, axis=0)
        slow, gentle = 15.0 / 8.0 * way / self.speeds, np.sqrt(10.0 / np.sqrt(3.0) * way / self.accelerations)
        return np.asarray(np.maximum(slow, gentle).max(axis=1))

    def drawn(self, rng: np.random.Generator) -> Floats:
        """A random one; where things are forbidden each place can be reached from the one before."""
        low, high = self.low_high
        out = [rng.random(len(low))]
        for _ in range(_TRIES * self.count):
            place = rng.random(len(low))
            begin, end = (low + part * (high - low) for part in (out[-1], place))
            if self.collision.first_hit(begin, end) is None:
                out.append(place)
            if len(out) == self.count:
                break
        return np.array(out)

    def varied(self, rng: np.random.Generator, values: Floats, size: float) -> Floats:
        """Another, with one place moved, or another one."""
        out, k = values.copy(), int(rng.integers(len(values)))
        near = np.clip(out[k] + size * rng.normal(size=out.shape[1]), 0.0, 1.0)
        out[k] = near if rng.random() < 0.7 else rng.random(out.shape[1])
        return out

    def trajectory(self, values: Floats) -> Trajectory | None:
        """It, as fast as the limits allow; None where it strikes something, or two rounds take too long."""
        low, high = self.low_high
        places = low + np.vstack([values, values[:1]]) * (high - low)
        lasting = self._lasting(np.vstack([values, values[:1]]))
        repeats = int(self.seconds / np.sum(lasting + PAUSE))
        if repeats < LEAST_REPEATS:
            return None
        steps = np.column_stack([lasting, np.full(len(lasting), PAUSE)]).ravel()
        steps *= self.seconds / repeats / steps.sum()
        q = np.repeat(places, 2, axis=0)[:-1]
        q = np.vstack([q[0], q[2:], q[-1]])
        nothing = np.zeros_like(q)
        return self.clear(Trajectory(np.append(0.0, np.cumsum(steps)), q, nothing, nothing, repeats, self.kind))


#: Kind -> what draws such trajectories.
KINDS: dict[str, type[Fourier] | type[Picks]] = {"fourier": Fourier, "picks": Picks}


def _peak(values: Floats) -> Floats:
    return np.asarray(np.maximum(np.abs(values).max(axis=0), 1e-12))


def best_motion(
    kind: str,
    forecast: MotionInformation,
    *,
    collision: Collision,
    seconds: float,
    seed: int,
    tell: Callable[[str], None] = lambda _: None,
) -> tuple[Trajectory, Floats]:
    """A trajectory of some `seconds` that tells much, and its information.

    Raises
    ------
    ModelError [plan-unsafe]
        All random ones strike something.
    """
    rng, shapes = np.random.default_rng([seed, 5]), KINDS[kind](forecast.robot, collision, seconds)
    criterion = Criterion(forecast.sizes, np.ones(len(forecast.sizes), dtype=bool))
    best, values, worth = None, np.zeros(0), np.inf
    size = CHANGE
    for turn in range(DRAWN + TRIED):
        trial = shapes.drawn(rng) if turn < DRAWN else shapes.varied(rng, values, size)
        made = shapes.trajectory(trial)
        information = None if made is None else forecast.of(made)
        value = np.inf if information is None else float(criterion.value(information))
        size *= (LARGER if value < worth - FALL else SMALLER) if turn >= DRAWN else 1.0
        if made is not None and information is not None and value < worth - FALL:
            best, values, worth = (made, information), trial, value
            tell(f"{kind}: error {number(np.exp(worth), 3)}")
        if turn == DRAWN - 1 and best is not None:
            # What even the best of them leaves unknown counts no longer.
            counted = np.median(criterion.errors(best[1]), axis=0) <= forecast.sizes
            criterion = replace(criterion, counted=counted | (not counted.any()))
            worth = float(criterion.value(best[1]))
        if turn == DRAWN - 1 and best is None:
            raise ModelError(
                "plan-unsafe",
                f"all of {DRAWN} random {kind} trajectories strike something",
                mend="widen the limits, or correct the recipe's block safety",
            )
    assert best is not None
    return best


def plan_motion(
    robot: Robot,
    kind: str,
    *,
    minutes: float | None = None,
    prior: Estimate | None = None,
    payload: Payload | None = None,
    seed: int = 0,
    tell: Callable[[str], None] = lambda _: None,
) -> Plan:
    """Plan a trajectory of all joints of a `kind` of `KINDS`, with what it promises beside what others promise.

    It takes two minutes where `minutes` are not given. Other parameters are those of `pumaid.design.plan.plan`.

    Raises
    ------
    ModelError [plan-too-short], [plan-impossible], [plan-unsafe]
        Too few blocks of motion fit in; a number out of range; all that was tried strikes something.
    """
    minutes = 2.0 if minutes is None else minutes
    check_minutes(minutes)
    seconds = 60.0 * minutes - 2.0 * REST
    if seconds < LEAST:
        raise ModelError(
            "plan-too-short",
            f"{minutes:g} minutes are too short: a trajectory lasts for {LEAST:g} s at least",
            mend="give --minutes 0.5 or more",
        )
    looked = _Forecast(robot, prior=prior, payload=payload, seed=seed)
    made, errors = dict[str, Trajectory](), dict[str, dict[str, float]]()
    for name in KINDS:
        made[name], information = best_motion(
            name, looked.information, collision=Collision(robot, spare=TOLERANCE), seconds=seconds, seed=seed, tell=tell
        )
        errors[name] = looked.information.errors(information)
    tell("runs at constant speed, to compare")
    try:
        runs = plan(robot, minutes=minutes, prior=prior, payload=payload, seed=seed)
        errors["runs at constant speed"], why = runs.expected, ""
    except ModelError as error:
        why = f"; runs at constant speed promise nothing: {error.what}"
    shares = {name: looked.share(errors[kind], rival) for name, rival in errors.items() if name != kind}
    parts = [f"{share} times those of {name} (by {count} parameters)" for name, (share, count) in shares.items()]
    text = f"in {minutes:g} min this {kind} trajectory promises errors {' and '.join(parts)}{why}"
    return looked.of(
        Plan(robot.name, (), trajectory=made[kind], seed=seed), errors[kind], [Note("plan-compared", text)]
    )


def check_motion(
    robot: Robot,
    given: Plan,
    *,
    prior: Estimate | None = None,
    payload: Payload | None = None,
    seed: int = 0,
    tell: Callable[[str], None] = lambda _: None,
) -> Plan:
    """A plan's trajectory, edited or written by hand, with what it promises and notes on all that asks for attention.

    Parameters are those of `pumaid.design.plan.check_plan`.
    """
    tell("looking at the trajectory")
    looked, made = _Forecast(robot, prior=prior, payload=payload, seed=seed), given.trajectory
    assert made is not None
    promised = looked.information.errors(looked.information.of(made))
    return looked.of(given, promised, looked.faults(made, promised))


class _Forecast:
    """What is asked of a trajectory of an arm, which may be any of the prior robots."""

    def __init__(self, robot: Robot, *, prior: Estimate | None, payload: Payload | None, seed: int) -> None:
        self.prior = prior_robots(robot, estimate=prior, payload=payload, seed=seed)
        self.robot, self.collision = robot, Collision(robot)
        self.information = MotionInformation(self.prior, estimate=prior, payload=payload)
        self.absent = in_motion(robot).absent

    def share(self, errors: Mapping[str, float], others: Mapping[str, float]) -> tuple[str, int]:
        """Geometric mean of errors over those of another plan, by the parameters that both show, and how many."""
        sizes = dict(zip(self.information.names, self.information.sizes.tolist(), strict=True))
        both = [name for name, size in sizes.items() if max(errors.get(name, np.inf), others.get(name, np.inf)) < size]
        return number(float(np.exp(np.mean([np.log(errors[name] / others[name]) for name in both]))), 2), len(both)

    def faults(self, made: Trajectory, promised: Mapping[str, float]) -> Iterator[Note]:
        """What asks for attention of a trajectory that promises some errors."""
        dense = replace(made, repeats=1).at(np.linspace(0.0, made.cycle, int(made.cycle / DENSE) + 2))
        if (hit := self.collision.first_hit_along(dense[0])) is not None:
            yield Note("plan-strikes", f"the trajectory: {hit}")
        if made.seconds < LEAST:
            yield Note(
                "plan-lacks",
                f"the trajectory lasts for {number(made.seconds, 3)} s; intervals need {LEAST:g} s or more",
            )
        yield from (
            Note(
                "plan-lacks",
                f"joint {joint.number} ({joint.name}): it never moves faster than {STICKING:g} {joint.position_unit}/s",
                Where(joint=joint.number),
            )
            for joint, fastest in zip(self.robot.joints, _peak(dense[1]).tolist(), strict=True)
            if fastest < STICKING
        )
        if dark := [name for name in self.information.names if name not in promised]:
            yield Note(
                "plan-dark",
                f"this trajectory does not show {', '.join(dark)}; compare with: pumaid plan --motion fourier",
            )

    def of(self, bare: Plan, promised: dict[str, float], notes: Iterable[Note]) -> Plan:
        """A plan with its forecast."""
        levels = f"A level of noise lasts for {PART:g} s of a trajectory; inertia as of robots drawn from the geometry."
        noted = replace(bare, notes=tuple(notes), assumptions=(levels,))
        unseen = dict.fromkeys(self.information.names, "this trajectory does not show it")
        return with_forecast(noted, self.prior, promised, unseen=unseen, absent=self.absent)
