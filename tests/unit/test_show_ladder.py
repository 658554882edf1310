"""The error ladder in words, tables, pictures and on the page."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import stories
from ladders import ARM, RIPPLE, STRIBECK, experiment, ladder, model
from matplotlib.figure import Figure

from pumaid.reporting.ladder import joint_grids, ladder_grid, ladder_sentence, names, step
from pumaid.reporting.plots.ladder import draw, drawings, drawn
from pumaid.reporting.plots.style import styled
from pumaid.reporting.report import page
from pumaid.results.history import Ladder, keep, ladder_of, read_history
from pumaid.robot import EffectChoice


def drawn_of(of: Ladder) -> Figure:
    """The picture as a figure."""
    with styled():
        return draw(of)


@pytest.mark.parametrize("n_models", [1, 2, 6, 12])
@pytest.mark.parametrize("n_joints", [1, 2, 6, 7])
def test_every_joint_has_a_panel(n_models, n_joints):
    """One panel for the arm, and one a joint where there are several."""
    assert len(drawn_of(ladder(n_models, n_joints)).axes) == (1 if n_joints == 1 else 1 + n_joints)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, ["fitted runs", "runs no fit saw", "noise floor"]),
        ({"heldout": False}, ["fitted runs", "noise floor"]),
        ({"floor": False}, ["fitted runs", "runs no fit saw"]),
    ],
)
def test_legend_names_what_is_there(options, words):
    """Without held-out runs or a floor the picture does not speak of them."""
    (legend,) = drawn_of(ladder(3, 2, **options)).legends
    assert [text.get_text() for text in legend.get_texts()] == words


def test_lines_stand_at_the_errors():
    """Treads of the main panel are the models' errors, the last one drawn to its end."""
    of = ladder(3, 1)
    heights = [line.get_ydata() for line in drawn_of(of).axes[0].lines]
    fitted = [rung.whole.fitted for rung in of.rungs]
    assert any(np.allclose(found, [*fitted, fitted[-1]]) for found in heights)
    assert any(np.allclose(found, 1.1 * np.array([*fitted, fitted[-1]])) for found in heights)


def test_steps_are_named_after_what_was_added():
    """Below each tread stand its number, the effect in words and its joint."""
    labels = [text.get_text() for text in drawn_of(ladder(2, 2)).axes[0].get_xticklabels()]
    assert labels == ["model 1\nbase model", "model 2\n+\N{NO-BREAK SPACE}torque constant drift\njoint 1"]


def test_a_narrow_picture_has_numbers_below_its_steps():
    """Where seven names would run into each other, the numbers of the models stand alone."""
    with styled():
        axes = draw(ladder(7, 6), width=4.9).axes[0]
    assert [text.get_text() for text in axes.get_xticklabels()] == list("1234567") and axes.get_xlabel() == "model"


def test_a_long_ladder_keeps_its_ends():
    """Of twelve models the first and the last seven are drawn; the gap is told."""
    labels = [text.get_text().split("\n") for text in drawn_of(ladder(12, 2)).axes[0].get_xticklabels()]
    assert [label[0] for label in labels] == ["1", *(str(number) for number in range(6, 13))]
    assert labels[1][1:] == ["several", "steps"]


def test_the_same_ladder_gives_the_same_bytes():
    """A picture can be kept under version control."""
    assert drawn(ladder(2, 2), "svg") == drawn(ladder(2, 2), "svg")


@pytest.mark.parametrize(
    ("effects", "told"),
    [
        ([STRIBECK, RIPPLE], ["stribeck@1", "ripple@2"]),
        ([replace(STRIBECK, joint=joint) for joint in (3, 1)], ["stribeck@1,3"]),
        ([replace(STRIBECK, joint=joint) for joint in (1, 2, 3)], ["stribeck@all"]),
        ([EffectChoice("tilt")], ["tilt"]),
        ([RIPPLE, RIPPLE], ["ripple@2,2"]),
    ],
)
def test_effects_are_written_as_they_are_typed(effects, told):
    """An effect of several joints is one word."""
    assert names(effects, 3) == told


def test_a_removal_is_a_step(tmp_path):
    """What a model lacks of the one before has a minus."""
    path = experiment(tmp_path / "results")
    keep(path, model(RIPPLE, rmse=0.02), ARM)
    assert step(read_history(path.parent).ladders[0].rungs[3]) == ["− stribeck@1"]


def test_sentence_tells_where_the_error_went():
    """From the first to the last model: 0.06 to 0.0225 A fitted, 0.066 to 0.02475 A held out, above 0.01 A."""
    assert ladder_sentence(ladder(3, 2)) == (
        "In 2 steps the error of the fitted runs went from 0.0600 A to 0.0225 A, that of runs which no fit saw from"
        " 0.0660 A to 0.0248 A. Repeated runs differ by 0.0100 A, which no model can remove."
    )


def test_held_out_errors_have_a_column_and_a_table():
    """They are shown for the arm and by joint where there are some, and nowhere else."""
    assert "held out (A)" in [head.text for head in ladder_grid(ladder(2, 2)).header]
    assert len(joint_grids(ladder(2, 2))) == 2 and len(joint_grids(ladder(2, 2, heldout=False))) == 1


def test_page_tells_the_ladder(tmp_path):
    """With several models the page has the section, its figure and tables; with one it has none."""
    path = experiment(tmp_path / "results")
    told = replace(stories.story(), ladder=ladder_of(path))
    html = page(told)
    assert 'id="ladder"' in html and "figure-ladder" in html and "+ stribeck@1" in html
    alone = replace(told, ladder=replace(told.ladder, rungs=told.ladder.rungs[:1]))
    assert 'id="ladder"' not in page(alone) and list(drawings(alone)) == []


def test_only_the_current_model_has_a_ladder(tmp_path):
    """A report on another file, or without kept models, tells none."""
    path = experiment(tmp_path / "results")
    assert ladder_of(path) is not None
    assert ladder_of(path.parent / "models" / "001-base.json") is None
    assert ladder_of(tmp_path / "model.json") is None
    assert ladder_of(Path("-")) is None
