"""Logs that do not mean what the recipe says are refused or flagged, good ones are not."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pumaid.dataset import Log
from pumaid.errors import LogError, Note
from pumaid.preprocessing.log_checks import LogStatistics, findings
from pumaid.robot import Joint, LogFormat, Robot

COULOMB = np.array([0.5, -0.4, 0.15])


def arm(*, limits: tuple[float, float] | None = (-2.9, 2.9), max_velocity: float | None = 2.0, **log: object) -> Robot:
    """Three revolute joints."""
    joints = tuple(
        Joint(k, f"j{k}", "revolute", alpha=1.0, limits=limits, max_velocity=max_velocity) for k in (1, 2, 3)
    )
    return Robot("test arm", joints, log=LogFormat(**log))  # type: ignore[arg-type]


def good_log(*, seed: int = 0, rate: float = 200.0) -> Log:
    """Each joint moves to and fro in three postures, with rests; gravity, friction of mixed signs and noise."""
    rng = np.random.default_rng(seed)
    where = rng.uniform(-1.0, 1.0, 3)
    path: list[np.ndarray] = []

    def go(target: np.ndarray, seconds: float) -> None:
        nonlocal where
        share = np.concatenate([np.linspace(0, 1, int(seconds * rate)), np.ones(int(0.4 * rate))])
        path.append(where + share[:, None] * (target - where))
        where = target

    for joint in (0, 1, 2) * 3:
        for end in (-1.8, 1.8, -1.5, 1.7):
            go(np.where(np.arange(3) == joint, end, where), 4.0)
        go(np.where(np.arange(3) == joint, where, rng.uniform(-1.0, 1.0, 3)), 3.0)
    q = np.concatenate(path)
    time = np.arange(len(q)) / rate
    velocity = np.gradient(q, time, axis=0)
    gravity = np.stack(
        [0 * q[:, 0], 2.0 * np.cos(q[:, 1]) + 0.5 * np.cos(q[:, 1] + q[:, 2]), 0.8 * np.sin(q[:, 1] + q[:, 2])]
    )
    current = gravity.T + COULOMB * np.sign(velocity) + 0.1 * velocity + rng.normal(scale=0.05, size=q.shape)
    q = q + rng.normal(scale=1e-4, size=q.shape)
    velocity = velocity + rng.normal(scale=0.02, size=q.shape)
    return Log("made.csv", np.arange(len(q)) + 2, time, q, velocity, current)


def watched(log: Log, robot: Robot, *, batch: int = 4096) -> list[LogError | Note]:
    """Faults and notes on a log that comes in batches."""
    sums = LogStatistics(robot)
    for k in range(0, len(log), batch):
        sums.take(log.part(slice(k, k + batch)))
    sums.intervals = [float(np.median(np.diff(log.time)))]
    found = findings(sums)
    return [item for item in found if isinstance(item, LogError)] or found


def slugs(log: Log, robot: Robot) -> list[str]:
    """Slugs of what is found, faults in capitals."""
    return [item.slug.upper() if isinstance(item, LogError) else item.slug for item in watched(log, robot)]


@pytest.mark.parametrize(("seed", "rate"), [(0, 60.0), (1, 200.0), (2, 1000.0)])
def test_a_good_log_passes_in_silence(seed: int, rate: float) -> None:
    """No doubt falls on noise, mixed friction signs and gravity many times the friction."""
    assert watched(good_log(seed=seed, rate=rate), arm()) == []
    assert watched(replace(good_log(seed=seed, rate=rate), velocity=None), arm(limits=None, max_velocity=None)) == []


def scaled(**factors: float | None) -> Callable[[Log], Log]:
    """A log with columns multiplied; None for a column that is not there."""
    return lambda log: replace(
        log, **{name: None if by is None else by * getattr(log, name) for name, by in factors.items()}
    )


def with_current(values: Callable[[np.ndarray, Log], np.ndarray], *, joint: int | None = 1) -> Callable[[Log], Log]:
    """A log with a function of its currents instead, of those of joint 2 or of all."""

    def change(log: Log) -> Log:
        current, columns = log.current.copy(), slice(None) if joint is None else joint
        current[:, columns] = values(current[:, columns], log)
        return replace(log, current=current)

    return change


def held_every(period: float) -> Callable[[np.ndarray, Log], np.ndarray]:
    """What comes over a bus every `period` s, repeated until the next."""

    def values(current: np.ndarray, log: Log) -> np.ndarray:
        last = np.floor(log.time / period + 1e-9).astype(np.int64)
        return current[np.searchsorted(last, last)]

    return values


def frozen(current: np.ndarray, log: Log) -> np.ndarray:
    """What stands still for 0.8 s every six."""
    begin = 6.0 * np.floor((log.time - 3.0) / 6.0) + 3.0
    is_held = (log.time >= 3.0) & (log.time < begin + 0.8)
    return np.where(is_held, current[np.searchsorted(log.time, np.maximum(begin, 0.0))], current)


def rounded(step: float) -> Callable[[np.ndarray, Log], np.ndarray]:
    return lambda current, log: step * np.round(current / step)


def drawn_to_zero(limit: float, *, step: float = 1e-12) -> Callable[[np.ndarray, Log], np.ndarray]:
    return lambda current, log: np.sign(current) * np.maximum(np.abs(rounded(step)(current, log)) - limit, 0.0)


def sign_bit(step: float, bit: int) -> Callable[[np.ndarray, Log], np.ndarray]:
    """Steps in integers of which a bit says whether they are negative."""
    return lambda current, log: step * (np.round(np.abs(current) / step) + (current < 0.0) * 2.0**bit)


def repeated(times: int, step: float) -> Callable[[Log], Log]:
    """Each position logged several times over, in an encoder's fine steps."""

    def change(log: Log) -> Log:
        position = step * np.round(log.position / step)
        return replace(log, position=position[np.arange(len(log)) // times * times], velocity=None)

    return change


DEG = 180.0 / math.pi
FREE = {"limits": None, "max_velocity": None}
#: What is done to a good log, the arm, the slugs of what is found (faults in capitals), and words of the message.
CASES = {
    "degrees beside rad/s": (scaled(position=DEG), FREE, "UNITS-DISAGREE", "position: deg"),
    "all in degrees": (scaled(position=DEG, velocity=DEG), {}, "UNITS-DISAGREE", "would fit"),
    "degrees of a joint": (lambda log: replace(log, position=log.position * [1.0, DEG, 1.0], velocity=None), {},
                           "UNITS-DISAGREE", "scale: [1, 0.01745329252, 1]"),
    "degrees of many turns": (scaled(position=DEG, velocity=None), FREE, "UNITS-DISAGREE", "turns"),
    "radians read as degrees": (scaled(position=1 / DEG, velocity=None), {"units": {"position": "deg"}},
                                "UNITS-DISAGREE", "would fit"),
    "degrees read as such": (scaled(velocity=None), {"units": {"position": "deg"}}, "", ""),
    "velocity in deg/s": (scaled(velocity=DEG), {}, "units-disagree", "velocity: deg/s"),
    "velocity's sign": (scaled(velocity=-1.0), {}, "velocity-unrelated", "sign"),
    "a clock or velocities": (scaled(velocity=1 / 1.47), {}, "VELOCITY-UNRELATED", "friction is 1.47 times as large"),
    "a joint's velocity": (lambda log: replace(log, velocity=log.velocity * [1.0, 0.7, 1.0]), {}, "velocity-unrelated",
                           "joint 2"),
    "currents of 16 bits": (with_current(lambda current, log: np.round(1e3 * current) % 65536 / 1e3), {}, "SIGN-LOST",
                            "complement of 16 bits"),
    "currents with a sign bit": (with_current(sign_bit(0.005, 10)), {}, "SIGN-LOST", "sign in bit 10"),
    "sizes of currents": (with_current(lambda current, log: np.abs(current)), {}, "SIGN-LOST", "without sign"),
    "sizes of positions": (lambda log: replace(log, position=np.abs(log.position), velocity=None), {}, "SIGN-LOST",
                           "at zero"),
    "positions of 16 bits": (lambda log: replace(log, position=np.round(DEG * log.position) % 65536 / DEG,
                                                 velocity=None), FREE, "SIGN-LOST", "jumps by"),
    "positions lost as 0": (lambda log: replace(log, position=np.where((np.arange(len(log)) % 701 == 9)[:, None]
        & (np.arange(3) == 1), 0.0, log.position), velocity=None), {}, "BAD-SAMPLES", "to 0 for one"),
    "positions lost as -999": (lambda log: replace(log, position=np.where((np.arange(len(log)) % 97 == 9)[:, None],
        -999.0, log.position)), FREE, "BAD-SAMPLES", "joint 1 (and of 2, 3) leaps"),
    "an encoder of 300 degrees": (lambda log: replace(log, position=(log.position + 3.5) % (300 / DEG), velocity=None),
                                  FREE, "SIGN-LOST", "jumps by 5.2"),
    "velocities swapped": (lambda log: replace(log, velocity=log.velocity[:, [1, 0, 2]]), {}, "JOINTS-SWAPPED",
                           "of joint 1 follows the position of joint 2"),
    "time in ms": (scaled(time=1e3), {}, "TIME-UNIT", "units: {time: ms}"),
    "time in minutes": (scaled(time=1 / 60, velocity=None), {"max_velocity": 1.2}, "beyond-limits", "maximum"),
    "constant current": (with_current(lambda current, log: 1.25), {}, "CURRENT-UNMEASURED", "1.25"),
    "clipped": (with_current(lambda current, log: np.clip(current, -2, 2)), {}, "current-saturated", "2.0"),
    "a few lost": (with_current(lambda current, log: np.where(np.arange(len(log)) % 100, current, 0.0)), {},
                   "current-dropouts", "joint 2"),
    "lost as -999": (with_current(lambda i, log: np.where(np.arange(len(i)) % 150, i, -999.0)), {}, "CURRENT-DROPOUTS",
                     "exactly -999"),
    "small cut off": (with_current(drawn_to_zero(0.05), joint=None), {}, "current-dropouts", ""),
    "small cut off in steps": (with_current(drawn_to_zero(0.2, step=0.005), joint=None), {},
                               "current-dropouts current-frozen", ""),
    "steps of 5 mA": (with_current(rounded(0.005), joint=None), {}, "", ""),
    "slow bus": (with_current(held_every(0.05), joint=None), {}, "current-frozen", " ms"),
    "every other sample": (with_current(held_every(0.01), joint=None), {}, "", ""),
    "freezes": (with_current(frozen), {}, "current-frozen", "% of the time"),
    "whole degrees": (lambda log: replace(log, position=np.round(DEG * log.position) / DEG, velocity=None), {},
                      "position-coarse", "of 0.0175"),
    "potentiometers": (lambda log: replace(log, position=log.position + 0.01 * np.random.default_rng(1).normal(
        size=log.position.shape), velocity=None), {}, "position-coarse", "noise of 0.03"),
    "position repeated": (repeated(2, 1e-6), {}, "position-held", ""),
    "position repeated in steps": (repeated(3, 2e-4), {}, "position-held", ""),
    "few absurd currents": (with_current(lambda i, log: np.where(np.arange(len(i)) % 997 == 500, 1e5, i)),
        {}, "current-spikes", "leaps to 1e+05 A"),
    "one spike": (with_current(lambda i, log: np.where(i == i.max(), 50.0, i)), {}, "current-spikes", "leaps to 50"),
    "ten a second": (lambda log: log.part(slice(0, len(log), 20)), {}, "time-unit", "10"),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_a_wrong_log_is_told(name: str) -> None:
    """The slug says what is wrong, a refusal where numbers would be wrong; the message names unit, joint or amount."""
    change, robot, expected, words = CASES[name]
    found = watched(change(good_log()), arm(**robot))
    names = {item.slug.upper() if isinstance(item, LogError) else item.slug for item in found}
    assert names <= set(expected.split()) and bool(names) == bool(expected)
    assert not words or any(words in str(item) for item in found)


@pytest.mark.parametrize("share", [0.05, 0.5, 0.95])
def test_currents_with_holes_raise_no_doubt_and_hide_none(share: float) -> None:
    """What is missing is passed over; a dead, a clipped and, from half of its samples, another's current are told."""
    log = good_log()
    log.current[np.random.default_rng(5).random(log.current.shape) < share] = np.nan
    assert watched(log, arm()) == []
    moving_only = replace(log, current=np.where(np.abs(log.velocity) < 0.1, np.nan, log.current))
    assert watched(moving_only, arm()) == []
    if share <= 0.5:
        assert slugs(replace(log, current=log.current[:, [0, 2, 1]]), arm()) == ["JOINTS-SWAPPED"]
    dead = np.where(np.isnan(log.current), np.nan, np.where(np.arange(3) == 1, 0.3, log.current))
    assert "CURRENT-UNMEASURED" in slugs(replace(log, current=dead), arm())
    assert "current-saturated" in slugs(replace(log, current=np.clip(log.current, -1.5, 1.5)), arm())


@pytest.mark.parametrize("share", [0.3, 0.99])
def test_a_velocity_with_holes_is_a_witness_where_it_is_there(share: float) -> None:
    """Missing velocities raise no doubt in a good log; while some windows have most of them, they tell a wrong unit."""
    log = good_log()
    log.velocity[np.random.default_rng(4).random(len(log)) < share] = np.nan
    log.velocity[: len(log) // 4] = np.nan
    assert watched(log, arm()) == []
    assert slugs(scaled(velocity=DEG)(log), arm()) == (["units-disagree"] if share < 0.5 else [])


@pytest.mark.parametrize(("size", "slug"), [(1e3, "units-disagree"), (60.0, "units-disagree"), (1.0, None)])
def test_millimetres_against_the_limits(size: float, slug: str | None) -> None:
    """A slide's positions in millimetres, or in no unit that fits, leave the limits far behind; as metres they pass."""
    log, robot = good_log(), arm()
    limits = (1.0 if size == 60.0 else -4.0, 4.0)
    slides = tuple(replace(joint, kind="prismatic", limits=limits) for joint in robot.joints)
    robot = replace(robot, joints=slides, log=replace(robot.log, units={"prismatic_position": "m"}))
    velocity = None if log.velocity is None else size * log.velocity
    found = watched(replace(log, position=size * log.position, velocity=velocity), robot)
    assert [fault.slug for fault in found if isinstance(fault, LogError)] == ([slug] if slug else [])
    assert any("if they are mm" in str(fault) for fault in found) == (size == 1e3)


def test_one_joint_of_many_turns_is_no_fault() -> None:
    """A wrist that turns endlessly, with a velocity that agrees, is believed."""
    log = good_log()
    position = log.position + np.outer(log.time, [0.0, 0.0, 0.9])
    turned = replace(log, position=position, velocity=np.gradient(position, log.time, axis=0))
    assert set(slugs(turned, arm(**FREE))) <= {"joints-swapped"}


@pytest.mark.parametrize("order", [(1, 0, 2), (2, 0, 1)])
def test_positions_in_another_order_are_refused(order: tuple[int, ...]) -> None:
    """The current that answers to a joint's direction is another's: with the pairs; however the log is batched."""
    log = good_log(seed=7)
    log = replace(log, position=log.position[:, order], velocity=None)
    (fault,) = watched(log, arm())
    assert isinstance(fault, LogError) and fault.slug == "joints-swapped"
    for joint, source in enumerate(order):
        assert (f"q{joint + 1} beside i{source + 1}" in fault.mend) == (joint != source)
    assert str(watched(log, arm(), batch=37)[0]) == str(fault)


def test_joints_at_rest_and_beyond_limits_are_flagged() -> None:
    """What may be meant is a note with the joints and the figures."""
    part = replace(good_log().part(slice(3400)), velocity=None)
    found = watched(part, arm(limits=(-1.0, 1.0)))
    assert [item.slug for item in found] == ["beyond-limits", "joint-at-rest"]
    assert "joint 1 runs from -1.8" in str(found[0]) and "joints 2, 3" in str(found[1])


@pytest.mark.parametrize(("counts", "rate"), [(256, 100.0), (4096, 1000.0), (1 << 20, 1000.0)])
def test_encoders_of_few_counts_are_not_flagged(counts: int, rate: float) -> None:
    """Between two counts an encoder says the same, however coarse it is; in a text with six places, too."""
    log, count = good_log(rate=rate), 2.0 * math.pi / counts
    for places in (6, 12):
        position = np.round(count * np.floor(log.position / count), places)
        found = watched(replace(log, position=position, velocity=None), arm())
        assert "position-held" not in [note.slug for note in found]
