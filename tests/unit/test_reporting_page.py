"""The report: one file, nothing from outside, each section found, names escaped."""

import io
import json
import re
import shutil
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser
from pathlib import Path

import diagnoses
import numpy as np
import pandas as pd
import pytest
import report_contexts
import worlds
from ladders import experiment

import pumaid
from pumaid.diagnosis.compare import compare
from pumaid.diagnosis.records import Size
from pumaid.errors import Note, Where
from pumaid.estimation.evaluate import predictions, rmse
from pumaid.reporting.documents import parameters_frame
from pumaid.reporting.page import SECTIONS, ReportContext, all_contents, all_figures, page, report_files, what_if
from pumaid.results.history import ladder_of
from pumaid.robot import EffectChoice


class Outline(HTMLParser):
    """Ids, references, tags and text of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.references: list[str] = []
        self.tags: list[str] = []
        self.texts: list[str] = []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.ids += [value for name, value in attrs if name == "id"]
        self.references += [v for name, v in attrs if name in ("href", "src", "xlink:href", "srcset", "action")]

    def handle_data(self, data):
        self.texts.append(data)


def outline(html: str) -> Outline:
    """A page's outline."""
    parser = Outline()
    parser.feed(html)
    return parser


@pytest.fixture(scope="module")
def context():
    """A small arm with a diagnosis."""
    return replace(report_contexts.small(units="deg"), diagnosis=diagnoses.small())


@pytest.fixture(scope="module")
def ripple():
    """The same arm logged fast, with a ripple in its model."""
    robot = replace(worlds.PENDULUM, effects=(EffectChoice("ripple", 1, {"frequency": 8.0}),))
    plan = worlds.experiment(worlds.PENDULUM, postures=1, speeds=(0.3, 0.8))
    dataset = worlds.dataset(worlds.drawn(worlds.PENDULUM), plan, rate=400.0)
    estimate = pumaid.identify(dataset, robot)
    return ReportContext(robot, estimate, dataset, compare(estimate, dataset, robot))


@pytest.fixture(scope="module")
def files(context):
    """Its report."""
    return dict(report_files(context, ["svg"]))


@pytest.fixture(scope="module")
def html(files):
    """Its page."""
    return files["report.html"].decode()


def words_of(context, *names: str, drawn: str = "") -> str:
    """A page of these sections whose words are looked at: of its figures only `drawn` is drawn."""
    sections = (*SECTIONS, *what_if.SECTIONS)
    contents = [(section, section.content(context)) for section in sections if section.name in names]
    shown = [(section, content) for section, content in contents if content is not None]
    figures = {figure.name: figure for figure in all_figures(shown)}
    pictures = dict.fromkeys(figures, "<svg/>")
    return page(context, shown, pictures | ({drawn: figures[drawn].file("inline").decode()} if drawn else {}))


def section(html: str, name: str) -> str:
    """A section of a page, entities resolved."""
    return unescape(html.partition(f'<section id="{name}">')[2].partition("</section>")[0])


def test_sections_are_on_the_page_in_order(context, html):
    """Each section can be reached by its anchor; ids are unique, figures included."""
    names = [part.name for part, _ in all_contents(context)]
    order = "summary what_if arm data parameters prediction residuals diagnosis limits sources"
    assert names == order.split()
    ids = outline(html).ids
    assert [name for name in ids if name in names] == names and len(ids) == len(set(ids)) > 20
    assert {f"#{name}" for name in names} <= set(outline(html).references)


def test_page_needs_nothing_from_outside(html):
    outside = [ref for ref in outline(html).references if not ref.startswith("#") and ref != "data:,"]
    assert outside == [] and "@import" not in html and not re.search(r"url\((?!#)", html)
    assert outline(html).tags.count("script") == 3  # data, uPlot and what moves them, all of them inside


def test_names_are_text_not_markup():
    """A hostile name of arm, joint or file stands on the page as it is written."""
    parsed = outline(words_of(report_contexts.hostile(), "summary", "data", "parameters", drawn="spent"))
    assert "script" not in parsed.tags
    assert any(report_contexts.HOSTILE in text for text in parsed.texts)


def test_what_can_be_moved_is_plain_json(html):
    """Numbers are finite, names cannot end the script, and the library states its licence."""
    hostile = words_of(report_contexts.hostile(), "what_if")
    for text in (html, hostile):
        data = re.search(r'id="what_if_data">(.*?)</script>', text, re.DOTALL)[1]
        joints = json.loads(data, parse_constant=pytest.fail)
        assert len(joints) == 2 and "<" not in data and "uPlot (v1.6" in text
    assert all(report_contexts.HOSTILE in joint["title"] for joint in joints)


def error_of(joint, change: list[float]) -> float:
    """The RMSE (A) of fitted runs by sums of products, the columns' factors changed by `change`."""
    size, square = len(change) + 1, 0.0
    for triangle in joint["errors"][0]["grams"]:
        gram = np.zeros((size, size))
        gram[np.triu_indices(size)] = triangle
        square += max([*change, -1.0] @ (gram + np.triu(gram, 1).T) @ [*change, -1.0], 0.0)
    return (square / joint["errors"][0]["samples"]) ** 0.5


@pytest.mark.parametrize(
    ("name", "by", "within"),
    [("coulomb.j1.plus", 0.1, 1e-9), ("gravity.l1.y", 0.05, 1e-5), ("ripple.j1.cos", 0.02, 5e-3)],
)
def test_sums_of_products_are_the_programs_errors(ripple, name, by, within):
    """At many samples a bin, too, where a current that changes inside a bin leaves less than its noise there."""
    joint, names = what_if.what_if(ripple)["joints"][0], ripple.estimate.names
    change = [by * (joint["parameters"][p].get("name") == name) for p, *_ in joint["columns"]]
    solution = ripple.estimate.solution + by * (np.array(names) == name)
    part = predictions(replace(ripple.estimate, solution=solution), ripple.dataset, ripple.robot)[1]
    assert error_of(joint, change) == pytest.approx(rmse([(part, part.counted)]), rel=within)


def test_effects_of_any_motion_are_off_as_the_program_splits_them(tmp_path):
    """Without gravity what its parameters ask by inertia stays; without all effects the whole current is left."""
    folder = shutil.copytree(Path(__file__).parents[2] / "sample_logs" / "ur5e_at_work", tmp_path / "arm")
    arm = pumaid.load(folder)
    dataset, robot = arm.dataset(), arm.robot
    estimate = pumaid.identify(dataset, robot)
    context = ReportContext(robot, estimate, dataset, compare(estimate, dataset, robot))
    joint, part = what_if.what_if(context)["joints"][1], predictions(estimate, dataset, robot)[2]
    values, count = [joint["parameters"][p]["value"] for p, *_ in joint["columns"]], part.bins.count
    weight = part.parts[:, part.effects.index("gravity")]
    without = np.average((part.residual + weight) ** 2 + part.inside, weights=count) ** 0.5
    change = [-value * (name == "gravity") for value, (_, name, _) in zip(values, joint["columns"], strict=True)]
    assert error_of(joint, change) == pytest.approx(without, rel=1e-6)
    whole = np.average(part.bins.current**2 + part.bins.inside, weights=count) ** 0.5
    assert error_of(joint, [-value for value in values]) == pytest.approx(whole, rel=1e-6)


def test_each_ripple_that_is_missing_is_tried_by_itself(ripple):
    """Beside the ripple in the model a second is a column of its own, at its frequency, with the diagnosis' size."""
    sizes = (Size("cos", 0.04, 0.01, "A"),)
    found = replace(diagnoses.stribeck(), effect="ripple", joint=1, shape={"frequency": 20.0}, sizes=sizes)
    joint = what_if.what_if(replace(ripple, diagnosis=replace(diagnoses.small(), findings=(found,))))["joints"][0]
    names = {(name, is_there) for _, name, is_there in joint["columns"] if "ripple" in name}
    assert names == {("ripple", True), ("ripple_2", False)}
    assert joint["shapes"] == {"ripple": "frequency 8", "ripple_2": "frequency 20"}
    values = {item["name"]: item["value"] for item in joint["parameters"] if "name" in item}
    assert values["ripple.j1.cos_2"] == 0.04 and values["ripple.j1.sin_2"] is None


def test_summary_comes_before_tables(context, html):
    """A sentence on each joint comes before all tables but that of what is missing, which tells how far errors fall."""
    first = html[: html.index("<table", html.index("<caption>What is missing</caption>"))]
    assert first.count("<table") == 1 and " → " in first
    assert "Joint 1 (joint 1): the model explains" in first and "noise floor" in first
    assert "0.2 s are missing" in html and "logs/a.csv, row 7" in html and "joint 1 speeds up for 1.0 s" in html
    # Without a diagnosis a likely cause comes before what is missed.
    notes = (Note("model-misses", "joint 1 is missed by 2 A", Where()), Note("order-wrong", "two joints", Where()))
    first = words_of(replace(context, diagnosis=None, estimate=replace(context.estimate, notes=notes)), "summary")
    assert 0 < first.index("Two joints.") < first.index("Joint 1 is missed by 2 A.")


def test_one_direction_is_not_explained_as_two(context, html):
    """Half sums and half differences are mentioned only where a joint moves in both directions."""
    runs = tuple(score for score in context.comparison.runs if score.run.direction > 0)
    ahead = words_of(replace(context, comparison=replace(context.comparison, runs=runs)), "prediction")
    assert "half the difference is friction" in html and "half the difference is friction" not in ahead


def test_a_diagnosis_has_evidence_figures_and_command(html):
    """The section says what is missing, shows it, gives the deciding runs and the command that adds it."""
    part = section(html, "diagnosis")
    assert "stribeck is missing (these data do not separate it from viscous_power)" in part
    assert "pumaid identify logs/ --add stribeck@1" in part and "To decide: " in part
    assert 'id="figure-finding_1_j1"' in part and 'id="figure-unexplained_j2"' in part
    assert "Detection limits" in part and "Candidates" in part


def test_stale_and_clean_diagnoses_say_so(context):
    """A diagnosis of another model has a warning first; a clean one its limits; without one there is no section."""
    old = section(words_of(replace(context, stale=("It is of another model.",)), "diagnosis"), "diagnosis")
    assert old.index("It is of another model.") < old.index("stribeck")
    quiet = (replace(diagnoses.quiet(1), limits=diagnoses.limits(1)), diagnoses.quiet(2))
    clean = replace(context, diagnosis=replace(diagnoses.clean(), joints=quiet))
    part = section(words_of(clean, "diagnosis"), "diagnosis")
    assert "nothing is missing that these data can show." in part and "detected with a probability of 80 %" in part
    assert 'id="diagnosis"' not in words_of(replace(context, diagnosis=None), "diagnosis")


def test_history_is_shown_where_there_are_several_models(tmp_path, context):
    """With several models the page has the section, its first screen what each step did; with one neither."""
    path = experiment(tmp_path / "results")
    several = replace(context, ladder=ladder_of(path))
    html, first = words_of(several, "history"), section(words_of(several, "summary"), "summary")
    assert 'id="history"' in html and "+ stribeck@1" in html
    # Of 300 samples and 100 with twice the error, sqrt(1.75) times that of joint 1.
    steps = "(+ stribeck@1, + ripple@2) took the arm's RMSE of fitted runs from 0.0397 A to 0.0146 A"
    assert "figure-ladder" in first and steps in " ".join(first.split())
    alone = replace(several, ladder=replace(several.ladder, rungs=several.ladder.rungs[:1]))
    assert 'id="history"' not in words_of(alone, "history") and "figure-ladder" not in words_of(alone, "summary")
    assert ladder_of(tmp_path / "model.json") is None and ladder_of(Path("-")) is None


def test_a_report_has_page_tables_and_figures(context, files):
    """One call yields all files, the page last; CSV and the records agree."""
    assert list(files)[-1] == "report.html" and "figures/spent.svg" in files
    assert {"tables/parameters.tex", "tables/runs.csv", "tables/comparison.md"} < set(files)
    csv = pd.read_csv(io.BytesIO(files["tables/parameters.csv"]))
    values = parameters_frame(context.estimate, "deg")["value"].tolist()
    assert csv["value"].tolist() == pytest.approx(values, rel=1e-12, nan_ok=True)
    assert list(csv["name"]) == [value.name for value in context.estimate.values]


def test_degrees_change_value_error_and_interval(context):
    """In degrees a viscous parameter, its error and its interval shrink alike, and the unit says so."""
    radians, degrees = (
        parameters_frame(context.estimate, unit).set_index("name").loc["viscous.j1.plus"] for unit in ("rad", "deg")
    )
    assert degrees["unit"] == "A s/deg"
    for column in ("value", "std_error", "ci_low", "ci_high"):
        assert degrees[column] == pytest.approx(radians[column] * 3.141592653589793 / 180, rel=1e-12)
