"""Rigid-body dynamics of a serial chain as a regressor: what each inertial parameter asks of each joint."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from pumaid.effects import Samples
from pumaid.effects.gravity import Gravity
from pumaid.maths import Floats, independent
from pumaid.robot import Payload, Robot, steiner

#: Parameters of a link, in its joint's frame: mass (kg), first moments (kg m), moments and products of inertia about
#: the frame's origin (kg m2), and the inertia of the rotor as the joint feels it.
PARAMETERS = ("m", "mx", "my", "mz", "xx", "xy", "xz", "yy", "yz", "zz", "rotor")
#: Row and column of the inertia tensor that each of its parameters fills.
TENSOR = {"xx": (0, 0), "xy": (0, 1), "xz": (0, 2), "yy": (1, 1), "yz": (1, 2), "zz": (2, 2)}

#: Random states by which base parameters are chosen, their largest speed (1/s) and acceleration (1/s2): all of order
#: one beside gravity, so that no parameter is faint.
STATES, SPEED, ACCELERATION = 300, 3.0, 20.0
#: A column of which less than this share is left beside the columns before it is one of their combinations; one that is
#: smaller than this share of the largest is zero but for the rounding of twists by right angles.
RANK = 1e-7


@dataclass(frozen=True, eq=False, slots=True)
class RigidBody:
    """The chain of `robot` with the parameters of each link that are counted: numbers in `PARAMETERS`, link by link."""

    robot: Robot
    counted: tuple[tuple[int, ...], ...]
    #: (P, P) combinations of these, a column each, that are the parameters; where not given, they are themselves.
    mixed: Floats | None = None
    #: (J, P) what they ask in every posture beside gravity's constants, which is left to Coulomb friction.
    constants: Floats | None = None

    @property
    def names(self) -> tuple[tuple[int, str], ...]:
        """(link from 1, parameter) of each column, base to tip."""
        return tuple((link, PARAMETERS[k]) for link, numbers in enumerate(self.counted, 1) for k in numbers)

    def rows(self, position: Floats, velocity: Floats, acceleration: Floats) -> list[Floats]:
        """The regressor of each joint, (columns it feels, N), for (J, N) of rad or m, their rates and their rates.

        Source: the recursive Newton-Euler equations, linear in the parameters: W. Khalil and E. Dombre, Modeling,
        Identification and Control of Robots, ch. 9.
        """
        return self._rows((position, velocity, acceleration), range(len(self.counted)))

    def row(self, joint: int, motion: tuple[Floats, Floats, Floats]) -> Floats:
        """(columns that it feels, N): the regressor of one joint (from 1); `motion` as in `rows`."""
        return self._rows(motion, [joint - 1])[0]

    def _rows(self, motion: tuple[Floats, Floats, Floats], joints: Sequence[int]) -> list[Floats]:
        parts: dict[int, list[Floats]] = {joint: [] for joint in joints}
        for link, state in enumerate(_links(self.robot, motion, joints)):
            moving = [joint for joint in joints if joint <= link]
            for column in _columns(state, self.counted[link], [motion[2][link] * (k == link) for k in moving]):
                for joint, asked in zip(moving, column, strict=True):
                    parts[joint].append(asked)
        rows = [np.array(columns).reshape(len(columns), motion[0].shape[1]) for columns in parts.values()]
        if self.mixed is not None:
            rows = [self.mixed[-len(part) :, -len(part) :].T @ part for part in rows]
        if self.constants is not None:
            rows = [part - self.constants[k][-len(part) :, None] for k, part in zip(joints, rows, strict=True)]
        return rows


def of_body(robot: Robot, joint: int, motion: tuple[Floats, Floats, Floats]) -> Floats:
    """(N, 10) N m, or N, that a unit of each parameter of the last link's body asks of a joint (from 1).

    `motion` are (J, N) positions, rates and accelerations.
    """
    return RigidBody(robot, (*([()] * (robot.n_joints - 1)), tuple(range(10)))).row(joint, motion).T


def of_bodies(
    masses: Floats, centres: Floats, tensors: Floats | float = 0.0, *, rotors: Floats | float = 0.0
) -> Floats:
    """(J, 11) parameters of links: (J,) kg, (J, 3) m of their centres, (J, 6) kg m2 about these, (J,) of rotors."""
    moments, rotors = steiner(masses, centres) + tensors, rotors + np.zeros(len(masses))
    return np.column_stack([masses, masses[:, None] * centres, moments, rotors])


def of_payload(payload: Payload) -> Floats:
    """(11,) parameters of a point mass."""
    return of_bodies(np.array(payload[:1]), np.array([payload[1:]]))[0]


#: One link in its own axes: angular velocity and acceleration, acceleration of the origin less gravity, (3, N); and how
#: the link turns, and its origin moves, by each wanted joint up to its own, (3, j, N).
_LinkState = tuple[Floats, Floats, Floats, Floats, Floats]


def _links(robot: Robot, motion: tuple[Floats, Floats, Floats], joints: Sequence[int]) -> Iterator[_LinkState]:
    position, velocity, acceleration = motion
    n = position.shape[1]
    spin, spin_rate = np.zeros((3, n)), np.zeros((3, n))
    pull = np.repeat(-np.asarray(robot.gravity, dtype=float)[:, None], n, axis=1)
    turn, shift = np.zeros((3, 0, n)), np.zeros((3, 0, n))
    along, still = np.zeros((3, 1, n)), np.zeros((3, 1, n))
    along[2] = 1.0
    for j, (placement, turns) in enumerate(zip(robot.placements, robot.is_revolute, strict=True)):
        back, offset = placement[:3, :3].T, placement[:3, 3:]
        if not turns:
            offset = offset + placement[:3, 2:3] * position[j]
        pull = pull + _cross(spin_rate, offset) + _cross(spin, _cross(spin, offset))
        shift = shift + _cross(turn, offset[:, None, :])
        spin, spin_rate, pull = back @ spin, back @ spin_rate, back @ pull
        turn, shift = ((back @ part.reshape(3, -1)).reshape(part.shape) for part in (turn, shift))
        if turns:
            cosine, sine = np.cos(position[j]), np.sin(position[j])
            for vectors in (spin, spin_rate, pull, turn, shift):  # into axes turned about z
                along_x = cosine * vectors[0] + sine * vectors[1]
                vectors[1] = cosine * vectors[1] - sine * vectors[0]
                vectors[0] = along_x
            spin_rate[0] += spin[1] * velocity[j]
            spin_rate[1] -= spin[0] * velocity[j]
            spin_rate[2] += acceleration[j]
            spin[2] += velocity[j]
        else:
            pull[0] += 2.0 * spin[1] * velocity[j]
            pull[1] -= 2.0 * spin[0] * velocity[j]
            pull[2] += acceleration[j]
        if j in joints:
            turn = np.concatenate([turn, along if turns else still], axis=1)
            shift = np.concatenate([shift, still if turns else along], axis=1)
        yield spin, spin_rate, pull, turn, shift


def _columns(
    state: _LinkState, counted: tuple[int, ...], rotor: Sequence[Floats]
) -> Iterator[Floats | Sequence[Floats]]:
    """(j, N) of each counted parameter: power per unit speed of each joint that moves the link; `rotor` is its own."""
    (spin, rate, pull), (turn, shift) = (part[:, None, :] for part in state[:3]), state[3:]
    if any(1 <= number <= 3 for number in counted):
        moments = _cross(pull, turn)
        moments += _cross(shift, rate)
        moments += spin * _dot(shift, spin)
        moments -= shift * _dot(spin, spin)
    if any(4 <= number <= 9 for number in counted):
        twist = _cross(turn, spin)
    for number in counted:
        if number == 0:
            yield _dot(shift, pull)
        elif number <= 3:
            yield moments[number - 1]
        elif number <= 9:
            a, b = TENSOR[PARAMETERS[number]]
            column = turn[a] * rate[b]
            column += twist[a] * spin[b]
            if a != b:
                column += turn[b] * rate[a]
                column += twist[b] * spin[a]
            yield column
        else:
            yield rotor


def _cross(a: Floats, b: Floats) -> Floats:
    """Cross product of vectors that stand in the first axis: a tenth of the time that ``np.cross`` takes."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        np.multiply(a[i], b[j], out=out[k])
        out[k] -= a[j] * b[i]
    return out


def _dot(a: Floats, b: Floats) -> Floats:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@lru_cache(maxsize=32)
def base_parameters(robot: Robot) -> RigidBody:
    """The chain with the parameters that some motion shows beside friction: of inner links first, the rest regrouped.

    Those of weight ask at rest what the constants of gravity do, and the others nothing.

    Source: M. Gautier, J. Robotic Systems 8 (1991) 485-506: base parameters by the rank of the regressor.
    """
    names = whole(robot).names
    matrix, constant = _random_rows(robot)
    size = np.linalg.norm(matrix, axis=0)
    # Coulomb friction takes up a load that is the same in any posture; what slides then shows its mass as a rotor's.
    is_late = [0.5 * (part == "rotor" and not robot.is_revolute[link - 1]) for link, part in names]
    order = np.argsort([link for link, _ in names] - np.array(is_late), kind="stable")
    order = order[size[order] > RANK * size.max()]
    upper: Floats = np.asarray(np.linalg.qr(np.hstack([constant, matrix[:, order] / size[order]]), mode="r"))
    counted = [names[k] for k in order[np.abs(upper.diagonal()[constant.shape[1] :]) > RANK]]
    numbers = tuple(
        tuple(k for k, name in enumerate(PARAMETERS) if (link, name) in counted)
        for link in range(1, robot.n_joints + 1)
    )
    body = RigidBody(robot, numbers)
    return body if robot.is_revolute.all() else _regrouped(body)


def whole(robot: Robot) -> RigidBody:
    """The chain with every parameter of every link."""
    return RigidBody(robot, (tuple(range(len(PARAMETERS))),) * robot.n_joints)


def asked(robot: Robot, parameters: Floats, motion: tuple[Floats, Floats, Floats]) -> Floats:
    """(J, N) N m, or N, that links of these parameters (J, 11) ask of each joint; `motion` as in `of_body`."""
    return np.array([parameters.ravel()[-len(rows) :] @ rows for rows in whole(robot).rows(*motion)])


@lru_cache(maxsize=32)
def regrouping(robot: Robot) -> tuple[Floats, Floats]:
    """(P, 11 J) the sums of all parameters that take the place of the base parameters, before combinations of these.

    And (S, 11 J) N what all ask, beside these sums, of each joint that slides, in every posture the same.
    """
    matrix, constant = _random_rows(robot)
    counted = [whole(robot).names.index(name) for name in base_parameters(robot).names]
    sums = np.asarray(np.linalg.lstsq(np.hstack([constant, matrix[:, counted]]), matrix, rcond=None)[0], dtype=float)
    sums[np.abs(sums) < RANK * np.abs(sums).max()] = 0.0
    return sums[constant.shape[1] :], sums[: constant.shape[1]] / np.sqrt(STATES)


def base_values(robot: Robot, parameters: Floats) -> Floats:
    """(P,) values of the base parameters of links of parameters (J, 11)."""
    values, mixed = regrouping(robot)[0] @ parameters.ravel(), base_parameters(robot).mixed
    return values if mixed is None else np.asarray(np.linalg.solve(mixed, values))


@lru_cache(maxsize=32)
def of_last_link(robot: Robot) -> tuple[Floats, Floats]:
    """(P, 11) values of the base parameters per unit of each parameter of the last link.

    And (J, 11) N more that these ask of joints that slide: a weight that is the same in every posture.
    """
    links, still = np.zeros((robot.n_joints, len(PARAMETERS))), np.zeros((robot.n_joints, 1))
    units = [np.vstack([links[1:], unit]) for unit in np.eye(len(PARAMETERS))]
    values = np.array([base_values(robot, unit) for unit in units]).T
    felt = [rows[:, 0] @ values[-len(rows) :] for rows in base_parameters(robot).rows(still, still, still)]
    beside = np.array([asked(robot, unit, (still, still, still))[:, 0] for unit in units]).T - felt
    return values, np.where(robot.is_revolute[:, None], 0.0, beside)


def _random_rows(robot: Robot) -> tuple[Floats, Floats]:
    """(J N, 11 J) the whole regressor in random states, and (J N, S) a load of each joint that slides, of length 1."""
    rng, shape = np.random.default_rng(0), (robot.n_joints, STATES)
    states = (rng.uniform(-np.pi, np.pi, shape), rng.normal(0, SPEED, shape), rng.normal(0, ACCELERATION, shape))
    constant = np.repeat(np.eye(robot.n_joints)[:, ~robot.is_revolute], STATES, axis=0) / np.sqrt(STATES)
    return _stacked(whole(robot).rows(*states)), constant


def weight_name(robot: Robot, link: int, part: str) -> str | None:
    """The constant of gravity that a parameter of a link is; None where it is none."""
    return ({"mx": "x", "my": "y"} if robot.joint(link).is_revolute else {"m": "mass"}).get(part)


def _stacked(rows: list[Floats]) -> Floats:
    """(J N, P) a regressor's rows of all joints."""
    return np.vstack([np.pad(part.T, ((0, 0), (len(rows[0]) - len(part), 0))) for part in rows])


def _regrouped(body: RigidBody) -> RigidBody:
    """The same in combinations of its parameters of which only those of weight ask anything at rest.

    What a slide carries off its axis, and lengths before it, ask what the constants of gravity of the links before do,
    which take them up, as in the paper; without slides there is nothing of the kind.
    """
    robot, gravity, rng = body.robot, Gravity(), np.random.default_rng(0)
    position, still = rng.uniform(-np.pi, np.pi, (robot.n_joints, STATES)), np.zeros((robot.n_joints, STATES))
    weights = np.array([k for k, (link, part) in enumerate(body.names) if weight_name(robot, link, part)], np.int64)
    felt = np.zeros((robot.n_joints, STATES, len(weights)))
    for place, (link, part) in enumerate(body.names[k] for k in weights):
        for joint in range(1, link + 1):
            columns = gravity.columns(robot, Samples(joint, position.T, still.T), number=link)
            felt[joint - 1, :, place] = columns[:, int(part == "my")]
    constant = np.repeat(np.eye(robot.n_joints)[:, ~robot.is_revolute], STATES, axis=0)
    table, slides = np.hstack([constant, felt.reshape(len(constant), len(weights))]), constant.shape[1]
    sure, torque = independent(table, first=slides), _stacked(body.rows(position, still, still))
    shares, shown = np.linalg.lstsq(table[:, sure], torque, rcond=None)[0][slides:], weights[sure[slides:]]
    shares[np.abs(shares) < RANK] = 0.0
    inverse, mixed = np.linalg.inv(shares[:, shown]), np.eye(len(body.names))
    mixed[shown] -= inverse @ shares
    mixed[np.ix_(shown, shown)] = inverse
    constants = (torque @ mixed).reshape(robot.n_joints, STATES, len(mixed)).mean(axis=1)
    constants[:, weights] -= felt.mean(axis=1)
    return replace(body, mixed=mixed, constants=constants)
