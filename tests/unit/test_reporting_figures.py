"""Figures: each can be drawn in every form, and shows what it says."""

from dataclasses import replace
from xml.etree import ElementTree

import diagnoses
import numpy as np
import pytest
from ladders import ladder
from test_reporting_tables import dataset_of

from pumaid.dataset import Dataset
from pumaid.diagnosis.compare import compare
from pumaid.reporting.figures import experiment, model
from pumaid.reporting.figures.style import INLINE
from pumaid.reporting.page import ReportContext, all_contents, all_figures

PUMA = diagnoses.PUMA


@pytest.fixture(scope="module")
def figures(context):
    """Every figure of the small arm's report by name."""
    return {drawing.name: drawing for drawing in all_figures(all_contents(context))}


def only(context, keep):
    """The context with the runs that `keep` wants."""
    chosen = tuple(score for score in context.comparison.runs if keep(score.run))
    return replace(context, comparison=replace(context.comparison, runs=chosen))


# Forms


def test_files_are_what_their_suffix_says(figures):
    """PNG, SVG and PDF begin as their kind does, and are the same bytes when drawn again."""
    files = {form: figures["spent"].file(form) for form in ("png", "svg", "pdf")}
    assert files["png"].startswith(b"\x89PNG") and files["pdf"].startswith(b"%PDF")
    assert ElementTree.fromstring(files["svg"]).tag.endswith("svg")
    assert {form: figures["spent"].file(form) for form in files} == files


# Model and residuals


def test_shares_stand_in_the_bars(context, figures):
    """The largest share of each joint is written in its bar; effects that are not separated are one bar."""
    svg = figures["spent"].file(INLINE).decode()
    for score in context.comparison.joints:
        assert f"{100 * max(score.shares.values()):.0f} %" in svg
    for row in range(2):
        bars = [bar for bar in figures["spent"].figure.axes[0].patches if round(bar.get_y() + 0.34) == row]
        assert sum(bar.get_width() for bar in bars) == pytest.approx(1.0)
    joints = list(context.comparison.joints)
    joints[0] = replace(joints[0], shares={"gravity": 0.2, "coulomb+viscous": 0.79, "unexplained": 0.01})
    merged = replace(context, comparison=replace(context.comparison, joints=tuple(joints)))
    drawing = model.share_figure(merged)
    assert "share a colour" in drawing.caption
    assert "Coulomb friction + viscous friction" in drawing.file(INLINE).decode()


def test_legends_name_the_directions_of_the_runs(context, figures):
    """Where no run goes backward, no legend speaks of backward."""
    ahead = {
        drawing.name: drawing for drawing in all_figures(all_contents(only(context, lambda run: run.direction > 0)))
    }
    for name in ("current_j1", "residual_j1"):
        both, forward = ([text.get_text() for text in made[name].figure.legends[0].texts] for made in (figures, ahead))
        assert {"forward", "backward"} <= set(both) and "forward" in forward and "backward" not in forward


def test_residuals_are_drawn_against_what_varies(context):
    """One speed in one posture leaves nothing to see over speed and posture, so there are no panels of them."""
    names = model.varying(model.joint_residuals(context, 1))
    assert "speed (rad/s)" in names and "posture (number)" in names
    first = context.comparison.of_joint(1)[0].run
    alike = only(context, lambda run: run.joint == 1 and abs(run.speed) == abs(first.speed)
                 and np.allclose(run.posture, first.posture, atol=0.01, equal_nan=True))  # fmt: skip
    assert [name.split()[0] for name in model.varying(model.joint_residuals(alike, 1))] in (
        ["position", "time"], ["position", "gravity", "time"],
    )  # fmt: skip


def test_logs_without_runs_draw_no_empty_figure(context):
    nothing = Dataset(())
    empty = ReportContext(context.robot, context.estimate, nothing, compare(context.estimate, nothing, context.robot))
    assert [drawing.name for drawing in all_figures(all_contents(empty))] == []


# History


def test_each_model_has_its_step():
    labels = model.history_figure(ladder(12, 3)).figure.axes[0].get_xticklabels()
    assert [label.get_text() for label in labels] == [str(number) for number in range(1, 13)]


# Diagnosis


def test_before_and_after_have_one_scale():
    """The residual with the effect is seen against the one without it, in the unit asked for."""
    finding = diagnoses.stribeck()
    above, below = model.finding_figure(finding, finding.curves[0], PUMA, name="x", units="deg").figure.axes
    assert above.get_ylim() == below.get_ylim() and above.get_xlim() == below.get_xlim()
    heights = [max(abs(line.get_ydata()).max() for line in axes.lines[1:3]) for axes in (above, below)]
    assert heights[0] == pytest.approx(10.0 * heights[1])
    assert below.get_xlabel() == "speed (deg/s)" and max(above.lines[1].get_xdata()) == pytest.approx(np.rad2deg(1.0))
    dashes = [line.get_linestyle() for line in above.lines if len(line.get_xdata()) == 12]
    assert dashes.count("-") == 2 and dashes.count("--") == 2  # the effect's own lines and its rival's, one a direction


# Runs


def test_runs_are_drawn_in_the_unit_asked_for():
    """Velocity above position, in degrees, the highest at the fastest run; joints and reasons in the legend."""
    dataset, robot_ = dataset_of(speeds=(0.5, 0.5001))
    figure = experiment.run_figure(dataset, robot_, "deg").figure
    above, below = figure.axes
    assert (above.get_ylabel(), below.get_ylabel()) == ("velocity (deg/s)", "position (deg)")
    top = max(np.abs(line.get_ydata()).max() for line in above.lines if len(line.get_xdata()) > 2)
    assert np.isclose(top, np.degrees(0.5), rtol=0.03)
    words = " ".join(text.get_text() for text in figure.legends[0].get_texts())
    assert "1 j1: 2 runs" in words and all(reject.reason.replace("-", " ") in words for reject in dataset.rejects)


def test_long_campaigns_go_over_strips():
    """Strips share the time evenly; the report shows the first runs; no runs are an empty figure."""
    dataset, robot_ = dataset_of()
    many = Dataset(dataset.runs * 25, dataset.rejects)
    axes = experiment.run_figure(many, robot_).figure.axes
    assert len(axes) == 2 * 3
    widths = [np.ptp(axis.get_xlim()) for axis in axes]
    np.testing.assert_allclose(widths, widths[0])
    assert experiment.run_figure(many, robot_, limit=3).caption.startswith("The first 3 of ")
    assert len(experiment.run_figure(Dataset(()), robot_).figure.axes) == 2
