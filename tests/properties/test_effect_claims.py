"""What effects claim of their columns, on random arms, postures and runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from worlds import course, random_arm

from pumaid.effects import Scope, catalogue
from pumaid.samples import Loads, Samples

FIELDS = ("position", "velocity", "acceleration", "direction", "time", "elapsed", "travel", "temperature", "run")
LOADS = ("moving", "by_joint", "slopes", "tilts", "across", "drawn")
ARMS = st.tuples(st.text("RP", min_size=1, max_size=6), st.integers(0, 2**32 - 1))
SETTINGS = settings(max_examples=25, deadline=None)


def moving(robot, rng, kind: str) -> Samples:
    """A run of a random joint in a random posture."""
    joint = int(rng.integers(1, robot.n_joints + 1))
    t, q, qd, qdd = course(kind, *rng.uniform(-2.5, 2.5, 2), samples=40)
    position, velocity = np.tile(rng.uniform(-3, 3, robot.n_joints), (40, 1)), np.zeros((40, robot.n_joints))
    position[:, joint - 1], velocity[:, joint - 1] = q, qd
    return Samples(
        joint,
        position,
        velocity,
        acceleration=qdd,
        direction=np.full(40, np.sign(q[-1] - q[0])),
        time=t,
        elapsed=500.0 + 100.0 * t,
        travel=np.abs(q - q[0]),
        temperature=20.0 + t,
        run=np.zeros(40, dtype=int),
        loads=loads(robot.n_joints, rng),
    )


def loads(joints: int, rng) -> Loads:
    """Random loads; those of some other joints, and the ratio of some gains, are not known."""
    rows, others, gains = (rng.normal(size=shape) for shape in ((3, 40), (40, joints), joints))
    others[:, rng.random(joints) < 0.3], gains[rng.random(joints) < 0.3] = np.nan, np.nan
    slopes, tilts = rng.normal(size=(40, joints)), rng.normal(size=(40, 2))
    return Loads(rows[0], others, slopes, tilts, across=np.abs(rows[1]), drawn=rows[2], gains=gains)


def part_of(samples: Samples, chosen) -> Samples:
    """Some of the instants, in another order."""
    loads = replace(samples.loads, **{name: getattr(samples.loads, name)[chosen] for name in LOADS})
    return replace(samples, loads=loads, **{name: getattr(samples, name)[chosen] for name in FIELDS})


def owners(effect, joint: int, joints: int) -> list[int]:
    """Owners of an effect that can act on `joint`."""
    numbers = {Scope.JOINT: [joint], Scope.ARM: [0], Scope.LINK: range(joint, joints + 1)}
    return list(numbers.get(effect.scope, range(1, joints + 1)))


def columns_of(robot, samples):
    """(effect, owner, columns) of everything that acts on the moving joint, shapes at their examples."""
    for effect in catalogue().values():
        for number in owners(effect, samples.joint, robot.n_joints):
            if effect.applies(robot, number) is None:
                shape = {one.name: one.example for one in effect.shapes(robot, number)}
                yield effect, number, effect.columns(robot, samples, number=number, shape=shape)


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
    part = part_of(samples, chosen)
    some = {(effect.name, number): columns for effect, number, columns in columns_of(robot, part)}
    for effect, number, columns in columns_of(robot, samples):
        assert np.allclose(some[effect.name, number], columns[chosen], rtol=1e-12, atol=1e-12)
