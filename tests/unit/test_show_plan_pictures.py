"""Pictures and timetable of a plan: every posture and every run is there, at its place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import PolyCollection

from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.reporting import postures, timetable
from pumaid.reporting.held import held, letter
from pumaid.robot import Box, Joint, Robot, Safety, Sphere
from pumaid.trajectory import REST, Motion, Plan, Posture, run_times

ARM = Robot(
    "lift and tip",
    (Joint(1, "lift", "prismatic", limits=(0.0, 0.5)), Joint(2, "tip", "revolute", alpha=1.5, a=0.3)),
    safety=Safety((Box("floor", (-9, -9, -9), (9, 9, -0.1)),), (Sphere(2, (0.1, 0, 0), 0.05),), (0.2, 0, 0)),
)
#: Two postures of joint 2, one of joint 1; the first pair of runs is made twice.
RUNS = (
    Motion(2, (0.1, 9.0), -1.0, 1.0, 0.5),
    Motion(2, (0.1, 9.0), 1.0, -1.0, 0.5),
    Motion(1, (0.0, 0.7), 0.1, 0.4, 0.1, "heldout"),
    Motion(2, (0.4, 9.0), -1.0, 1.5, 0.25, "heldout"),
    Motion(2, (0.1, 8.0), -1.0, 1.0, 0.5),
    Motion(2, (0.1, 9.0), 1.0, -1.0, 0.5),
)
PLAN = Plan("lift and tip", RUNS, (Posture(2, (0.1, 9.0), ("gravity.l2.x", "gravity.l2.y"), "why"),))


def test_postures_are_grouped():
    """Runs of a joint belong together where the others stand alike; the moving joint's own entry does not count."""
    found = held(PLAN)
    assert [one.name for one in found] == ["1A", "2A", "2B"]
    assert [len(one.motions) for one in found] == [1, 4, 1]
    assert [one.span for one in found] == [(0.1, 0.4), (-1.0, 1.0), (-1.0, 1.5)]
    assert [one.fitted for one in found] == [0, 4, 0]
    assert found[1].serves == ("gravity.l2.x", "gravity.l2.y")


def test_letters_go_on_after_z():
    """Postures beyond the alphabet are named as columns of a sheet."""
    assert [letter(n) for n in (0, 25, 26, 51, 52, 701, 702)] == ["A", "Z", "AA", "AZ", "BA", "ZZ", "AAA"]


def words(figure) -> list[str]:
    return [text.get_text() for axes in figure.axes for text in axes.texts if text.get_text()]


def test_every_posture_has_its_panel():
    """A panel a posture, with joint, span, purpose and what it shows; held-out ones are told by their own colour."""
    shown = words(postures.draw(PLAN, ARM))
    assert [text for text in shown if text[0].isdigit() and text[1] in "AB"] == ["1A lift", "2A tip", "2B tip"]
    assert "0.1 to 0.4 m, 1 to judge" in shown
    assert "-57.3 to 57.3 deg, 4 to fit" in shown
    assert "shows gravity.l2.x, gravity.l2.y" in shown


def test_the_arm_is_drawn_where_it_is():
    """The moving part of a panel ends at the tip that the frames give for the middle of the span."""
    figure = postures.draw(PLAN, ARM)
    lines = figure.axes[3].lines  # the first panel of joint 2's row
    moving = next(line for line in lines if line.get_linewidth() > 3 and line.get_color() == postures.FORWARD)
    # Joint 2 at 0 and the lift at 0.1 m: worked out by hand, z of joint 1 is up and x is the base's.
    tip = np.array([[0.3 + 0.2, 0.0, 0.1]])
    assert moving.get_xydata()[-1] == pytest.approx(postures.seen(tip)[0], abs=1e-12)


@pytest.mark.parametrize("name", sorted(shipped_recipes()))
def test_no_words_overlap(name):
    """On every shipped robot no two texts of the pictures cover each other."""
    robot = read_recipe(shipped_recipes()[name])
    rng = np.random.default_rng(1)
    runs = [Motion(j + 1, tuple(rng.uniform(-1, 1, robot.n_joints)), -0.2, 0.9, 0.3, "fit")
            for j in range(robot.n_joints) for _ in range(7)]  # fmt: skip
    shows = tuple(
        Posture(run.joint, run.hold, tuple(f"gain_ratio.{k}.{k + 1}" for k in range(1, 6)), "") for run in runs
    )
    plan = Plan(robot.name, tuple(runs), shows)
    for figure in (postures.draw(plan, robot), timetable.draw(plan, robot, times=run_times(robot, plan))):
        figure.draw_without_rendering()
        texts = [text for axes in figure.axes for text in axes.texts if text.get_text()] + figure.texts
        boxes = [text.get_window_extent() for text in texts]
        pairs = [(a, b) for k, a in enumerate(boxes) for b in boxes[:k] if a.overlaps(b)]
        assert pairs == []


def bars(figure) -> list[list[tuple[float, float, float]]]:
    """Begin, end (s) and speed of every bar, strip by strip."""
    found = []
    for axes in figure.axes:
        paths = [path for c in axes.collections if type(c) is PolyCollection for path in c.get_paths()]
        points = [path.vertices for path in paths if np.ptp(path.vertices[:, 1]) and 0.0 in path.vertices[:, 1]]
        found.append([(60 * p[0, 0], 60 * p[2, 0], p[1, 1]) for p in points])
    return found


def test_timetable_shows_every_run():
    """A bar a run from its begin to its end, as high as its speed, forward up and backward down."""
    times = run_times(ARM, PLAN)
    lift, tip = bars(timetable.draw(PLAN, ARM, times=times))
    assert lift == [pytest.approx((*times[2], 0.1))]
    wanted = [
        (*times[k], np.degrees(RUNS[k].velocity) * (1 if RUNS[k].end > RUNS[k].start else -1)) for k in (0, 1, 3, 4, 5)
    ]
    assert sorted(tip) == [pytest.approx(one) for one in sorted(wanted)]


def test_run_times_are_the_sessions():
    """Rests lie between runs; each lasts as its way asks at its speed, and less than a second more for its ends."""
    times = run_times(ARM, PLAN)
    ends = times[:, 1] - times[:, 0] - [abs(run.end - run.start) / run.velocity for run in RUNS]
    assert ((ends > 0.0) & (ends < 1.0)).all()
    assert (times[1:, 0] - times[:-1, 1] >= 2 * REST - 1e-9).all()
    assert times[0, 0] == pytest.approx(REST)


def test_timetable_is_a_table_of_blocks():
    """Runs of one joint in one posture that follow each other are a row; replicates show by their letter."""
    table = timetable.timetable_table(PLAN, ARM, times=run_times(ARM, PLAN))
    columns = [list(column.cells) for column in table.columns]
    assert columns[2] == ["2A", "1A", "2B", "2A"]
    assert columns[4] == ["2", "1", "1", "2"]
    assert columns[5] == ["28.6 deg/s", "0.1 m/s", "14.3 deg/s", "28.6 deg/s"]
    assert columns[6] == ["fit", "judge", "judge", "fit"]


def test_huge_plans_and_empty_ones_are_drawn():
    """600 runs in 100 postures are drawn as far as there is room, and said so; a plan without runs is an empty page."""
    rng = np.random.default_rng(0)
    many = Plan("x", tuple(Motion(2, (float(h), 0.0), -1.0, 1.0, 0.5) for h in np.repeat(rng.uniform(0, 0.5, 100), 6)))
    assert "25 more not drawn" in " ".join(text.get_text() for text in postures.draw(many, ARM).texts)
    for plan in (many, Plan("x", ())):
        assert postures.drawn(plan, ARM, "png")[:4] == b"\x89PNG"
        assert b"<svg" in timetable.drawn(plan, ARM, "svg", times=run_times(ARM, plan))


def test_arms_without_safety_and_gravity_are_drawn():
    """Nothing forbidden, and no weight: no box, no sphere, no arrow, no failure."""
    bare = replace(ARM, safety=None, gravity=(0.0, 0.0, 0.0))
    assert "g" not in words(postures.draw(PLAN, bare))
    assert "g" in words(postures.draw(PLAN, ARM))
