"""Strokes: corners that smoothing blunts and noise in positions bias nothing, and no effect beside them."""

from functools import cache

import numpy as np
import pytest
from worlds import course, run_of

from pumaid.dataset import Dataset, Log, first_motions
from pumaid.effect_spec import expanded
from pumaid.effects import catalogue
from pumaid.estimation.estimate import identify
from pumaid.estimation.fit import Fit
from pumaid.estimation.nonlinear import fit_effects, search_bounds
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.model import Model
from pumaid.preprocessing.binning import SegmentOptions, sliding
from pumaid.preprocessing.parallel_filter import stroke_bins
from pumaid.preprocessing.segment import segment
from pumaid.robot import EffectChoice, Joint, Robot
from pumaid.simulation import draw, simulate
from pumaid.simulation.hidden_effects import parse
from pumaid.trajectory import Motion, Plan

LEVER = Robot("lever", (Joint(1, "lever", "revolute"),), (0.0, -9.80665, 0.0))
#: A by cosine, sine, one, rad/s and rad/s2; A of noise.
TRUTH, SIGMA = np.array([3.0, 0.5, 1.0, 0.4, 0.6]), 0.02
#: rad/s, rad/s2 and rad of a movement whose speed is a trapezoid: its acceleration jumps four times.
SPEED, PULL, WAY = 1.5, 4.0, 1.8


def trapezoid(time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, velocity and acceleration, in closed form, of a movement that begins at 0 s."""
    ramp = SPEED / PULL
    end = WAY / SPEED + ramp
    pull = np.where((time > 0) & (time < ramp), PULL, np.where((time > end - ramp) & (time < end), -PULL, 0.0))
    speed = np.clip(np.minimum(PULL * time, PULL * (end - time)), 0.0, SPEED)
    early, late = np.clip(time, 0.0, ramp), np.clip(end - time, 0.0, ramp)
    middle = SPEED * np.clip(time - ramp, 0.0, end - 2 * ramp)
    return -1.0 + 0.5 * PULL * (early**2 + ramp**2 - late**2) + middle, speed, pull


def stroke(rate: float, seed: int, *, count: float = 1e-5, jitter: float = 0.0, lost: float = 0.0, one_in: int = 1):
    """Its samples while the joint slides, and the span of the local cubics (s)."""
    rng = np.random.default_rng(seed)
    time = np.arange(-0.5, WAY / SPEED + SPEED / PULL + 0.5, 1.0 / rate) + rng.uniform(-0.5, 0.5) / rate
    time += jitter / rate * rng.uniform(-1.0, 1.0, len(time))
    q, speed, pull = trapezoid(time)
    current = np.column_stack([np.cos(q), np.sin(q), speed > 0, speed, pull]) @ TRUTH
    current += SIGMA * rng.normal(size=len(time))
    current[(rng.random(len(time)) < lost) | (np.arange(len(time)) % one_in != seed % one_in)] = np.nan
    q = np.round(q / count) * count
    moving = np.flatnonzero(speed > 0)
    bounds = (int(moving[0]), int(moving[-1]) + 1)
    start, stop, window, _ = sliding(time, q, bounds, noise=count / 12**0.5, options=SegmentOptions())
    log = Log("a.csv", np.arange(len(time)), time, q[:, None], None, current[:, None])
    return log.part(slice(start, stop)), window


def bias(rate: float, *, alike: float = 0.0, **conditions: float) -> np.ndarray:
    """(5,) mean error over 40 strokes of least squares on their bins, in units of the truth.

    It is weighted for noise of which neighbouring bins share `alike`.
    """
    fitted = []
    for seed in range(40):
        log, window = stroke(rate, seed, **conditions)
        bins = stroke_bins(log, 1, time=log.time, window=window)
        q = bins.position[:, 0]
        columns = [np.cos(q), np.sin(q), np.ones(len(q)), bins.velocity, bins.acceleration]
        table = np.column_stack([*columns, bins.current])
        table = table[1:] - alike * table[:-1]
        fitted.append(np.linalg.lstsq(table[:, :-1], table[:, -1], rcond=None)[0])
    return (np.mean(fitted, axis=0) - TRUTH) / TRUTH


@pytest.mark.parametrize(
    ("rate", "conditions", "within"),
    [
        *((rate, more, 0.003) for rate in (125.0, 250.0, 1000.0) for more in ({}, {"jitter": 0.2}, {"lost": 0.1})),
        (62.0, {}, 0.01),
        # Currents made up between the measured ones would make it 1 to 2 % too small.
        *((250.0, {"one_in": every}, within) for every, within in ((2, 0.003), (5, 0.01), (10, 0.01))),
        # Noise in an acceleration would make its parameter too small.
        *((rate, {"count": 1e-3}, 0.007) for rate in (125.0, 250.0, 500.0, 1000.0)),
    ],
    ids=str,
)
def test_sharp_corners_make_no_inertia(rate, conditions, within):
    """The inertia of a trapezoid of speed is right to 0.3 %, to 1 % of few samples or through a coarse encoder."""
    found = bias(rate, **conditions)
    assert abs(found[4]) < within and (within > 0.003 or "one_in" in conditions or abs(found[1]) < 0.02)


@pytest.mark.parametrize("rate", [250.0, 500.0, 1000.0])
def test_inertia_is_right_where_noise_is_slow(rate):
    """Weights for slow noise ask what changes from bin to bin, where noise in accelerations was most of them."""
    assert abs(bias(rate, alike=0.7, count=1e-3)[4]) < 0.02


def test_too_few_currents_make_no_stroke():
    """Of some twenty currents averages would be off by more than blunt corners make of plain samples."""
    log, window = stroke(60.0, 1, lost=0.8)
    assert stroke_bins(log, 1, time=log.time, window=window) is None


@pytest.mark.parametrize("wrong", [0.0, 1.0])
def test_strokes_that_contradict_other_runs_move_no_friction(wrong):
    """Five strokes that draw 1 A more than they should count for little beside twenty runs at constant speed."""
    rng, runs = np.random.default_rng(4), []
    for number in range(25):
        kind, way = ("stroke", "constant")[number % 5 > 0], (-1.5, 1.5)[number % 2]
        moves = course(kind, -way, way, duration=1.0 + 0.2 * (number % 7), samples=400)
        _, q, speed, pull = moves
        current = 3.0 * np.cos(q) + 0.5 * np.sign(way) + 0.2 * speed + 0.3 * pull + wrong * (kind == "stroke")
        current += SIGMA * rng.normal(size=400) + 0.5 * SIGMA * rng.normal()
        runs.append(run_of(LEVER, 1, (0.0,), course=moves, current=current))
    estimate = identify(Dataset(tuple(runs)), LEVER)
    for name, value in (("coulomb.j1.plus", 0.5), ("viscous.j1.plus", 0.2), ("viscous.j1.minus", 0.2)):
        assert abs(estimate.value(name).value - value) < 4.0 * estimate.value(name).std_error < 0.06
    assert ("model-misses" in [note.slug for note in estimate.notes]) == bool(wrong)


PENDULUM = read_recipe(shipped_recipes()["pendulum2"])
HOLD, SPEEDS, FAST = (0.4, 0.4), (0.05, 0.1, 0.2, 0.5, 1.0, 1.6), 1.6
#: rad/s at which a third of the hidden friction is left.
VELOCITY = 0.15
FREE = EffectChoice("stribeck", 1, {"exponent": 1.0})


def motions(joint: int) -> list[Motion]:
    """Runs both ways at every speed, and five motions there and back too short to hold theirs."""
    ends = [(min(1.2, 5.0 * speed), speed) for speed in SPEEDS] + [(0.15 + 0.03 * k, FAST) for k in range(5)]
    return [Motion(joint, HOLD, -way * end, way * end, speed) for end, speed in ends for way in (1, -1)]


@cache
def logged() -> Dataset:
    """What a robot in closed loop logs of the plan, twice over, its joint 1 with Stribeck friction."""
    truth = draw(PENDULUM, 0).hiding((parse(f"stribeck@1:velocity={VELOCITY},exponent=1", PENDULUM),))
    plan = Plan(PENDULUM.name, tuple(2 * (motions(1) + motions(2))))
    return segment(simulate(truth.robot, plan, truth=truth, seed=0, rate=100.0), PENDULUM)


def fitted(kinds: tuple[str, ...]) -> Fit:
    """The fit of runs of some kinds, its friction with the hidden velocity."""
    runs = [run for run in logged().runs if run.kind in kinds]
    wanted = expanded([EffectChoice("stribeck", 1, {"exponent": 1.0, "velocity": VELOCITY})], PENDULUM)
    return fit_effects(Model.of_runs(PENDULUM, runs), runs, wanted, begun=first_motions(runs)).fit


@pytest.mark.slow
def test_the_hidden_velocity_is_within_its_interval():
    """The Stribeck velocity of a robot in closed loop is found although strokes are among its runs."""
    low, high = identify(logged(), PENDULUM, effects=[FREE]).value("stribeck.j1.velocity").ci95
    assert low <= VELOCITY <= high < 2.0 * low


def test_strokes_do_not_pass_for_noise_of_other_runs():
    """A joint's noise at constant speed is with strokes what it is without them."""
    alone, both = (fitted(kinds) for kinds in (("constant",), ("constant", "stroke")))
    noises = [fit.noises[2].spread[~fit.by_bin[2].bins.accelerates] for fit in (alone, both)]
    # Equations of 24 runs know a variance to some 15 %.
    assert np.mean(noises[1] ** 2) == pytest.approx(np.mean(noises[0] ** 2), rel=0.3)


def test_a_shape_is_not_looked_for_far_beyond_the_runs():
    """A fall of friction is looked for at up to twice the speeds of its grid; beyond, it is a viscous curve."""
    velocity, exponent = catalogue()["stribeck"].shapes(PENDULUM, 1)
    assert search_bounds(velocity, [{"velocity": 0.1}, {"velocity": 1.0}]) == (0.05, 2.0)
    assert search_bounds(exponent, [{"exponent": 1.0}, {"exponent": 2.0}]) == (0.5, 2.0)
