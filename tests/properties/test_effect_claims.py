"""What effects claim of their columns, on random arms, postures and runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from worlds import course, random_arm

from pumaid.effects import Scope, catalogue
from pumaid.records import Samples

FIELDS = ("position", "velocity", "acceleration", "direction", "time", "travel", "temperature", "load", "run")
ARMS = st.tuples(st.text("RP", min_size=1, max_size=6), st.integers(0, 2**32 - 1))
SETTINGS = settings(max_examples=25, deadline=None)


def moving(robot, rng, kind: str) -> Samples:
    """A run of a random joint in a random posture."""
    joint = int(rng.integers(1, robot.n_joints + 1))
    t, q, qd, qdd = course(kind, *rng.uniform(-2.5, 2.5, 2), samples=40)
    position, velocity = np.tile(rng.uniform(-3, 3, robot.n_joints), (40, 1)), np.zeros((40, robot.n_joints))
    position[:, joint - 1], velocity[:, joint - 1] = q, qd
    size = rng.normal(size=40)
    return Samples(
        joint,
        position,
        velocity,
        acceleration=qdd,
        direction=np.full(40, np.sign(q[-1] - q[0])),
        time=t,
        travel=np.abs(q - q[0]),
        temperature=20.0 + t,
        run=np.zeros(40, dtype=int),
    )


def columns_of(robot, samples):
    """(effect, owner, columns) of everything that acts on the moving joint."""
    for effect in catalogue().values():
        if effect.applies(robot, samples.joint) is not None:
            continue
        outward = range(samples.joint, robot.n_joints + 1) if effect.scope is Scope.LINK else [samples.joint]
        for number in outward:
            yield effect, number, effect.columns(robot, samples, number=number)


@SETTINGS
@given(ARMS, st.sampled_from(["constant", "stroke"]))
def test_shape_and_finiteness(arm, kind):
    """One finite column a parameter of the owner, on any arm."""
    rng = np.random.default_rng(arm[1])
    robot = random_arm(arm[0], rng)
    samples = moving(robot, rng, kind)
    for effect, number, columns in columns_of(robot, samples):
        assert columns.shape == (40, len(effect.parameters(robot, number)))
        assert np.isfinite(columns).all()


@SETTINGS
@given(ARMS, st.sampled_from(["constant", "stroke"]))
def test_row_by_row(arm, kind):
    """An instant's row does not depend on which other instants are shown, nor on their order."""
    rng = np.random.default_rng(arm[1])
    robot = random_arm(arm[0], rng)
    samples = moving(robot, rng, kind)
    chosen = rng.permutation(40)[:15]
    part = replace(samples, **{name: getattr(samples, name)[chosen] for name in FIELDS})
    some = {(effect.name, number): columns for effect, number, columns in columns_of(robot, part)}
    for effect, number, columns in columns_of(robot, samples):
        if not getattr(effect, "memory", False):
            assert np.allclose(some[effect.name, number], columns[chosen], rtol=1e-12, atol=1e-12)


@SETTINGS
@given(ARMS, st.sampled_from(["constant", "stroke"]))
def test_in_triangle_is_true(arm, kind):
    """Columns said to lie in a run's triangle do: cos, sin, one, and for strokes velocity and acceleration."""
    rng = np.random.default_rng(arm[1])
    robot = random_arm(arm[0], rng)
    samples = moving(robot, rng, kind)
    own = samples.joint - 1
    q, turns = samples.position[:, own], float(robot.is_revolute[own])
    basis = np.column_stack([turns * np.cos(q), turns * np.sin(q), np.ones(40)])
    if kind == "stroke":
        basis = np.column_stack([basis, samples.velocity[:, own], samples.acceleration])
    for effect, _, columns in columns_of(robot, samples):
        if effect.in_triangle:
            inside = basis @ np.linalg.lstsq(basis, columns, rcond=1e-12)[0]
            assert np.allclose(inside, columns, atol=1e-9 * max(1.0, np.abs(columns).max(initial=0.0)))
