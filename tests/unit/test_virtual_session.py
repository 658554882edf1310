"""What a virtual robot's log holds, sample by sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pumaid.errors import ModelError
from pumaid.records import Motion, Plan
from pumaid.verbs.simulate import simulate
from pumaid.virtual import Noise, Session, draw, table1
from pumaid.virtual.timing import Trapezoid, accelerations

RATE = 200.0
PUMA = table1.puma560()
#: Two motions with a move between them.
SHORT = Plan(
    robot="PUMA 560",
    motions=(
        Motion(2, (0.0, 0.0, 1.0, 0.0, 0.0, 0.0), -1.0, 1.0, 0.5),
        Motion(3, (0.0, -0.5, 0.0, 0.3, 0.0, 0.0), 1.0, -1.0, 0.8),
    ),
)


def session(truth=PUMA, plan=SHORT, seed=1, **options) -> dict[str, np.ndarray]:
    """A whole session's arrays."""
    logs = list(Session(truth, plan, np.random.default_rng(seed), rate=RATE, **options).logs())
    names = ("time", "position", "velocity", "current")
    return {name: np.concatenate([getattr(log, name) for log in logs]) for name in names}


def acceleration(found: dict[str, np.ndarray]) -> np.ndarray:
    """(N, J) by central differences of the noise-free velocity."""
    return np.gradient(found["velocity"], 1.0 / RATE, axis=0)


def test_cruise_carries_gravity_and_friction_only():
    """At constant speed a noise-free joint draws gravity plus Coulomb plus viscous current of its direction."""
    found = session(PUMA.with_noise(0.0))
    # Not the sample at which braking begins: its speed is still whole.
    cruising = (np.abs(found["velocity"][:, 1] - 0.5) < 1e-9) & (np.abs(acceleration(found)[:, 1]) < 1e-9)
    wanted = PUMA.gravity_current(found["position"][cruising])[:, 1]
    wanted = wanted + PUMA.friction.coulomb_plus[1] + 0.5 * PUMA.friction.viscous_plus[1]
    assert np.count_nonzero(cruising) > 3 * RATE
    assert np.max(np.abs(found["current"][cruising, 1] - wanted)) < 1e-12


def test_ramp_carries_inertia():
    """What a ramp draws beyond gravity and friction is inertia times acceleration."""
    found = session(PUMA.with_noise(0.0))
    q, v, i = (found[name][:, 1] for name in ("position", "velocity", "current"))
    a = acceleration(found)[:, 1]
    ramp = float(accelerations(PUMA.robot)[1])
    # Away from the corners of the speed the difference of velocities is the acceleration itself.
    rising = (np.abs(a - ramp) < 1e-6) & (v > 0.05) & (v < 0.45) & (q < 0)
    rest = i - PUMA.gravity_current(found["position"])[:, 1]
    rest = rest - PUMA.friction.coulomb_plus[1] - v * PUMA.friction.viscous_plus[1]
    assert np.count_nonzero(rising) > 5
    assert rest[rising] == pytest.approx(PUMA.inertia[1] * ramp, abs=1e-9)


def test_held_joint_is_carried_by_gravity_and_a_constant():
    """A joint that rests draws its changing gravity load plus what stiction was left with."""
    found = session(PUMA.with_noise(0.0))
    first = found["time"] < 3.0
    rest = (found["current"] - PUMA.gravity_current(found["position"]))[first, 2]
    assert np.ptp(rest) < 1e-12
    assert 0.0 < abs(rest[0]) < abs(PUMA.friction.coulomb_plus[2])


def test_position_is_the_sum_of_velocity():
    """Positions follow from velocities without a jump, also from file to file and between postures."""
    found = session(PUMA.with_noise(0.0), runs_per_file=1)
    step = 0.5 * (found["velocity"][1:] + found["velocity"][:-1]) / RATE
    # A trapezoid's corner between two samples costs at most half an acceleration times the interval squared.
    corner = 0.5 * np.max(accelerations(PUMA.robot)) / RATE**2
    assert np.max(np.abs(np.diff(found["position"], axis=0) - step)) < corner
    assert np.diff(found["time"]) == pytest.approx(1.0 / RATE, abs=1e-9)


def test_noise_has_the_promised_size():
    """Noise of one run is level plus correlated noise, each of the size that the truth states."""
    quiet, truth = session(PUMA.with_noise(0.0)), replace(PUMA, noise=Noise(np.full(6, 0.1), level_share=0.5))
    first = quiet["time"] < 4.0
    levels, sizes = [], []
    for seed in range(40):
        noise = (session(truth, seed=seed)["current"] - session(PUMA.with_noise(0.0), seed=seed)["current"])[first, 5]
        levels.append(noise.mean())
        sizes.append(noise.var())
    # 40 levels know their variance to 23 % (one sigma); three sigmas are allowed. The noise knows its own to 3 %.
    assert np.var(levels) == pytest.approx(0.1**2 * 0.5, rel=0.7)
    assert np.mean(sizes) == pytest.approx(0.1**2 * 0.5, rel=0.1)


def test_noise_is_correlated_in_time():
    """Noise at two instants one correlation time apart is correlated by 1/e, whatever the rate."""
    truth = replace(PUMA, noise=Noise(np.full(6, 0.1), level_share=0.0, correlation_time=0.05))
    noise = session(truth)["current"] - session(PUMA.with_noise(0.0))["current"]
    quiet = noise[:, [0, 3, 4, 5]]
    lag = round(0.05 * RATE)
    found = np.mean(quiet[lag:] * quiet[:-lag]) / np.mean(quiet**2)
    # Four series of some 100 correlation times each: a standard error of about 0.05.
    assert found == pytest.approx(np.exp(-1.0), abs=0.15)


def test_encoder_and_sensor_have_steps():
    """Positions and currents are whole multiples of the encoder's and the sensor's step."""
    truth = draw(table1.robot(), 3)
    found = session(truth)
    counts = found["position"] * truth.noise.counts
    assert np.max(np.abs(counts - np.round(counts))) < 1e-6
    steps = found["current"] / truth.noise.current_step
    assert np.max(np.abs(steps - np.round(steps))) < 1e-6


def test_same_seed_same_log():
    """The seed decides everything."""
    first, again, other = (session(draw(table1.robot(), 3), seed=seed)["current"] for seed in (7, 7, 8))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_files_share_one_clock():
    """Only the first batch starts a clock; rows begin at 2 in every file."""
    logs = list(Session(PUMA, SHORT, np.random.default_rng(1), rate=RATE, runs_per_file=1).logs())
    assert [log.origin for log in logs] == ["session_01", "session_02", "session_02"]
    assert [log.starts_clock for log in logs] == [True, False, False]
    assert [int(log.rows[0]) for log in logs] == [2, 2, 2 + len(logs[1])]


def test_long_stretches_come_in_parts(monkeypatch):
    """A run that is cut into batches is the run itself: nothing but its noise depends on where it is cut."""
    whole = session(PUMA.with_noise(0.0))
    monkeypatch.setattr("pumaid.virtual.session.CHUNK", 100)
    parts = session(PUMA.with_noise(0.0))
    assert all(np.array_equal(parts[name], whole[name]) for name in whole)
    logs = list(Session(PUMA, SHORT, np.random.default_rng(1), rate=RATE).logs())
    assert max(len(log) for log in logs) == 100
    assert [log.starts_clock for log in logs].count(True) == 1


def test_velocity_can_be_absent():
    """A log without velocities has none, not zeros."""
    logs = Session(PUMA, SHORT, np.random.default_rng(1), rate=RATE, has_velocity=False).logs()
    assert all(log.velocity is None for log in logs)


def test_short_way_never_reaches_the_speed():
    """A way too short for the ramps is a triangle of speed that still ends where it should."""
    path = Trapezoid(0.0, 0.1, 5.0, 2.0)
    position, velocity, _ = path.at(np.array([0.0, path.duration / 2, path.duration, path.duration + 1.0]))
    assert position == pytest.approx([0.0, 0.05, 0.1, 0.1], abs=1e-12)
    assert velocity == pytest.approx([0.0, path.peak, 0.0, 0.0], abs=1e-12)
    assert path.peak < 5.0


@pytest.mark.parametrize(
    ("plan", "rate", "slug"),
    [
        (replace(SHORT, motions=(Motion(1, (0.0, 0.0), 0.0, 1.0, 0.5),)), RATE, "plan-misfit"),
        (replace(SHORT, motions=(Motion(7, (0.0,) * 6, 0.0, 1.0, 0.5),)), RATE, "plan-misfit"),
        (replace(SHORT, motions=(replace(SHORT.motions[0], velocity=0.0),)), RATE, "plan-misfit"),
        (SHORT, 0.0, "rate-impossible"),
        (SHORT, 1e9, "rate-impossible"),
        (SHORT, float("nan"), "rate-impossible"),
    ],
)
def test_nonsense_is_refused(plan, rate, slug):
    """Another arm's plan, a joint that is not there, a rate that is none."""
    with pytest.raises(ModelError) as caught:
        simulate(PUMA.robot, plan, rate=rate)
    assert caught.value.slug == slug
