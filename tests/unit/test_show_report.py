"""The page: one file, nothing from outside, every section found, nothing of a name obeyed."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from html.parser import HTMLParser

import diagnoses
import pandas as pd
import pytest
import stories

from pumaid.reporting.export import export, files_of, parameters_as, parameters_frame
from pumaid.reporting.plots import drawings
from pumaid.reporting.report import all_sections, page


class Outline(HTMLParser):
    """Ids, references and open elements of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.references: list[str] = []
        self.tags: list[str] = []
        self.words: list[str] = []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        for name, value in attrs:
            if name == "id":
                self.ids.append(value)
            if name in ("href", "src", "xlink:href", "srcset", "action"):
                self.references.append(value)

    def handle_data(self, data):
        self.words.append(data)


def outline(html: str) -> Outline:
    """A page's outline."""
    found = Outline()
    found.feed(html)
    return found


def told():
    """The small arm's story, diagnosed."""
    return replace(stories.story(units="deg"), diagnosis=diagnoses.small())


@pytest.fixture(scope="module")
def drawn():
    """The figures of that story, for pages whose words are looked at."""
    return {drawing.name: drawing.inline() for drawing in drawings(told())}


@pytest.fixture(scope="module")
def html(drawn):
    """The small arm's page."""
    return page(told(), drawn=drawn)


def test_sections_stand_in_the_order_of_the_story():
    """Arm, data, parameters, prediction, misfit, what is missing, limits, sources after the summary."""
    names = [section.name for section in all_sections()]
    known = ["summary", "arm", "data", "parameters", "prediction", "misfit", "missing", "limits", "sources"]
    assert [name for name in names if name in known] == known


def test_every_section_is_on_the_page(html):
    """Each section can be reached by its anchor, from the list at the top."""
    found = outline(html)
    for section in (one for one in all_sections() if one.applies(told())):
        assert section.name in found.ids and f"#{section.name}" in found.references


def test_page_needs_nothing_from_outside(html):
    """Every reference points into the page."""
    outside = [ref for ref in outline(html).references if not ref.startswith("#") and ref != "data:,"]
    assert outside == [] and "@import" not in html and not re.search(r"url\((?!#)", html)
    assert "script" not in outline(html).tags


def test_ids_are_unique(html):
    """No id occurs twice, figures included."""
    ids = outline(html).ids
    assert len(ids) == len(set(ids)) > 20


def test_names_are_words_not_markup():
    """A hostile name of arm, joint or file stands on the page as it is written."""
    found = outline(page(stories.hostile()))
    assert "script" not in found.tags
    assert any(stories.HOSTILE in words for words in found.words)


def test_says_what_matters_first(html):
    """The summary has a sentence on every joint before any table."""
    words = html[: html.index("<table")]
    assert "Joint 1 (joint 1): the model explains" in words and "noise floor" in words


def test_notes_and_rejects_are_told(html):
    """What was left out and what looked wrong stand on the page with their place."""
    assert "0.2 s are missing" in html and "logs/a.csv, row 7" in html and "joint 1 speeds up for 1.0 s" in html


def test_export_has_page_tables_and_figures():
    """One call yields all files, the page last."""
    told = stories.story()
    names = [name for name, _ in export(told, (files_of(drawing, ["svg"]) for drawing in drawings(told)))]
    assert names[-1] == "report.html" and "figures/spent.svg" in names
    assert {"tables/parameters.csv", "tables/parameters.tex", "tables/runs.parquet", "tables/comparison.md"} < set(
        names
    )


def test_long_tables_hold_the_same_numbers():
    """CSV, Parquet and the records agree."""
    told = stories.story()
    csv = pd.read_csv(io.BytesIO(parameters_as(told.estimate, told.robot, "csv")))
    parquet = pd.read_parquet(io.BytesIO(parameters_as(told.estimate, told.robot, "parquet")))
    assert csv["value"].tolist() == pytest.approx(parquet["value"].tolist(), rel=1e-12, nan_ok=True)
    assert list(csv["name"]) == [value.name for value in told.estimate.values]


def test_degrees_change_value_error_and_interval():
    """In degrees a viscous parameter, its error and its interval shrink alike, and the unit says so."""
    told = stories.story()
    radians = parameters_frame(told.estimate).set_index("name").loc["viscous.j1.plus"]
    degrees = parameters_frame(told.estimate, "deg").set_index("name").loc["viscous.j1.plus"]
    assert degrees["unit"] == "A s/deg"
    for column in ("value", "std_error", "ci_low", "ci_high"):
        assert degrees[column] == pytest.approx(radians[column] * 3.141592653589793 / 180, rel=1e-12)


def test_one_way_is_not_explained_as_two(html, drawn):
    """Half sums and half differences are spoken of only where a joint was moved both ways."""
    told = stories.story()
    runs = tuple(score for score in told.comparison.runs if score.run.direction > 0)
    ahead = page(replace(told, comparison=replace(told.comparison, runs=runs)), drawn=drawn)
    assert "half the difference is friction" in html and "No joint was moved both ways" not in html
    assert "half the difference is friction" not in ahead and "No joint was moved both ways" in ahead


def test_a_diagnosis_is_told_with_evidence_figure_and_command(html):
    """The section says what is missing, shows it, gives the deciding run and the command that adds it."""
    part = html[html.index('<section id="missing">') : html.index('<section id="limits">')]
    assert "stribeck is missing, or viscous_power, which these data cannot tell from it" in part
    assert "pumaid identify logs/ --add stribeck@1" in part and "Runs that would tell stribeck or viscous_power" in part
    assert 'id="figure-finding_1_j1"' in part and 'id="figure-unexplained_j2"' in part
    assert "What these data would have shown" in part and "What was tried" in part


def test_without_a_diagnosis_there_is_no_such_section(drawn):
    """A page of an experiment that was not diagnosed claims nothing about what is missing."""
    assert 'id="missing"' not in page(stories.story(), drawn=drawn)


def test_a_stale_diagnosis_says_so(drawn):
    """A diagnosis of another model or other logs is told with a warning before anything else."""
    old = replace(told(), stale=("The diagnosis is of another model.",))
    part = page(old, drawn=drawn).partition('<section id="missing">')[2]
    assert part.index("The diagnosis is of another model.") < part.index("stribeck")


def test_nothing_missing_is_told_with_its_limits(drawn):
    """On a clean arm the section says what these data can show, and what they would have shown."""
    quiet = (replace(diagnoses.quiet(1), limits=diagnoses.limits(1)), diagnoses.quiet(2))
    clean = replace(diagnoses.clean(), joints=quiet)
    part = page(replace(told(), diagnosis=clean), drawn=drawn).partition('<section id="missing">')[2]
    assert (
        "Nothing is missing that these data can show." in part and "larger than 0.030 A would have been found" in part
    )
