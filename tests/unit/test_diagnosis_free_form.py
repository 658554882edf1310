"""Shapes without a name: hats that add up to one, the place of a bump, and the variable that it is in."""

from __future__ import annotations

import numpy as np
import pytest
from searches import LEVER, Din, Lab, design, left, lever, pendulum, roots, with_current

from pumaid.diagnosis.free_form import FORMS, forms, free_form_scores, hats, knot_values, variable
from pumaid.diagnosis.stepwise import evidence
from pumaid.diagnosis.verdict import joint_verdict
from pumaid.estimation.fit import Fit


def test_hats_add_up_to_one():
    """Everywhere between the ends, uneven knots or not; beyond them the last counts whole."""
    knots = np.array([0.0, 0.3, 1.0, 1.1])
    x = np.linspace(-0.5, 1.6, 400)
    found = hats(x, knots)
    np.testing.assert_allclose(found.sum(axis=1), 1.0, atol=1e-12)
    assert np.all((found >= 0.0) & (np.count_nonzero(found, axis=1) <= 2)[:, None])
    np.testing.assert_allclose(hats(knots, knots), np.eye(4), atol=1e-12)


def test_hats_interpolate():
    """With values at the knots they are straight lines between them."""
    knots, values = np.array([0.0, 0.3, 1.0, 1.1]), np.array([1.0, -2.0, 0.5, 3.0])
    x = np.linspace(0.0, 1.1, 300)
    np.testing.assert_allclose(hats(x, knots) @ values, np.interp(x, knots, values), atol=1e-12)


def hiding(lab: Lab, current, seed: int = 1) -> Fit:
    """An experiment in which a joint draws `current` (q, s, v, t, travel) more; noise as it is without that."""
    runs, plain = [], lab.noisy(seed, Din(spread=0.01, correlation=0.5, level=0.004))
    for run in plain:
        own = run.joint - 1
        q, v = run.bins.position[:, own], run.bins.velocity
        more = current(q=q, s=float(run.direction), v=v, t=run.bins.time, travel=np.abs(q - run.span[0]))
        runs.append(with_current(run, more if run.joint == lab.robot.n_joints else 0.0 * q))
    return lab.fitted(runs, noises=lab.fitted(plain).noises)


def bump(x, at: float, width: float):
    """One at `at`."""
    return np.exp(-(((x - at) / width) ** 2))


#: s: middle of the campaign.
T = 0.5 * (lever().runs[0].start + lever().runs[-1].start)
#: Form -> a current of that form.
HIDDEN = {
    "f(q)": lambda q, s, v, t, travel: 0.05 * bump(q, 0.6, 0.3),
    # Where the load changes little: elsewhere place and load say the same of this arm.
    "s f(q)": lambda q, s, v, t, travel: 0.05 * s * bump(q, -0.6, 0.3),
    "v f(q)": lambda q, s, v, t, travel: 0.08 * v * bump(q, 0.6, 0.3),
    "s f(v)": lambda q, s, v, t, travel: 0.05 * s * bump(np.abs(v), 0.5, 0.1),
    "s f(t)": lambda q, s, v, t, travel: 0.05 * s * bump(t, T, 60.0),
    "f(t)": lambda q, s, v, t, travel: 0.05 * bump(t, T, 60.0),
    "s f(travel)": lambda q, s, v, t, travel: 0.05 * s * bump(travel, 0.0, 0.4),
}


@pytest.mark.parametrize("name", HIDDEN)
def test_the_right_variable_wins(name):
    """Of all forms the one that made the current has the most evidence, beyond what decides that it is no noise."""
    solved = hiding(lever(), HIDDEN[name])
    ranked = sorted(free_form_scores(solved, 1), key=lambda one: -evidence(solved, one))
    assert ranked[0].added.effect.name == name
    assert evidence(solved, ranked[0]) > 10.0


@pytest.mark.parametrize("place", [-1.0, 0.1, 1.2])
def test_a_bump_is_found_in_its_place(place):
    """A patch of friction 0.25 rad wide: the largest knot is within a knot of it, its height within a third."""
    solved = hiding(lever(), lambda q, s, v, t, travel: 0.06 * s * bump(q, place, 0.25))
    (found,) = [one for one in free_form_scores(solved, 1) if one.added.effect.name == "s f(q)"]
    knots, values, errors = knot_values(solved, found)
    peak = int(np.argmax(np.abs(values)))
    assert abs(knots[peak] - place) <= 0.75 * (knots[1] - knots[0])
    assert values[peak] == pytest.approx(0.06, abs=0.03)
    assert 0.0 < errors[peak] < 0.01


def test_statistic_is_the_fall_of_the_square():
    """Of every form, against a dense refit with all its hats, in directions that the base model leaves alone."""
    solved = hiding(lever(), HIDDEN["s f(q)"])
    row = solved.row(1)
    for found in free_form_scores(solved, 1):
        columns = found.added.linear(solved.model.robot, row.bins.samples)
        whole = np.column_stack([row.bare @ np.eye(row.total)[row.acting], columns, row.misfit])
        parts = [
            root @ p for root, p in zip(roots(row.bins, row.noise), np.split(whole, row.bins.first[1:]), strict=True)
        ]
        white, p = np.vstack(parts), row.total
        fall = left(white[:, :p], white[:, -1]) - left(white[:, :-1], white[:, -1])
        assert found.statistic <= fall * (1.0 + 1e-6)
        assert found.statistic >= 0.9 * fall - 3.0  # what base and hats share nearly whole is left out


def test_forms_are_those_that_the_runs_can_show():
    """At one speed nothing can be said of speed; without a load that changes nothing of load."""
    names = {form.name for form in forms(lever().bins()[0])}
    assert len(FORMS) == len(names) + 1 and "s f(load)" not in names  # bins carry no loads before a fit
    single = Lab.of(LEVER, design(LEVER, speeds=(0.5,)))
    assert "s f(v)" not in {form.name for form in forms(single.bins()[0])}
    solved = pendulum().fitted(pendulum().noisy(0))
    assert "s f(load)" in {form.name for form in forms(solved.row(2).bins)}
    assert np.ptp(variable(solved.row(2).bins.samples, "load")) > 0.01


def test_a_nameless_patch_is_unexplained_and_drawn():
    """Friction at one place, with nothing added, is called unexplained, s f(q), at its place; noise is adequate."""
    verdicts = []
    for current in (HIDDEN["s f(q)"], lambda q, s, v, t, travel: 0.0 * q):
        solved = hiding(lever(), current)
        verdicts.append(joint_verdict(solved, solved, joint=1, acting=False))
    assert [one.verdict for one in verdicts] == ["unexplained", "adequate"]
    assert verdicts[0].shape.form == "s f(q)" and abs(verdicts[0].shape.peak + 0.6) < 0.25
    assert verdicts[1].shape is None
