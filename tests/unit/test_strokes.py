"""Strokes through one filter: corners that smoothing blunts, noise in positions and unknown delays bias nothing."""

from __future__ import annotations

import re

import numpy as np
import pytest
from searches import with_current
from worlds import CRANE, course, run_of

from pumaid.dataset import Dataset, Log
from pumaid.estimation.estimate import identify
from pumaid.estimation.gls import fit_bins
from pumaid.joint_bins import joint_bins
from pumaid.model import Model
from pumaid.preprocessing.binning import sliding, stroke_bins
from pumaid.preprocessing.options import SegmentOptions

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


def bias(rate: float, **conditions: float) -> np.ndarray:
    """(5,) mean error over 40 strokes of least squares on their bins, in units of the truth."""
    fitted = []
    for seed in range(40):
        log, window = stroke(rate, seed, **conditions)
        bins = stroke_bins(log, 1, time=log.time, window=window)
        q = bins.position[:, 0]
        columns = [np.cos(q), np.sin(q), np.ones(len(q)), bins.velocity, bins.acceleration]
        fitted.append(np.linalg.lstsq(np.column_stack(columns), bins.current, rcond=None)[0])
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


def test_too_few_currents_make_no_stroke():
    """Of some twenty currents averages would be off by more than blunt corners make of plain samples."""
    log, window = stroke(60.0, 1, lost=0.8)
    assert stroke_bins(log, 1, time=log.time, window=window) is None


def late_runs(seed: int, delay: float):
    """Runs of a crane's slide: some at constant speed, many strokes as short as half a second; currents come late."""
    rng, runs = np.random.default_rng(seed), []
    for kind, duration in 12 * [("constant", 2.0)] + 16 * [("stroke", 0.6)]:
        way = 0.06 * rng.choice([-1.0, 1.0]) * rng.choice([0.5, 1.0, 2.0])
        moves = course(kind, -way, way, duration=duration, samples=80)
        time, _, speed, pull = moves
        rise = np.gradient(0.3 * np.sign(way) + 0.7 * speed + 0.8 * pull, time)
        current = 2.0 + np.sign(way) + 0.7 * speed + 0.8 * pull - delay * rise + SIGMA * rng.normal(size=80)
        runs.append(run_of(CRANE, 2, (0.1, 0.0, 0.3), course=moves, current=current))
    return runs


@pytest.mark.parametrize("delay", [0.0, 0.001, 0.003])
def test_an_unknown_delay_is_no_viscous_friction(delay):
    """Whether currents come 0, 1 or 3 ms late, intervals of viscous friction hold the truth, though strokes help."""
    z = []
    for seed in range(20):
        found = identify(Dataset(tuple(late_runs(seed, delay))), CRANE)
        values = [found.value(f"viscous.j2.{way}") for way in ("plus", "minus")]
        z += [(value.value - 0.7) / value.std_error for value in values]
    assert np.sqrt(np.mean(np.square(z))) < 1.5


@pytest.mark.parametrize("delay", [0.0, 0.002])
def test_strokes_alone_tell_of_a_delay(delay):
    """Where a joint has nothing but strokes, a delay that moves its friction is told, with what it would be then."""
    told = []
    for seed in range(10):
        runs = tuple(run for run in late_runs(seed, delay) if run.kind == "stroke")
        found = [note for note in identify(Dataset(runs), CRANE).notes if note.slug == "strokes-late"]
        told += [float(re.search(r"viscous\.j2\.\w+ would be ([\d.]+)", note.text)[1]) for note in found]
    assert len(told) == 10 and told == pytest.approx([0.7] * 10, rel=0.05) if delay else len(told) <= 1


def test_a_fit_weighs_strokes_as_its_linearisation_does():
    """Covariance (1e-9) is that of the whitened Jacobians and priors, where strokes are noisier than other runs."""
    rng = np.random.default_rng(2)
    runs = [
        with_current(run, 3.0 * SIGMA * rng.normal(size=len(run.bins))) if run.kind == "stroke" else run
        for run in late_runs(1, 0.0)
    ]
    fitted = fit_bins(Model.of_runs(CRANE, runs), joint_bins(CRANE, runs, is_settled=False))
    assert fitted.levels[2].loud > 2.0
    information, row = np.diag(fitted.prior**2), fitted.row(2)
    information[np.ix_(row.acting, row.acting)] += row.slim.T @ row.slim
    errors = np.sqrt(np.diag(fitted.inverse))
    errors = np.outer(errors, errors) + np.finfo(float).tiny
    again = fitted.inverse @ information @ fitted.inverse  # an inverse where runs tell all, else a pseudo-inverse
    np.testing.assert_allclose(again / errors, fitted.inverse / errors, atol=1e-6)
