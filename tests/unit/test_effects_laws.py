"""Laws of effects against what the books say of them, worked out another way; where they cannot act."""

from dataclasses import replace

import numpy as np
import pytest
from worlds import CRANE, PENDULUM

from pumaid.effects import Extent, Loads, Samples, Trace, catalogue
from pumaid.robot import Joint, Robot

COUNT = 50


def seen(*, way: float = 1.0, **given) -> Samples:
    """Instants of joint 1 of a pendulum, all as usual but for what is given; loads by name of their fields."""
    held = {"position": 0.6, "speed": 0.5, "travel": 1.0, "time": 100.0, "temperature": 30.0, "own": 1.0, "drawn": 2.0}
    unknown = set(given) - set(held)
    assert not unknown
    values = {name: np.broadcast_to(given.get(name, value), COUNT).astype(float) for name, value in held.items()}
    position, velocity = np.zeros((COUNT, 2)), np.zeros((COUNT, 2))
    position[:, 0], velocity[:, 0] = values["position"], way * values["speed"]
    own, nothing = values["own"], np.zeros((COUNT, 2))
    loads = Loads(own, nothing, nothing, nothing, np.abs(own), values["drawn"], np.ones(2))
    filled = {name: values[name] for name in ("travel", "time", "temperature")}
    return Samples(
        1, position, velocity, np.ones(COUNT), np.full(COUNT, way), elapsed=values["time"], loads=loads, **filled
    )


def current(name: str, samples: Samples, size=1.0, **shape: float) -> np.ndarray:
    """The current of an effect of joint 1 of this size."""
    columns = catalogue()[name].columns(PENDULUM, samples, number=1, shape=shape)
    return columns @ np.broadcast_to(size, columns.shape[1])


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("own", [2.0, -2.0])
def test_load_friction_is_a_gears_efficiency(own, way):
    """A gear that passes on 80 % of the power lets 80 % of it through, up and down, in either sense of the load."""
    drive, back = 1.0 / 0.8 - 1.0, 1.0 - 0.8
    motor = own + current("load_friction", seen(own=own, way=way), [drive, back])[0]
    lifts = own * way > 0
    power_in, power_out = (motor, own) if lifts else (own, motor)
    assert power_out / power_in == pytest.approx(0.8)


def test_presliding_is_dahls():
    """The current after a reversal follows Dahl's equation dF/dx = sigma (1 - F/F_C), integrated step by step."""
    coulomb, stiffness, steps = 0.4, 20.0, 20000
    travel = np.linspace(0.0, 0.2, steps + 1)
    force = np.empty(steps + 1)
    force[0] = -coulomb  # what the motion the other way left behind
    for k in range(steps):
        force[k + 1] = force[k] + (travel[1] - travel[0]) * stiffness * (1.0 - force[k] / coulomb)
    at = np.linspace(0, steps, COUNT).astype(int)
    shown = coulomb + current("presliding", seen(travel=travel[at]), 2.0 * coulomb, travel=coulomb / stiffness)
    assert np.allclose(shown, force[at], atol=1e-3 * coulomb)  # Euler's steps of 1e-5 rad


def test_temperature_that_is_missing_counts_as_the_reference():
    """Without a temperature the effect is nothing; with one it is in proportion to what is above the reference."""
    samples = seen(temperature=np.where(np.arange(COUNT) < 10, np.nan, 35.0))
    found = current("thermal_friction", samples, 0.01)
    assert np.allclose(found[:10], 0.0) and np.allclose(found[10:], 0.1)


def test_counterbalance_is_the_slope_of_its_cylinders_length():
    """A cylinder with a constant force does work as its length changes: the current is that work's slope."""
    lever, foot, in_line, force, step = 0.3, 0.8, 0.4, 5.0, 1e-6
    q = np.linspace(-2.5, 2.5, COUNT)

    def length(angle: np.ndarray) -> np.ndarray:
        return np.hypot(foot - lever * np.cos(angle - in_line), lever * np.sin(angle - in_line))

    wanted = force * (length(q + step) - length(q - step)) / (2.0 * step)
    found = current("counterbalance", seen(position=q), force * lever, length=lever / foot, angle=in_line)
    assert np.allclose(found, wanted, atol=1e-8)


@pytest.mark.parametrize("name", [n for n, e in catalogue().items() if Trace.DIRECTION in e.trace and not e.base])
def test_friction_turns_round_with_the_motion(name):
    """What a direction shows changes its sign with it, all else equal."""
    effect = catalogue()[name]
    size = [1.0] * len(effect.parameters(PENDULUM, 1))
    shape = {one.name: one.example for one in effect.shapes(PENDULUM, 1)}
    there, back = (current(name, seen(way=way, own=1.0), size, **shape) for way in (1.0, -1.0))
    assert np.allclose(there, -back)


EXTENT = Extent(1, (0.1, 0.5), (-1.3, 1.1), 0.03, 2.4, tuple(60.0 * k for k in range(30)), 1800.0, 3.0)


def test_ripples_grid_begins_with_the_gear():
    """Where the recipe has a gear, multiples of it that the bins can show are tried as they are."""
    geared = replace(PENDULUM, joints=(replace(PENDULUM.joints[0], gear_ratio=-30.0), PENDULUM.joints[1]))
    starts = [start["frequency"] for start in catalogue()["ripple"].grid(geared, EXTENT)]
    assert starts[:3] == [30.0, 60.0, 180.0] and max(starts) <= 2.0 * np.pi / EXTENT.finest * (1.0 + 1e-12)


@pytest.mark.parametrize("name", ["friction_step", "payload"])
def test_changes_are_looked_for_in_the_pauses(name):
    """Between any two runs is one instant, after the first has ended even where it takes nearly all the time."""
    effect = catalogue()[name]
    times = np.array([start["time"] for start in effect.grid(PENDULUM, EXTENT)])
    starts = np.array(EXTENT.starts)
    assert len(times) == len(starts) - 1 and (times > starts[:-1] + 0.95 * 60.0).all() and (times < starts[1:]).all()


def test_long_campaigns_try_few_instants():
    """Of 500 runs, 40 instants are tried, from the second run to the last."""
    long = replace(EXTENT, starts=tuple(60.0 * k for k in range(500)))
    times = [start["time"] for start in catalogue()["friction_step"].grid(PENDULUM, long)]
    assert len(times) == 40 and times[0] < 60.0 and times[-1] > 498 * 60.0


def test_prismatic_load_on_a_turning_joint():
    """The mass beyond a slide presses the turning joint before it by its displacement, offset included."""
    # The crane's first axis is level; with both turning joints at 0 the slide points along its link.
    position = np.array([[0.3, 0.2, 0.0], [0.3, 0.5, 0.0]])
    columns = catalogue()["gravity"].columns(CRANE, Samples(1, position, np.zeros((2, 3))), number=2)
    assert columns[1, 0] / columns[0, 0] == pytest.approx((0.5 + 0.1) / (0.2 + 0.1))


#: A turning joint and a slide, both upright: the one feels no weight, the other always the same.
UPRIGHT = Robot("upright", (Joint(1, "turn", "revolute"), Joint(2, "slide", "prismatic")))


@pytest.mark.parametrize(
    ("name", "joint", "word"),
    [
        ("load_friction", 1, "gravity"),
        ("load_friction", 2, "Coulomb"),
        ("delay", 1, "gravity"),
        ("flexibility", 2, "slides"),
        ("counterbalance", 2, "Coulomb"),
        ("zero_offset", 1, "gravity"),
        ("zero_offset", 2, "lever"),
        ("coupling", 1, "before"),
    ],
)
def test_refuses_where_it_cannot_act(name, joint, word):
    """An effect says why it cannot act at a joint."""
    assert word in str(catalogue()[name].applies(UPRIGHT, joint))


@pytest.mark.parametrize("name", ["load_friction", "flexibility", "delay", "payload", "side_load_friction"])
def test_acts_where_gravity_does(name):
    """Effects of the load act on a joint whose axis is level."""
    assert catalogue()[name].applies(PENDULUM, 1) is None


def test_stribeck_falls_to_an_e_th():
    """At rest all of it, at v_s a share 1/e, whatever the exponent; far above nothing."""
    for d in (0.5, 1.0, 2.0):
        found = [current("stribeck", seen(speed=v), velocity=0.2, exponent=d)[0] for v in (0.0, 0.2, 1000.0)]
        assert found == pytest.approx([1.0, np.exp(-1.0), 0.0], abs=1e-12)


@pytest.mark.parametrize("p", [0.3, 1.7])
def test_a_power_law_is_straight_in_logarithms(p):
    """Ten times the speed is 10^p times the current, and the parameter is the current at unit speed."""
    slow, fast, unit = (current("viscous_power", seen(speed=v), exponent=p)[0] for v in (0.05, 0.5, 1.0))
    assert np.log10(fast / slow) == pytest.approx(p) and unit == pytest.approx(1.0)


def test_time_constants():
    """After one T friction is down to 1/e of what it was at the start, and a drift has 1/e of its way still to go."""
    friction = [current("warmup", seen(time=t), time_constant=300.0)[0] for t in (0.0, 300.0)]
    drift = [current("torque_constant_drift", seen(time=t, drawn=1.0), time_constant=300.0)[0] for t in (0.0, 300.0)]
    assert friction == pytest.approx([1.0, np.exp(-1.0)]) and drift == pytest.approx([0.0, 1.0 - np.exp(-1.0)])


def test_friction_comes_at_its_instant():
    """Nothing before, all of it after."""
    found = current("friction_step", seen(time=np.linspace(0.0, 100.0, COUNT)), 0.3, time=50.0)
    assert np.array_equal(np.unique(found), [0.0, 0.3]) and (found > 0).sum() == COUNT // 2


def test_position_friction_repeats_with_each_part_of_a_turn():
    """Friction of harmonic k is the same after a turn's k-th part, and turns round with the motion."""
    q = np.linspace(-2.0, 2.0, COUNT)
    here, there = (current("position_friction", seen(position=q + w), harmonic=3.0) for w in (0.0, 2.0 * np.pi / 3.0))
    back = current("position_friction", seen(position=q, way=-1.0), harmonic=3.0)
    assert np.allclose(here, there) and np.allclose(here, -back)


def test_saturation_clips():
    """The prediction with the effect of size 1 is the prediction clipped, in both senses."""
    drawn = np.linspace(-4.0, 4.0, COUNT)
    assert np.allclose(drawn + current("saturation", seen(drawn=drawn), limit=2.5), np.clip(drawn, -2.5, 2.5))


def test_droop_is_the_first_term_of_a_saturating_motor():
    """A motor whose torque bends as i - a i^3 needs i + a i^3 for the torque of i, to the first order in a."""
    wanted, a = np.linspace(-2.0, 2.0, COUNT), 1e-4
    needed = wanted.copy()
    for _ in range(20):
        needed = wanted + a * needed**3
    assert np.allclose(wanted + current("torque_droop", seen(drawn=wanted), a), needed, atol=100.0 * a**2)


def test_ripples_grid_loses_little_between_its_frequencies():
    """A ripple of any frequency in the range keeps 94 % of its power at the nearest frequency of the grid."""
    rng, q = np.random.default_rng(0), np.linspace(*EXTENT.position, 400)
    grid = np.array([start["frequency"] for start in catalogue()["ripple"].grid(PENDULUM, EXTENT)])
    kept = []
    for frequency in rng.uniform(grid.min(), grid.max(), 200):
        signal = np.sin(frequency * q + rng.uniform(0.0, 7.0))
        nearest = grid[np.abs(grid - frequency).argmin()]
        basis = np.column_stack([np.cos(nearest * q), np.sin(nearest * q)])
        left = signal - basis @ np.linalg.lstsq(basis, signal, rcond=None)[0]
        kept.append(1.0 - (left @ left) / (signal @ signal))
    assert min(kept) > 0.94
