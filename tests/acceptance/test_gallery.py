"""The gallery's experiments, in small: what their pages say is what their programs find."""

import importlib
import re
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import pumaid

pytest.importorskip("mujoco", reason="the engine is mujoco (pip install pumaid[test])")

GALLERY = Path(__file__).parents[2] / "docs" / "gallery"
PAGE = (GALLERY / "set_point.md").read_text(encoding="utf-8")

#: Errors (deg) found again on another machine: rounding decides where friction catches a joint, within a few counts of
#: the encoder and what is left of the noise in an identified friction.
SAME, SHARE = 0.01, 0.25


def of_gallery(name: str) -> ModuleType:
    """A program of the gallery as a module."""
    sys.path.insert(0, str(GALLERY))
    try:
        return importlib.import_module(name)
    finally:
        sys.path.remove(str(GALLERY))


@pytest.fixture(scope="module")
def program() -> ModuleType:
    """The set-point program."""
    return of_gallery("set_point")


@pytest.fixture(scope="module")
def ladder(program):
    """The first robot: its logs, and the models of them."""
    return program.Ladder.of(program.puma.arm(1))


@pytest.fixture(scope="module")
def left(program, ladder):
    """(R, 6) deg: steady-state errors of the paper's step on every rung."""
    return np.array([trial.left for trial in ladder.tried(program.TARGET)])


def block(first: str) -> str:
    """The page's block of output that begins with this line."""
    return next(text for text in re.findall(r"```(?:text|console)\n(.*?)```", PAGE, re.S) if first in text)


def numbers(text: str) -> list[float]:
    """Decimal numbers of a text."""
    return [float(word) for word in re.findall(r"-?\d+\.\d+", text)]


def test_errors_fall_joint_by_joint(left):
    """The paper's claim: with gravity and friction by (20) every joint comes to rest nearer; here 4 times and more."""
    assert np.all(left[2] < left[0] / 4.0)


def test_gravity_alone_is_not_enough(left):
    """What gravity's current leaves is friction: it is still most of what PD leaves at every joint of the wrist."""
    assert np.all(left[1][3:] > 0.9 * left[0][3:])


def test_the_missing_friction_shrinks_what_stiction_leaves(left):
    """With Stribeck friction, found in the same logs, every joint is nearer again, on the whole three times."""
    assert np.all(left[4] < left[2])
    assert np.mean(left[4]) < np.mean(left[2]) / 3.0


def test_friction_in_motion_only_is_worth_little(program, ladder, left):
    """Where the model's friction is not given at rest, every joint is left three times as far off and more."""
    moving = program.Compensation(program.recipe(coupled=False), ladder.base, pushes=False)
    assert np.all(program.step(ladder.robot, program.TARGET, moving).left > 3.0 * left[2])


@pytest.mark.parametrize(("share", "hunts"), [(1.3, False), (2.0, True)])
def test_a_third_too_much_friction_does_as_well_and_twice_hunts(program, ladder, share, hunts):
    """A third more of the plain model's friction rests within 0.015 deg; with twice of it joint 2 swings by 0.3 deg."""
    model = program.Compensation(program.recipe(coupled=False), ladder.base, share=share)
    trial = program.step(ladder.robot, program.TARGET, model)
    restless = np.ptp(trial.error[trial.time > 3.0], axis=0) / program.DEG
    assert (restless[1] > 0.3) if hunts else (np.all(restless < 0.005) and np.all(trial.left < 0.015))


def test_fast_runs_alone_do_not_show_it(ladder):
    """From runs at the paper's speeds, 30 deg/s and above, no joint's Stribeck friction is told."""
    quick = replace(ladder.dataset, runs=tuple(run for run in ladder.dataset.runs if abs(run.speed) > 0.45))
    found = pumaid.identify(quick, ladder.models[3].robot, effects=[pumaid.EffectChoice("stribeck")])
    told = [value for value in found.values if value.name.startswith("stribeck") and value.name.endswith(".a")]
    assert len(told) == 6
    assert all(value.value is None or abs(value.value) < 2.0 * value.std_error for value in told)


def test_the_page_and_the_data_tell_what_is_found(program, left):
    """The page's table of the paper's step, and the first trial of the data, are this run."""
    told = np.array(numbers(block("robot 1, step to 50"))[: left.size]).reshape(left.shape)
    for recorded in (told, program.read(GALLERY / "set_point.csv")[0]):
        np.testing.assert_allclose(left, recorded, atol=SAME, rtol=SHARE)


def test_gears_explain_motors_whose_joints_are_held(ladder):
    """Friction of motors 5 and 6, known from their own runs, is found in their currents while joints 4 and 5 move."""
    found = ladder.dragged()
    for _, _, plain, geared in found:
        assert geared < 0.3 * plain
    told = numbers(block("robot 1, step to 50").split("held joint")[1])
    np.testing.assert_allclose([value for row in found for value in row[2:]], told, atol=0.01)


def test_the_table_of_all_steps_is_that_of_the_data(program):
    """The page's means, worst cases and counts are those of docs/gallery/set_point.csv."""
    assert "\n".join(program.summary(program.read(GALLERY / "set_point.csv"))) in PAGE
