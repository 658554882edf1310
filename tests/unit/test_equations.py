"""Equations of runs with added effects, against least squares over every sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from worlds import CRANE, PENDULUM, course, dataset, experiment, run_of
from worlds import drawn as drawn_arm

from pumaid.chosen import in_order
from pumaid.effects import catalogue
from pumaid.knots import spread
from pumaid.loads import loads
from pumaid.model import Model
from pumaid.records import Campaign, Samples
from pumaid.robot import EffectChoice
from pumaid.sight import Sight, samples_of

HOLD = (0.3, 0.4)


def chosen(*names, **shapes):
    """Effects of joint 1 as a model has them."""
    return in_order([EffectChoice(name, 1, shapes.get(name, {})) for name in names])


def every_sample(robot, run, moves):
    """What effects would see if each sample were a bin."""
    t, q, qd, qdd = moves
    position, velocity = np.tile(HOLD, (len(q), 1)), np.zeros((len(q), robot.n_joints))
    position[:, 0], velocity[:, 0] = q, run.speed if run.kind == "constant" else qd
    sign = np.full(len(q), float(run.direction))
    facts = {"time": t - t[0], "elapsed": t - t[0], "travel": np.abs(q - q[0])}
    return Samples(1, position, velocity, acceleration=qdd, direction=sign, **facts)


def runs_with(law, *, kind="constant", samples=4000, bins=200):
    """Runs of joint 1, both ways and at several speeds, that draw ``law(q, qd)`` and a little noise; their courses."""
    rng, found = np.random.default_rng(3), []
    for duration in (2.0, 4.0, 9.0):
        for start, end in ((-1.6, 1.9), (1.9, -1.6)):
            moves = course(kind, start, end, duration=duration, samples=samples)
            way = np.copysign(np.maximum(np.abs(moves[2]), 1e-12), end - start)  # at rest friction keeps its side
            current = law(moves[1], way) + 0.01 * rng.normal(size=samples)
            found.append((run_of(PENDULUM, 1, HOLD, course=moves, current=current, bins=bins), moves, current))
    return found


def dense(model, found):
    """Least squares over every sample: parameters, and sum of squares left."""
    rows = np.vstack([model.regressor(every_sample(PENDULUM, run, moves)) for run, moves, _ in found])
    target = np.concatenate([current for _, _, current in found])
    solution = np.linalg.lstsq(rows, target, rcond=1e-10)[0]
    return solution, float(np.sum((target - rows @ solution) ** 2))


#: The effects' laws once more, per unit: of position, speed and way since the start.
LAWS = {
    "stribeck": ({"velocity": 0.7, "exponent": 1.0}, lambda q, v, x: np.sign(v) * np.exp(-np.abs(v) / 0.7)),
    "position_friction": ({"harmonic": 3.0}, lambda q, v, x: np.sign(v) * np.cos(3.0 * q)),
    "spring": ({}, lambda q, v, x: q),
    "ripple": ({"frequency": 30.0}, lambda q, v, x: np.cos(30.0 * q)),
    "presliding": ({"travel": 0.3}, lambda q, v, x: -np.sign(v) * np.exp(-x / 0.3)),
}


@pytest.mark.parametrize("kind", ["constant", "stroke"])
@pytest.mark.parametrize("name", LAWS)
def test_equations_are_those_of_all_samples(name, kind):
    """Bins give the effect's size that all samples give, also of a ripple of twelve bins a period; the same misfit.

    To a thousandth of the size. Of the misfit to six percent: within bins the noise has a part along the effect that
    means of bins do not show, of a standard deviation of three percent for this ripple.
    """
    shape, law = LAWS[name]
    found = runs_with(lambda q, v: 1.2 * np.cos(q) + 0.4 * np.sign(v) + 0.2 * law(q, v, np.abs(q - q[0])), kind=kind)
    model = Model.of_runs(PENDULUM, [run for run, _, _ in found], chosen(name, **{name: shape}))
    blocks = model.blocks([run for run, _, _ in found])
    rows, target = np.vstack([b.regressors for b in blocks]), np.concatenate([b.target for b in blocks])
    ours, (theirs, left) = np.linalg.lstsq(rows, target, rcond=1e-10)[0], dense(model, found)
    index = [n for n, column in enumerate(model.columns) if column.place is not None]
    assert theirs[index[0]] == pytest.approx(0.2, rel=0.2)
    assert ours[index] == pytest.approx(theirs[index], abs=1e-3 * 0.2)
    ours_left = np.sum((target - rows @ ours) ** 2) + sum(block.beyond(ours) for block in blocks)
    assert ours_left == pytest.approx(left, rel=0.06)


def test_runs_that_an_effect_does_not_touch_keep_their_triangle():
    """An effect of joint 1 changes nothing in the equations of joint 2 but adds columns of zeros."""
    runs = dataset(drawn_arm(PENDULUM), experiment(PENDULUM)).runs
    plain = Model.of_runs(PENDULUM, runs)
    wider = plain.with_effects(chosen("spring"))
    for before, after in zip(plain.blocks(runs), wider.blocks(runs), strict=True):
        if before.run.joint == 2:
            assert np.array_equal(before.regressors, after.regressors[:, :-1]) and not after.regressors[:, -1].any()
            assert np.array_equal(before.target, after.target) and before.rest == after.rest
        else:
            assert np.array_equal(before.target, after.target[: len(before.target)])


def test_an_effect_inside_the_triangle_adds_no_equation():
    """Friction of speed is the same throughout a run at constant speed: the run has the same three equations."""
    runs = [run for run, _, _ in runs_with(lambda q, v: np.cos(q))]
    model = Model.of_runs(PENDULUM, runs, chosen("stribeck", stribeck={"velocity": 0.2, "exponent": 1.0}))
    assert {len(block.target) for block in model.blocks(runs)} == {3}


def test_names_of_added_parameters():
    """EFFECT.jN.SYMBOL; of the whole arm EFFECT.SYMBOL; the second at a joint ends in _2."""
    ripples = [EffectChoice("ripple", 2, {"frequency": f}) for f in (20.0, 40.0)]
    effects = in_order([EffectChoice("stribeck", 1, {}), *ripples, EffectChoice("tilt")])
    names = Model(PENDULUM, (), effects).names[len(Model(PENDULUM).names) :]
    wanted = ["stribeck.j1.a", "ripple.j2.cos", "ripple.j2.sin", "ripple.j2.cos_2", "ripple.j2.sin_2"]
    assert names == (*wanted, "tilt.x", "tilt.y")


def test_derivatives_by_shapes_are_columns():
    """A fitted shape's column is what the current changes per unit of it, here by the law's own derivative."""
    (one,) = chosen("stribeck", stribeck={"velocity": 0.3, "exponent": 1.0})
    one = replace(one, fitted=("velocity",), sizes=(0.2,))
    velocity = np.linspace(0.05, 1.5, 30)[:, None] * [1.0, 0.0]
    samples = Samples(1, np.zeros((30, 2)), velocity, direction=np.ones(30))
    v = velocity[:, 0]
    assert one.columns(PENDULUM, samples)[:, 1] == pytest.approx(0.2 * np.exp(-v / 0.3) * v / 0.3**2, rel=1e-6)


def test_time_counts_from_the_joints_first_motion():
    """On each clock anew, of the joint or (for what befalls the whole arm) of any."""
    runs = [run for run, _, _ in runs_with(lambda q, v: np.cos(q))[:2]]
    late = replace(runs[1], joint=2, start=100.0, bins=replace(runs[1].bins, time=runs[1].bins.time + 100.0))
    other = replace(late, clock=1)
    campaign = Campaign.of([runs[0], late, other])
    seen = [samples_of(run, campaign) for run in (runs[0], late, other)]
    assert [round(float(one.time[0]), 1) for one in seen] == [0.0, 0.0, 0.0]
    assert [round(float(one.elapsed[0]), 1) for one in seen] == [0.0, 100.0, 0.0]


def test_slope_of_a_steady_runs_speed_is_seen_where_asked_for():
    """A run at nearly constant speed has an acceleration for the effect of inertia, and none for the paper's model."""
    t = np.linspace(0.0, 4.0, 4000)
    q, qd, qdd = 0.8 * t + 0.02 * np.cos(2 * t), 0.8 - 0.04 * np.sin(2 * t), -0.08 * np.cos(2 * t)
    run = run_of(PENDULUM, 1, HOLD, course=(t, q, qd, 0 * t), current=np.cos(q), bins=200)
    campaign = Campaign.of([run])
    assert not samples_of(run, campaign).acceleration.any()
    found = samples_of(run, campaign, has_slope=True).acceleration
    truth = np.interp(run.bins.time, t, qdd)
    assert found[10:-10] == pytest.approx(truth[10:-10], abs=0.004)  # 5 % of the largest


def test_loads_between_knots_are_the_loads():
    """Gravity, its slopes and the prediction at every instant are what they are when computed there."""
    truth = drawn_arm(CRANE)
    runs = dataset(truth, experiment(CRANE)).runs
    model, rng = Model.of_runs(CRANE, runs), np.random.default_rng(1)
    solution, scales = rng.normal(size=len(model.names)), np.triu(rng.uniform(0.5, 2.0, (3, 3)))
    for joint in (1, 2, 3):
        sight = Sight.of(CRANE, joint, runs, campaign=Campaign.of(runs))
        here = sight.samples

        def known(samples):
            return loads(model, samples, solution=solution, scales=scales)

        ours, theirs = spread(here, sight.grain * sight.sizes, known), known(here)
        for name in ("own", "others", "slopes", "tilts", "drawn"):
            assert getattr(ours, name) == pytest.approx(getattr(theirs, name), abs=1e-9), name
        assert ours.across == pytest.approx(theirs.across, abs=2e-4 * np.abs(theirs.across).max() + 1e-9)


def test_every_effect_has_columns_of_its_own_names():
    """Each of the catalogue fits into a model: as many columns as parameters, all of them numbers."""
    runs = dataset(drawn_arm(CRANE), experiment(CRANE)).runs
    base = Model.of_runs(CRANE, runs)
    solution, scales = np.ones(len(base.names)), np.triu(np.ones((3, 3)))
    for name, effect in catalogue().items():
        number = 1 if effect.applies(CRANE, 1) is None else 3
        if effect.base or effect.applies(CRANE, number) is not None:
            continue
        joint = None if not effect.parameters(CRANE, 1) else number
        shape = {one.name: one.example for one in effect.shapes(CRANE, joint or 0)}
        model = base.with_effects(in_order([EffectChoice(name, joint, shape)]))
        samples = Sight.of(CRANE, number, runs, campaign=Campaign.of(runs)).samples
        known = loads(base, samples, solution=solution, scales=scales)
        assert np.isfinite(model.regressor(replace(samples, loads=known))).all(), name
