"""The residual budget in words, bars, JSON and figure."""

from __future__ import annotations

import json
from dataclasses import replace
from html import unescape

import budgets
import pytest
import stories
import worlds
from test_budget import KINDS

from pumaid.records import Budget, BudgetPart, Comparison, JointScore
from pumaid.reporting import budget as words
from pumaid.reporting.plots import budget as plot
from pumaid.reporting.plots import misfit
from pumaid.reporting.plots.style import styled
from pumaid.reporting.report import page
from pumaid.results.documents import as_text


def score(budget: Budget | None, joint: int = 2) -> JointScore:
    """A joint's figures with this budget."""
    rmse = None if budget is None else budget.mean_square**0.5
    return JointScore(joint, 8, 800, rmse, 0.0, 0.9, None, None, budget=budget)


def made(**parts: float) -> Budget:
    """A budget of these parts (A2), none of them found."""
    names = ("noise_shared", "noise_inside", "smooth", "fast", "start", "odd", "even", "time", "unassigned")
    return Budget(sum(parts.values()), tuple(BudgetPart(name, parts.get(name, 0.0)) for name in names), 16, 16)


@pytest.fixture(scope="module")
def rippled():
    """A joint that ripples and has friction over position."""

    def left(*at):
        return 1.5 * KINDS["fast", "position"](*at) + KINDS["smooth", "direction"](*at)

    return budgets.split(budgets.campaign(left, seed=8))


@pytest.fixture(scope="module")
def told(rippled):
    """A comparison: joint 1 never moved, joint 2 ripples."""
    return Comparison("arm", (score(None, 1), score(rippled)), ())


def test_the_sentence_tells_parts_in_order_of_size(rippled):
    """The largest part first, each with its share, then the noise, then the effects that look like it."""
    text = words.budget_sentence(score(rippled), worlds.PENDULUM)
    shares = {part.name: words.share_text(words.part_share(rippled, part)) for part in rippled.parts}
    assert f"{shares['fast']} is ripple with position: 37.3" in text and "cycles per turn" in text
    assert f"{shares['smooth']} is smooth with position and turns round" in text
    assert text.index("ripple with") < text.index("is smooth") < text.index("is noise that no model removes")
    assert text.endswith("Effects that look like it: ripple, position_friction or load_friction.")


def test_every_dependence_has_words():
    """What a budget can find, it can say: each part and variable has a sentence, and each lack too."""
    for part, against in words.SAID:
        one = BudgetPart(part, 0.5, 0.01, True, (against,))
        assert words.part_sentence(made(smooth=1.0), one).startswith("50 % ")
    from pumaid.diagnosis.budget import POINTS_TO
    from pumaid.effects import catalogue

    assert {key for key in POINTS_TO if key[0] != "fast"} == set(words.SAID)
    assert {name for names in POINTS_TO.values() for name in names} <= set(catalogue())


def test_bars_are_as_long_as_their_shares():
    """Forty characters are the whole error; what is noise is light, what is more than noise is solid."""
    budget = made(noise_inside=0.5, smooth=0.25, fast=0.25)
    found = tuple(replace(part, is_more=part.name == "smooth") for part in budget.parts)
    lines = words.bars(replace(budget, parts=found)).split("\n")
    assert [line.count(words.NOISE) for line in lines] == [20, 0, 10]
    assert [line.count(words.CAUSE) for line in lines] == [0, 10, 0]


def test_open_parts_are_said_to_be_open():
    """Without repeats the sentence claims no noise that no model removes, and says what would tell."""
    budget = replace(made(noise_inside=0.8, unassigned=0.2), replicates=0, limits=("no-replicates",))
    text = words.budget_sentence(score(budget), worlds.PENDULUM)
    assert "which only repeated runs would tell" in text and "no model removes" not in text


def test_the_document_adds_up_and_is_plain_json(rippled):
    """The parts of the JSON entry add up to the mean square, shares to 1; a ripple says its cycles and per what."""
    document = json.loads(as_text(words.budget_document(rippled) | {"kind": "x", "format": 1}))
    assert sum(part["mean_square"] for part in document["parts"]) == pytest.approx(document["mean_square"])
    assert sum(part["share"] for part in document["parts"]) == pytest.approx(1.0)
    ripple = next(part for part in document["parts"] if part["name"] == "fast")
    assert ripple["cycles"][0] == pytest.approx(37.3, abs=0.1) and ripple["cycles_per"] == "turn"
    assert "ripple with position" in ripple["text"] and ripple["points_to"] == ["ripple"]
    assert words.budget_document(None) is None


def test_joints_that_lack_the_same_share_a_sentence(told):
    """One line for what several joints lack; a joint that never moved lacks nothing here."""
    thin = replace(made(noise_inside=1.0), limits=("one-posture",))
    comparison = replace(told, joints=(score(thin, 1), score(thin, 2)))
    assert words.limit_sentences(comparison) == [f"every joint: {words.LIMITS['one-posture']}"]
    assert words.noise_only_sentence(comparison, worlds.PENDULUM).startswith("All joints: all that is left is noise")


def test_the_terminal_hears_each_joint_once(told):
    """A heading, a sentence and bars for the joint that has parts, and how to read it; nothing where nothing moved."""
    texts = [part.text for part in words.budget_shown(told, worlds.PENDULUM)]
    assert texts[1] == "Where the error lives" and sum("Joint 2" in text for text in texts) == 1
    still = replace(told, joints=(score(None, 1), score(None, 2)))
    assert words.budget_shown(still, worlds.PENDULUM) == []


def test_the_bars_of_the_figure_fill_their_row():
    """Every joint's bars reach from 0 to the whole error, and the legend names only what is there."""
    story = stories.story()
    with styled():
        figure = plot.draw(story)
    axes = figure.axes[0]
    for row in range(2):
        widths = [bar.get_width() for bar in axes.patches if round(bar.get_y() + bar.get_height() / 2.0) == row]
        assert sum(widths) == pytest.approx(1.0)
    names = {text.get_text() for text in figure.legends[0].get_texts()}
    scores = plot.told(story)
    assert names == {words.LABELS[p.name] for s in scores for p in s.budget.parts if p.mean_square > 0.0}


def test_the_misfit_shows_load_and_budget():
    """The picture of ``compare`` has the budget on top, the current, and the error against what the arm has."""
    with styled():
        figure = misfit.draw(stories.story())
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert titles[0].endswith("where the error lives")
    assert {"measured (dots), predicted", "error by position", "error by speed", "error by load"} <= set(titles)


def test_the_page_tells_the_budget(rippled):
    """The report has the sentence of the joint that ripples, the joint without more, the figure, and what is open."""
    story = stories.story()
    first, second = story.comparison.joints
    plain = replace(first, budget=made(noise_inside=first.rmse**2))
    loud = replace(second, rmse=rippled.mean_square**0.5, budget=replace(rippled, limits=("one-posture",)))
    comparison = replace(story.comparison, joints=(plain, loud))
    html = unescape(page(replace(story, comparison=comparison)))
    assert "Some physics is missing: more is left than noise explains of Joint 2" in html
    assert words.budget_sentence(loud, story.robot) in html
    assert words.noise_only_sentence(comparison, story.robot) in html
    assert f"joint 2: {words.LIMITS['one-posture']}" in html and words.CAPTION in html
