"""What laps tell, against the forecast of their runs; where they go, against the recipe."""

from __future__ import annotations

import numpy as np
import pytest
from menus import arm, assumed, motions_of, names, small_menu

from pumaid.design.criterion import Criterion
from pumaid.design.laps import courses, speeds, top_speed
from pumaid.records import Plan
from pumaid.simulation.forecast import forecast
from pumaid.simulation.ranges import reference, span
from pumaid.units import factor
from pumaid.verbs.simulate import simulate

ARMS = ("puma560", "stanford")


def foretold(name: str, robot: int, laps: list[int]) -> np.ndarray:
    """(p, p) information of some laps by the forecast of their motions, in the menu's order."""
    found = forecast(
        assumed(name).truths[robot], motions_of(small_menu(name), laps), names=names(arm(name)), rate=100.0
    )
    order = [found.names.index(one) for one in small_menu(name).names]
    return found.information[np.ix_(order, order)]


def alike(found: np.ndarray, wanted: np.ndarray) -> bool:
    """Equal to 1e-9 of the parameters' own information."""
    scale = np.sqrt(np.diag(wanted)) + 1e-12
    return bool(np.allclose(found / np.outer(scale, scale), wanted / np.outer(scale, scale), atol=1e-9))


@pytest.mark.parametrize("name", ARMS)
def test_information_is_that_of_the_forecast(name):
    """Laps made once, twice and not at all tell, for either robot, what the forecast says of all their runs."""
    menu, rng = small_menu(name), np.random.default_rng(1)
    laps = rng.choice(len(menu), 40, replace=False)
    weights = np.zeros(len(menu))
    weights[laps] = rng.integers(1, 3, 40)
    made = np.repeat(np.arange(len(menu)), weights.astype(int)).tolist()
    found = menu.information(weights)
    assert all(alike(found[robot], foretold(name, robot, made)) for robot in (0, 1))


@pytest.mark.parametrize("name", ARMS)
def test_each_and_worth_are_those_of_single_laps(name):
    """One by one, and by their pull: a lap's worth is the sum of the products with its own forecast."""
    menu = small_menu(name)
    laps = np.random.default_rng(2).choice(len(menu), 12, replace=False).tolist()
    pull = Criterion(0.0, np.ones(len(menu.names))).pull(menu.information(np.ones(len(menu))))
    each, worth = menu.each(laps), menu.worth(pull)
    for k, lap in enumerate(laps):
        wanted = np.stack([foretold(name, robot, [lap]) for robot in (0, 1)])
        assert all(alike(each[k, robot], wanted[robot]) for robot in (0, 1))
        assert worth[lap] == pytest.approx(np.sum(pull * wanted), rel=1e-8)


def test_some_of_the_laps_are_the_same_laps():
    """A part of a menu has the worth and times of its laps, also where a joint has none left."""
    menu = small_menu("stanford")
    some = np.flatnonzero(np.random.default_rng(3).random(len(menu)) < 0.2)
    some = some[menu.joint[some] != 2]
    pull = Criterion(0.0, np.ones(len(menu.names))).pull(menu.information(np.ones(len(menu))))
    assert menu.only(some).worth(pull) == pytest.approx(menu.worth(pull)[some])
    assert menu.only(some).seconds.tolist() == menu.seconds[some].tolist()
    assert [menu.only(some).block_of(k) for k in range(9)] == [menu.block_of(int(lap)) for lap in some[:9]]


def test_laps_are_found_by_joint_posture_and_course():
    """Looking for a lap by what it is gives its number."""
    menu = small_menu("stanford")
    for lap in (0, 17, len(menu) - 1):
        assert menu.find(*menu.block_of(lap), int(menu.course[lap])) == lap
    assert menu.find(1, 99, 0) is None


@pytest.mark.parametrize("name", ARMS)
def test_courses_end_where_they_began_within_the_span(name):
    """Each course is a closed way over at most three runs, from where the joint is held, within its span."""
    robot = arm(name)
    for joint in robot.joints:
        low, high = span(joint)
        home = reference(robot)[joint.number - 1]
        for course in courses(robot, joint.number, speeds(robot, joint.number, (0.035, 0.3, 1.0))):
            assert course.stops[0] == course.stops[-1] == pytest.approx(home)
            assert low - 1e-9 <= course.low < course.high <= high + 1e-9
            assert 2 <= len(course.motions((0.0,) * robot.n_joints)) <= 3


def test_time_of_a_lap_is_that_of_its_log():
    """A virtual robot takes as long over a lap as the menu counts, but for the moves before it."""
    robot, menu = arm("stanford"), small_menu("stanford")
    truth = assumed("stanford").truths[0]
    for lap in (3, len(menu) // 2, len(menu) - 5):
        runs = tuple(motions_of(menu, [lap]))
        logs = list(simulate(robot, Plan(robot.name, runs), seed=1, truth=truth, rate=100.0))
        lasted = max(float(log.time[-1]) for log in logs) - min(float(log.time[0]) for log in logs)
        assert lasted == pytest.approx(menu.seconds[lap], abs=0.1)


def test_speeds_are_told_in_tenths():
    """Speeds of a turning joint are whole tenths of degrees a second, none above the joint's."""
    robot, step = arm("puma560"), 0.1 * factor("deg")
    found = np.array(speeds(robot, 3, (0.05, 0.1, 0.35, 1.0)))
    assert found / step == pytest.approx(np.round(found / step), abs=1e-6)
    assert found[-1] <= top_speed(robot, 3) <= robot.joint(3).max_velocity
