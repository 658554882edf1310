"""Figures: all kinds are found, can be written in every form, and draw what they say."""

from __future__ import annotations

import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
import stories
import worlds
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from pumaid.dataset import Dataset
from pumaid.errors import ResultError
from pumaid.reporting.plots import drawings, misfit, skeleton, spent
from pumaid.reporting.plots.segments import MOST_RUNS, beginning
from pumaid.reporting.plots.skeleton import frames
from pumaid.reporting.plots.style import INK, dots, woven
from pumaid.reporting.story import Story
from pumaid.robot import Joint, Robot
from pumaid.verbs.compare import compare


@pytest.fixture(scope="module")
def told():
    """The small arm's story."""
    return stories.story()


@pytest.fixture(scope="module")
def figures(told):
    """Every figure by name."""
    return {drawing.name: drawing for drawing in drawings(told)}


def test_every_kind_is_there(figures):
    """Arm, segments, spending, curves and residuals of both joints, parameters and campaign, in that order."""
    names = list(figures)
    assert names[:3] == ["arm", "segments", "spent"]
    assert {"current_j1", "current_j2", "residual_j1", "residual_j2", "parameters", "precision", "campaign"} < set(
        names
    )


@pytest.mark.parametrize("name", ["arm", "spent", "residual_j1", "campaign"])
def test_forms_begin_as_their_kind_does(figures, name):
    """PNG, SVG and PDF are what their suffix says."""
    made = figures[name].files(["png", "svg", "pdf"])
    assert made["png"].startswith(b"\x89PNG") and made["pdf"].startswith(b"%PDF")
    assert ElementTree.fromstring(made["svg"]).tag.endswith("svg")


def test_the_same_story_gives_the_same_bytes(told, figures):
    """A figure drawn twice is the same file, whatever the date."""
    again = {drawing.name: drawing for drawing in drawings(told)}
    for form in ("svg", "png", "pdf"):
        assert again["spent"].file(form) == figures["spent"].file(form)


def test_inline_figure_is_a_guest_on_the_page(figures):
    """Its ids carry its name, its ink is the page's, and it reaches for nothing outside."""
    svg = figures["residual_j1"].inline()
    ids = re.findall(r'\bid="([^"]+)"', svg)
    assert ids and all(found.startswith("residual_j1-") for found in ids) and len(ids) == len(set(ids))
    assert set(re.findall(r'href="#([^"]+)"', svg)) <= set(ids)
    assert set(re.findall(r"url\(#([^)]+)\)", svg)) <= set(ids)
    assert "currentColor" in svg and INK not in svg and "<style" not in svg
    assert ElementTree.fromstring(svg).attrib["role"] == "img"


def test_numbers_on_a_page_are_not_rounded():
    """Coordinates are shortened, words are not."""
    svg = '<svg width="10pt" height="5pt"><path d="M 1.23456 2.34567"/><text>0.360 A</text></svg>'
    assert "M1.23 2.34" in woven(svg, "x", "t") and "0.360 A" in woven(svg, "x", "t")


def test_shares_of_an_arm_stand_in_the_picture(told):
    """The largest share of each joint is written in its bar."""
    svg = next(d for d in drawings(told) if d.name == "spent").inline()
    for score in told.comparison.joints:
        assert f"{100 * max(score.shares.values()):.0f} %" in svg


def test_spending_is_told_in_words(told):
    """The sentence names the effects, the largest first."""
    score = told.comparison.joints[0]
    words = spent.sentence(told, replace(score, shares={"gravity": 0.2, "coulomb": 0.79, "unexplained": 0.01}))
    assert words.endswith("Coulomb friction 79 %, gravity 20 %.")


def test_what_cannot_be_told_apart_is_named_as_a_sum(told):
    """A share of several effects is one striped bar and one name, in words and in the legend; the caption says so."""
    shares = {"gravity": 0.2, "coulomb+viscous": 0.79, "unexplained": 0.01}
    score = replace(told.comparison.joints[0], shares=shares)
    assert spent.sentence(told, score).endswith("friction (Coulomb and viscous not told apart) 79 %, gravity 20 %.")
    joints = (score, *told.comparison.joints[1:])
    (drawing,) = spent.drawings(replace(told, comparison=replace(told.comparison, joints=joints)))
    assert "Coulomb + viscous" in drawing.inline() and "Striped" in drawing.caption
    (plain,) = spent.drawings(told)
    assert "Coulomb + viscous" not in plain.inline() and "Striped" not in plain.caption


@pytest.mark.parametrize("count", [5, 400, 5000])
def test_every_dot_is_seen_in_png(count):
    """Dots, few or many, are drawn as dots: five of them are five spots, thousands cover the line they stand on."""
    figure = Figure(figsize=(4.0, 1.0), dpi=100)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.axis("off")  # white paper, black dots
    axes.set(xlim=(-0.05, 1.05), ylim=(0.0, 1.0))
    dots(axes, np.linspace(0.0, 1.0, count), np.full(count, 0.5), colour="#000000", size=3.0, alpha=1.0)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    dark = np.asarray(canvas.buffer_rgba())[:, :, 0].min(axis=0) < 128
    spots = int(np.count_nonzero(np.diff(dark.astype(int)) == 1))
    assert spots == 5 if count == 5 else dark.sum() > 0.85 * len(dark)


def only(told, keep):
    """The story of the runs that `keep` wants."""
    runs = tuple(score for score in told.comparison.runs if keep(score.run))
    return replace(told, comparison=replace(told.comparison, runs=runs))


@pytest.mark.parametrize("name", ["current_j1", "residual_j1", "campaign"])
def test_legends_name_the_directions_that_were_run(told, name):
    """Where no run goes backward, no legend speaks of backward."""
    ahead = only(told, lambda run: run.direction > 0)
    for story, words in ((told, True), (ahead, False)):
        svg = next(d for d in drawings(story) if d.name == name).inline()
        assert "forward" in svg and ("backward" in svg) is words


def test_residuals_are_drawn_against_what_differs(told):
    """One speed in one posture leaves nothing to see over speed and posture, so there are no panels of them."""
    whole = next(d for d in drawings(told) if d.name == "residual_j1").inline()
    assert "speed (rad/s)" in whole and "posture (number)" in whole
    first = told.comparison.of_joint(1)[0].run
    alike = only(told, lambda run: run.joint == 1 and abs(run.speed) == abs(first.speed) and np.allclose(
        run.posture, first.posture, atol=0.01, equal_nan=True))  # fmt: skip
    svg = next(d for d in drawings(alike) if d.name == "residual_j1").inline()
    assert "position (rad)" in svg and "speed" not in svg and "posture" not in svg


def test_joints_in_one_place_share_a_label():
    """Joints 1 and 2 of an arm without a length between them are ``1, 2``, not twelve."""
    arm = Robot("two", (Joint(1, "a", "revolute"), Joint(2, "b", "revolute", alpha=-np.pi / 2, d=0.0),
                        Joint(3, "c", "revolute", a=0.4)))  # fmt: skip
    (axes,) = skeleton.draw(arm, np.zeros(3)).axes
    assert [text.get_text() for text in axes.texts if text.get_text()[:1].isdigit()] == ["1, 2", "3"]


def test_skeleton_is_where_the_arm_is():
    """Origins of the PUMA's frames with the arm stretched up, worked out by hand from its table of lengths."""
    arm = Robot("two", (Joint(1, "a", "revolute"), Joint(2, "b", "revolute", alpha=-np.pi / 2, d=0.25),
                        Joint(3, "c", "revolute", a=0.4)))  # fmt: skip
    origins, turned = frames(arm, np.array([0.0, -np.pi / 2, 0.0]))
    assert origins == pytest.approx(np.array([[0, 0, 0], [0, 0, 0], [0, 0.25, 0], [0, 0.25, 0.4]]), abs=1e-12)
    assert turned[1:, :, 2] == pytest.approx(np.array([[0, 0, 1], [0, 1, 0], [0, 1, 0]]), abs=1e-12)


def test_a_slide_moves_the_skeleton():
    """A prismatic joint's position shifts what is outward of it along its axis."""
    origins, _ = frames(worlds.CRANE, np.array([0.0, 0.7, 0.0]))
    shorter, _ = frames(worlds.CRANE, np.array([0.0, 0.2, 0.0]))
    assert np.linalg.norm(origins[2] - shorter[2]) == pytest.approx(0.5, rel=1e-12)


def test_long_campaigns_show_their_beginning(told):
    """The picture of the runs stops after its limit, with what was left out until then."""
    many = Dataset(told.dataset.runs * 9, told.dataset.rejects)
    shown = beginning(many)
    assert len(shown.runs) == MOST_RUNS and len(beginning(told.dataset).runs) == len(told.dataset.runs)


def test_logs_without_runs_draw_the_arm_only(told):
    """With nothing to show, there is no empty figure."""
    nothing = Dataset(())
    empty = Story(told.robot, told.estimate, nothing, compare(told.estimate, nothing, told.robot))
    names = [drawing.name for drawing in drawings(empty)]
    assert names == ["arm", "parameters", "precision"]


def test_misfit_refuses_other_forms(told):
    """A figure's form is one of three."""
    with pytest.raises(ResultError, match=r"\.gif"):
        misfit.drawn(told, ".gif")
    assert misfit.drawn(told, ".svg").startswith(b"<?xml")


def test_misfit_without_runs_is_refused(told):
    """There is no picture of no runs."""
    nothing = Dataset(())
    with pytest.raises(ResultError, match="no run"):
        misfit.drawn(Story(told.robot, told.estimate, nothing, compare(told.estimate, nothing, told.robot)), ".png")
