"""Diagnoses written by hand, for tests of sentences, tables, figures and files: nothing in them depends on a fit."""

from dataclasses import replace

import numpy as np

from pumaid.diagnosis.records import (
    Binned,
    Candidate,
    Curve,
    Diagnosis,
    Finding,
    JointDiagnosis,
    Limit,
    Line,
    Repeats,
    Size,
    Unexplained,
)
from pumaid.errors import Note, Where
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.robot import Robot
from pumaid.trajectory import Motion, NextRun

PUMA: Robot = replace(read_recipe(shipped_recipes()["puma560"]), name="PUMA 560")
HOLD = (0.0, -1.57, 0.0, 0.5, 0.0, 0.0)
SPEEDS = np.array([0.1, 0.25, 0.5, 1.0])


def next_run() -> NextRun:
    """Two slow runs of joint 3."""
    rows = tuple(Motion(3, HOLD, start, -start, 0.05) for start in (-1.2, 1.2))
    return NextRun("run joint 3 slower than any run so far", rows, separation=2.5, repeats=2)


def curve() -> Curve:
    """What Stribeck friction at joint 3 leaves over four speeds, and a rival that parts below them."""
    sides, lines = [], []
    for way in (1, -1):
        before = way * np.array([0.03, -0.01, -0.02, 0.015])
        sides.append(Binned(way, SPEEDS, before, 0.1 * before, np.array([0.002, 0.002, np.nan, 0.003]), 0 * SPEEDS + 4))
        fine = np.linspace(0.04, 1.1, 12)
        for name, scale in (("stribeck", 0.12), ("viscous_power", 0.05)):
            lines.append(Line(name, way, fine, way * (0.06 * np.exp(-fine / scale) - 0.02 + 0.03 * fine)))
    lines.sort(key=lambda line: line.effect)
    return Curve(3, "speed", "rad/s", tuple(sides), tuple(lines))


def stribeck() -> Finding:
    """Stribeck friction at joint 3, which a power law of speed explains as well."""
    return Finding(
        "stribeck",
        3,
        {"velocity": 0.12, "exponent": 1.0},
        "add",
        "joint 3 lacks friction that falls with speed",
        1.0 / 300,
        rivals=("viscous_power",),
        command="pumaid identify logs/ --add stribeck@3",
        rmse_heldout_before=0.033,
        rmse_heldout_after=0.0155,
        forecast=0.0155,
        forecast_error=0.0004,
        sizes=(Size("stribeck.j3.a", 0.12, 0.011, "A"),),
        next_run=next_run(),
        curves=(curve(),),
    )


def tilt() -> Finding:
    """A tilted base, which misses a gate."""
    sizes = (Size("tilt.x", 0.021, 0.004, "rad"), Size("tilt.y", -0.003, 0.004, "rad"))
    command = "pumaid identify logs/ --add tilt"
    errors = {"rmse_heldout_before": 0.020, "rmse_heldout_after": 0.0198}
    told = "the error on runs left out does not fall"
    return Finding("tilt", None, {}, "doubtful", told, 0.012, **errors, sizes=sizes, command=command)


def patch() -> Unexplained:
    """Friction in one place of joint 5."""
    centres = np.linspace(-1.5, 1.5, 13)
    means = np.round(0.05 * np.exp(-(((centres - 0.5) / 0.2) ** 2)) - 0.004, 4)
    text = "friction that depends on position, largest at 0.5 rad"
    return Unexplained("s f(q)", "position", "rad", centres, means, np.full(13, 0.002), 0.5, 0.83, text)


def candidates() -> tuple[Candidate, ...]:
    """What was tried at joint 3."""
    found = stribeck()
    gate = "the error on runs left out does not fall"
    return (
        Candidate("stribeck", 3, found.shape, "add", "passes", found.p_value, 41.3, 0.0152, 0.033, 0.0155,
                  found.sizes, ("viscous_power",), found.command),
        Candidate("viscous_power", 3, {"exponent": 0.3}, "add", "passes", found.p_value, 38.0, 0.0153, 0.033, 0.0157),
        Candidate("tilt", None, {}, "doubtful", gate, 0.012, 6.0, 0.0305, 0.033, 0.0331, sizes=tilt().sizes),
        Candidate("spring", 3, {}, "absent", "no better than chance", 0.81, -3.1, 0.0309, 0.033, 0.0332),
    )  # fmt: skip


def limits(joint: int) -> tuple[Limit, ...]:
    """What could have been seen at a joint."""
    return (
        Limit("stribeck", joint, "a", 0.03 / joint, "A"),
        Limit("viscous_power", joint, "b", 0.2, "A s/rad"),
        Limit("spring", joint, "a", None, "A/rad", "its line is a sinusoid over so short a span"),
        Limit("tilt", None, "x", 0.011, "rad"),
    )


def quiet(joint: int, rmse: float = 0.0226, floor: float | None = 0.023) -> JointDiagnosis:
    """A joint of which nothing is missing."""
    budget = {"noise": rmse**2}
    return JointDiagnosis(
        joint, "adequate", "nothing is missing", rmse, floor, Repeats(0.02, 0.6), budget, (), None, limits(joint)
    )


def clean() -> Diagnosis:
    """The PUMA with nothing missing."""
    return Diagnosis("PUMA 560", tuple(quiet(n) for n in range(1, 7)), (), version="0.1.0")


def rich() -> Diagnosis:
    """One of everything: a finding with a rival, a doubtful one, a shape without a name, a joint that never moves."""
    third = JointDiagnosis(3, "missing", "stribeck or viscous_power", 0.031, 0.0149, Repeats(0.76, 0.001),
                           {"noise": 2.2e-4, "between runs, odd": 7.4e-4}, candidates(), None, limits(3))  # fmt: skip
    alone = "no run is repeated, so the noise is guessed from what is left"
    fourth = JointDiagnosis(4, "adequate", "nothing is missing", 0.018, None, None, {}, (), None, limits(4), (alone,))
    fifth = JointDiagnosis(
        5, "unexplained", "friction in one place", 0.027, 0.0167, Repeats(0.61, 1e-9), {}, (), patch(), ()
    )
    sixth = JointDiagnosis(6, "adequate", "joint 6 never moves", None, None, weakened=("one posture only",))
    return Diagnosis(
        "PUMA 560",
        (quiet(1), replace(quiet(2), weakened=("one posture only",)), third, fourth, fifth, sixth),
        (stribeck(), tilt()),
        model={"sha256": "ab" * 32},
        logs={"session_01.csv": "cd" * 32},
        notes=(Note("few-runs", "joint 6 has 0 runs", Where(joint=6)),),
        recipe={"sha256": "ef" * 32},
        version="0.1.0",
        applied=(replace(stribeck(), effect="ripple", joint=2, shape={"frequency": 40.0}, rivals=(), next_run=None),),
    )


def small() -> Diagnosis:
    """The pendulum's: a finding at joint 1, a shape without a name at joint 2."""
    run = replace(next_run(), motions=(Motion(1, (0.0, 0.5), -1.2, 1.2, 0.05),))
    sizes = (Size("stribeck.j1.a", 0.12, 0.011, "A"),)
    found = replace(
        stribeck(), joint=1, sizes=sizes, next_run=run, command="pumaid identify logs/ --add stribeck@1",
        curves=(replace(curve(), joint=1),),
    )  # fmt: skip
    tried = tuple(replace(one, joint=1) for one in candidates()[:2])
    first = replace(rich().joints[2], joint=1, candidates=tried, limits=limits(1))
    second = replace(rich().joints[4], joint=2)
    return Diagnosis("arm RR", (first, second), (found,), version="0.1.0")
