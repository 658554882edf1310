"""Logs that do not mean what the recipe says are refused or flagged, good ones are not."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pumaid.dataset import Log
from pumaid.errors import LogError, Note
from pumaid.preprocessing.ingest import ingest
from pumaid.preprocessing.log_checks import findings
from pumaid.preprocessing.log_statistics import LogStatistics
from pumaid.robot import Joint, LogFormat, Robot

REAL = Path(os.environ.get("PUMAID_REAL_DATA", Path(__file__).parents[3] / "shared" / "data"))
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
    found = findings(sums)
    return [item for item in found if isinstance(item, LogError)] or found


def slugs(log: Log, robot: Robot) -> list[str]:
    """Slugs of what is found, faults in capitals."""
    return [item.slug.upper() if isinstance(item, LogError) else item.slug for item in watched(log, robot)]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("rate", [60.0, 1000.0])
def test_a_good_log_passes_in_silence(seed: int, rate: float) -> None:
    """No doubt falls on noise, mixed friction signs and gravity many times the friction."""
    assert watched(good_log(seed=seed, rate=rate), arm()) == []
    assert watched(replace(good_log(seed=seed, rate=rate), velocity=None), arm(limits=None, max_velocity=None)) == []


def test_degrees_against_a_velocity_in_radians() -> None:
    """Positions in degrees beside velocities in rad/s disagree by 57.3; the mend names the unit."""
    log = good_log()
    (fault,) = watched(replace(log, position=np.degrees(log.position)), arm(limits=None, max_velocity=None))
    assert isinstance(fault, LogError) and fault.slug in ("looks-like-degrees", "units-disagree")
    assert "position: deg" in fault.mend and fault.where.column == "q1"


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
    assert "CONSTANT-CURRENT" in slugs(replace(log, current=dead), arm())
    assert "current-saturated" in slugs(replace(log, current=np.clip(log.current, -1.5, 1.5)), arm())


@pytest.mark.parametrize("share", [0.3, 0.6, 0.99])
def test_a_velocity_with_holes_is_a_witness_where_it_is_there(share: float) -> None:
    """Missing velocities raise no doubt in a good log; while some windows have most of them, they tell a wrong unit."""
    log, lost = good_log(), np.random.default_rng(4).random(len(good_log())) < share
    assert log.velocity is not None
    log.velocity[lost] = np.nan
    log.velocity[: len(log) // 4] = np.nan
    assert watched(log, arm()) == []
    if share < 0.5:
        (fault,) = watched(replace(log, velocity=np.degrees(log.velocity)), arm())
        assert fault.slug == "units-disagree"


@pytest.mark.parametrize(("velocity", "limits"), [(True, (-2.9, 2.9)), (False, (-2.9, 2.9)), (False, None)])
def test_degrees_without_a_witness(velocity: bool, limits: tuple[float, float] | None) -> None:
    """Positions (and velocities) in degrees fit the limits as degrees; without any, two joints are many turns away."""
    log = good_log()
    turned = np.degrees(log.velocity) if velocity else None
    robot = arm(limits=limits, max_velocity=2.0 if limits else None)
    (fault,) = watched(replace(log, position=np.degrees(log.position), velocity=turned), robot)
    assert isinstance(fault, LogError) and fault.slug == "looks-like-degrees"
    assert ("as degrees they would fit" in fault.what) is (limits is not None)


@pytest.mark.parametrize(("size", "slug"), [(1e3, "units-disagree"), (1.0, None)])
def test_millimetres_against_the_limits(size: float, slug: str | None) -> None:
    """A slide's positions as millimetres leave the limits a thousandfold and fit them; as metres they pass."""
    log, robot = good_log(), arm()
    slides = tuple(replace(joint, kind="prismatic", limits=(-4.0, 4.0)) for joint in robot.joints)
    robot = replace(robot, joints=slides, log=replace(robot.log, units={"prismatic_position": "m"}))
    velocity = None if log.velocity is None else size * log.velocity
    found = watched(replace(log, position=size * log.position, velocity=velocity), robot)
    assert [fault.slug for fault in found if isinstance(fault, LogError)] == ([slug] if slug else [])


def test_one_joint_of_many_turns_is_no_fault() -> None:
    """A wrist that turns endlessly, with a velocity that agrees, is believed."""
    log = good_log()
    position = log.position.copy()
    position[:, 2] += 0.9 * log.time
    velocity = np.gradient(position, log.time, axis=0)
    free = arm(limits=None, max_velocity=None)
    assert [s for s in slugs(replace(log, position=position, velocity=velocity), free) if s != "joints-swapped"] == []


UNITS = [
    ("velocity", 180 / math.pi, "units-disagree", "velocity: deg/s"),
    ("velocity", 30 / math.pi, "units-disagree", "velocity: rpm"),
    ("velocity", -1.0, "velocity-sign", "sign"),
    ("velocity", 100.0, "velocity-unrelated", "gear, 100.0: the column is the motor's speed"),
    ("time", 1000.0, "TIME-UNIT", "units: {time: ms}"),
    ("time", 1e6, "TIME-UNIT", "units: {time: us}"),
    ("time", 1e9, "TIME-UNIT", "units: {time: ns}"),
]


@pytest.mark.parametrize(("quantity", "factor", "slug", "said"), UNITS)
def test_a_wrong_unit_is_named(quantity: str, factor: float, slug: str, said: str) -> None:
    """The ratio of what should be equal tells the unit word that belongs into the recipe."""
    log = good_log()
    changed = replace(log, **{quantity: getattr(log, quantity) * factor})
    robot = arm()
    robot = replace(robot, joints=tuple(replace(joint, gear_ratio=100.0) for joint in robot.joints))
    found = watched(changed, robot)
    assert {item.slug for item in found} == {slug.lower()}
    assert isinstance(found[0], LogError) == slug.isupper()
    assert said in str(found[0])


@pytest.mark.parametrize("order", [(1, 0, 2), (0, 2, 1), (2, 0, 1)])
def test_positions_in_another_order_are_refused(order: tuple[int, ...]) -> None:
    """The current that answers to a joint's direction is another's: with the amperes and the pairs."""
    log = good_log(seed=7)
    (fault,) = watched(replace(log, position=log.position[:, order], velocity=None), arm())
    assert isinstance(fault, LogError) and fault.slug == "joints-swapped"
    for joint, source in enumerate(order):
        assert (f"q{joint + 1} beside i{source + 1}" in fault.mend) == (joint != source)


def test_velocities_in_another_order_are_refused() -> None:
    """A velocity column that follows another joint's position shows that one of them is misplaced."""
    log = good_log()
    assert log.velocity is not None
    (fault,) = watched(replace(log, velocity=log.velocity[:, [1, 0, 2]]), arm())
    assert isinstance(fault, LogError) and fault.slug == "joints-swapped"
    assert "position 1 with velocity 2, position 2 with velocity 1" in fault.what


@pytest.mark.parametrize("value", [0.0, 1.25])
def test_a_dead_current_is_refused(value: float) -> None:
    """A joint that moves at an unchanging current has none that was measured."""
    log = good_log()
    log.current[:, 1] = value
    (fault,) = watched(log, arm())
    assert isinstance(fault, LogError) and (fault.slug, fault.where.column) == ("constant-current", "i2")


def test_a_cut_off_current_is_flagged() -> None:
    """Samples exactly at the largest value are a drive at its limit."""
    log = good_log()
    assert slugs(replace(log, current=np.clip(log.current, -2.0, 2.0)), arm()) == ["current-saturated"]


@pytest.mark.parametrize("share", [0.01, 0.3])
def test_values_that_were_lost_are_flagged(share: float) -> None:
    """Single zeros amid larger currents."""
    log = good_log()
    log.current[np.random.default_rng(7).random(len(log)) < share, 1] = 0.0
    (note,) = watched(log, arm())
    assert note.slug == "current-dropouts" and "joint 2" in str(note)


@pytest.mark.parametrize("limit", [0.05, 0.2])
@pytest.mark.parametrize("step", [0.0, 0.005])
def test_small_currents_that_are_cut_off_are_flagged(limit: float, step: float) -> None:
    """Drawn towards zero by a limit, or zero below it, in steps or not."""
    log = good_log()
    current = log.current if not step else step * np.round(log.current / step)
    drawn = np.sign(current) * np.maximum(np.abs(current) - limit, 0.0)
    for changed in (drawn, np.where(np.abs(current) < limit, 0.0, current)):
        assert "current-dropouts" in slugs(replace(log, current=changed), arm())


@pytest.mark.parametrize("step", [0.005, 0.02, 0.1, 0.25, 0.5])
def test_currents_in_steps_are_as_they_should_be(step: float) -> None:
    """Zero is a step like any other."""
    log = good_log()
    found = slugs(replace(log, current=step * np.round(log.current / step)), arm())
    assert "current-dropouts" not in found and (step > 0.1 or found == [])


def test_joints_at_rest_and_beyond_limits_are_flagged() -> None:
    """What may be meant is a note with the joints and the figures."""
    part = replace(good_log().part(slice(3400)), velocity=None)
    found = watched(part, arm(limits=(-1.0, 1.0)))
    assert [item.slug for item in found] == ["beyond-limits", "joint-at-rest"]
    assert "joint 1 runs from -1.8" in found[0].text and "joints 2, 3" in found[1].text  # type: ignore[union-attr]


def test_few_samples_a_second_are_flagged() -> None:
    """Ten samples a second do not show a ramp."""
    assert slugs(good_log(rate=10.0), arm()) == ["rate-low"]


def test_the_cut_of_batches_does_not_matter() -> None:
    """Findings with their figures are the same for small batches."""
    log = replace(good_log(seed=7), position=good_log(seed=7).position[:, [1, 0, 2]], velocity=None)
    assert [str(item) for item in watched(log, arm())] == [str(item) for item in watched(log, arm(), batch=37)]


REAL_LOGS = {
    "ur3e-aurt/wave_currentData_100v_40a.parquet": (
        6,
        "timestamp",
        "actual_q_{joint0}",
        "actual_qd_{joint0}",
        "actual_current_{joint0}",
    ),
    "kinova-gen3-jointwise": (7, "Time", "Position{joint}", "Velocity{joint}", "Cur{joint}"),
    "dfki-double-pendulum-a0": (2, "time", "pos{joint}", "vel{joint}", "tau{joint}"),
    "laas-odri-cogging/speed_test.parquet": (1, "Time", "Position", "Velocity", "Iq"),
}


@pytest.mark.realdata
@pytest.mark.parametrize("name", REAL_LOGS)
def test_real_logs_raise_no_doubt(name: str) -> None:
    """Recordings of real arms, known to be sound, are read without a refusal, a gap or a doubt."""
    if not (REAL / name).exists():
        pytest.skip(f"{REAL / name} is not there; set PUMAID_REAL_DATA")
    n, time, position, velocity, current = REAL_LOGS[name]
    units = {"time": "ms"} if time == "Time" and n == 7 else {}
    joints = tuple(Joint(k, f"j{k}", "revolute") for k in range(1, n + 1))
    robot = Robot(name, joints, log=LogFormat(time, position, velocity, current, units=units))
    paths = sorted((REAL / name).glob("*.parquet")) if (REAL / name).is_dir() else [REAL / name]
    dataset = ingest(paths, robot)
    assert sum(item.samples for item in (*dataset.runs, *dataset.rejects)) == sum(facts.rows for facts in dataset.files)
    # In some of the double pendulum's recordings a motor is off while its joint swings: its torque is 0 throughout.
    passive = {"current-frozen"} if name.startswith("dfki") else set()
    assert {note.slug for note in dataset.notes} <= {"joint-at-rest"} | passive


@pytest.mark.parametrize(("period", "is_told"), [(0.1, True), (0.05, True), (0.01, False)])
def test_a_current_that_is_held_is_flagged(period: float, is_told: bool) -> None:
    """A value that comes over a slow bus is repeated until the next; twice the sampling interval does no harm."""
    log = good_log()
    last = np.floor(log.time / period + 1e-9).astype(np.int64)
    first = np.searchsorted(last, last)
    found = slugs(replace(log, current=log.current[first]), arm())
    assert ("current-frozen" in found) is is_told and set(found) <= {"current-frozen"}


@pytest.mark.parametrize(("hold", "every"), [(0.8, 6.0), (1.5, 6.0)])
def test_a_current_that_freezes_again_and_again_is_flagged(hold: float, every: float) -> None:
    """Only for a moment each time, but for a good part of the time."""
    log = good_log()
    current = log.current.copy()
    for begin in np.arange(3.0, log.time[-1] - hold, every):
        held = (log.time >= begin) & (log.time < begin + hold)
        current[held, 1] = current[np.argmax(held), 1]
    (note,) = watched(replace(log, current=current), arm())
    assert note.slug == "current-frozen" and "%" in note.text and "joint 2" in str(note)


@pytest.mark.parametrize(("times", "step"), [(2, 1e-6), (3, 2e-4), (10, 1e-6)])
def test_positions_that_are_held_are_flagged(times: int, step: float) -> None:
    """Each position logged several times over, as it is or in an encoder's fine steps."""
    log = good_log()
    first = np.arange(len(log)) // times * times
    position = step * np.round(log.position / step)
    found = watched(replace(log, position=position[first], velocity=None), arm())
    assert {note.slug for note in found} == {"position-held"} and len(found) == 3


@pytest.mark.parametrize("counts", [256, 4096, 1 << 20])
@pytest.mark.parametrize("rate", [100.0, 1000.0])
def test_encoders_of_few_counts_are_not_flagged(counts: int, rate: float) -> None:
    """Between two counts an encoder says the same, however coarse it is; in a text with six places, too."""
    log = good_log(rate=rate)
    quiet = log.position  # noise of the sensor comes before its steps
    count = 2.0 * math.pi / counts
    for places in (6, 12):
        position = np.round(count * np.floor(quiet / count), places)
        found = watched(replace(log, position=position, velocity=None), arm())
        assert "position-held" not in [note.slug for note in found]


@pytest.mark.parametrize(
    ("unit", "slug"), [(86_400.0, "time-unit"), (3600.0, "time-unit"), (60.0, "beyond-limits"), (1e-3, "time-unit")]
)
def test_times_in_other_units_are_told_without_velocities(unit: float, slug: str) -> None:
    """Days fill no window of time, and minutes give a rate that some arms have; neither passes for seconds."""
    log = good_log()
    told = watched(replace(log, time=log.time / unit, velocity=None), arm(max_velocity=1.2))
    assert slug in [item.slug for item in told]


def test_radians_that_are_taken_for_degrees_are_refused() -> None:
    """All positions cover a few degrees and would fit as radians; those in degrees pass, however they are logged."""
    log = good_log()
    tiny = replace(log, position=np.radians(log.position), velocity=None)
    assert [item.slug for item in watched(tiny, arm(units={"position": "deg"})) if isinstance(item, LogError)] == [
        "units-disagree"
    ]
    assert watched(replace(log, velocity=None), arm(units={"position": "deg"})) == []
