"""The report: one self-contained HTML page, with the sections of every report and those of files in this folder."""

import importlib
import pkgutil
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from pumaid import __version__
from pumaid.diagnosis.records import Finding, JointDiagnosis, causes_in
from pumaid.effects import catalogue
from pumaid.reporting import tables, text
from pumaid.reporting.diagnosis import diagnosis_blocks, finding_table, headline
from pumaid.reporting.documents import parameters_frame, scores_frame
from pumaid.reporting.figures import model
from pumaid.reporting.figures.experiment import MOST_RUNS, run_figure
from pumaid.reporting.figures.model import ReportContext
from pumaid.reporting.figures.style import DARK, INLINE, Drawing
from pumaid.reporting.run_tables import axes_table, rejection_table, runs_by_joint_table
from pumaid.reporting.table import Table, environment, renamed
from pumaid.results.history import Rung

__all__ = ["ReportContext", "Section", "all_contents", "all_figures", "page", "report_files"]

#: What a section's template sees by name.
Content = dict[str, object]

#: A figure on the page; the blanks are the file's name, the style, the picture, the title and the caption.
_FIGURE = Markup(
    '<figure id="figure-{}" class="{}">\n<div class="picture">{}</div>\n'
    "<figcaption><b>{}.</b> {}</figcaption>\n</figure>"
)

#: Limits of the method, whatever the data.
METHOD_LIMITS = (
    "Parameters are in units of each joint's own motor current; torque constants and gear ratios are neither known nor"
    " needed.",
    "Lengths a and d of a chain of revolute joints are absorbed in the parameters: a wrong length in the recipe is not"
    " detected here and does not change the predicted current.",
    "At constant speed there is no inertia in the current; only strokes and blocks of any motion contain it.",
    "Confidence intervals treat a run as one observation, because its samples share their error. With fewer than about"
    " ten runs a joint they are wide.",
    "Predictions are reliable within the postures, speeds and directions of the fitted runs.",
)

#: Runs in the table of those with the largest errors.
WORST = 8


@dataclass(frozen=True, slots=True)
class Section:
    """One section of the page: its template and anchor, heading, place on the page (with gaps for new ones), content.

    A module of this folder lists its own in ``SECTIONS``. The template ``templates/NAME.html`` sees `content`, where it
    is escaped; None where there is nothing to show. Tables stand in it as ``{{ table }}``, figures as
    ``{{ figure(drawing) }}``; drawings in the content, also in lists, become files of the report.
    """

    name: str
    title: str
    order: int
    content: Callable[[ReportContext], Content | None]


# Sections of every report


def summary(context: ReportContext) -> Content:
    """The page's first screen."""
    scores, path = context.comparison.joints, context.ladder.path if context.ladder else ()
    notes = context.estimate.notes
    misfits = [*causes_in(notes), *(note for note in notes if note.slug == "model-misses")]
    doubts = [f"{note.text[:1].upper()}{note.text[1:]}." for note in misfits]
    return {
        "sentences": [
            *([headline(context.diagnosis, context.robot)] if context.diagnosis else doubts),
            *([progress(path)] if len(path) > 1 else []),
            *text.summary_sentences(context.dataset, context.estimate),
        ],
        "joints": [text.joint_sentence(score, context.robot) for score in scores],
        "findings": finding_table(context.diagnosis, context.robot)
        if context.diagnosis and context.diagnosis.findings
        else None,
        "shares": model.share_figure(context) if any(score.shares for score in scores) else None,
        "steps": model.history_figure(context.ladder) if context.ladder and len(path) > 1 else None,
    }


def progress(path: Sequence[Rung]) -> str:
    """What the steps from the first model to the current one did to the arm's error."""
    first, last = path[0].whole, path[-1].whole
    words = [word for rung in path[1:] for word in text.changes(rung)]
    falls = [
        f"of {runs} runs from {text.amperes(first[name])} to {text.amperes(last[name])}"
        for runs, name in (("fitted", "rmse"), ("held-out", "heldout"))
        if first[name] is not None and last[name] is not None
    ]
    floor = "" if last["noise_floor"] is None else f" (noise floor {text.amperes(last['noise_floor'])})"
    return f"Steps since the first model ({', '.join(words)}) took the arm's RMSE {text.listed(falls)}{floor}."


def arm(context: ReportContext) -> Content:
    """Where the joints' axes are."""
    robot = context.robot
    return {
        "robot": robot,
        "gravity": ", ".join(f"{component:.6g}" for component in robot.gravity),
        "table": axes_table(robot, context.units),
    }


def data(context: ReportContext) -> Content:
    """What the logs contain."""
    dataset, robot, units = context.dataset, context.robot, context.units
    return {
        "joints": runs_by_joint_table(dataset, robot, units=units),
        "picture": run_figure(dataset, robot, units, limit=MOST_RUNS) if dataset.runs else None,
        "rejects": rejection_table(dataset) if dataset.rejects else None,
    }


def parameters(context: ReportContext) -> Content:
    """The paper's Table I for this arm."""
    return {
        "table": tables.parameter_table(context.estimate, context.robot, context.units),
        "sums": tables.combination_table(context.estimate),
        "figures": model.curve_figures(context),
    }


def prediction(context: ReportContext) -> Content:
    """The paper's Fig. 4 for each joint."""
    ways = {(score.run.joint, score.run.direction) for score in context.comparison.runs}
    return {
        "both_ways": any((joint, -1) in ways and (joint, 1) in ways for joint in context.moving()),
        "table": tables.comparison_table(context.comparison, context.robot),
        "figures": [model.current_figure(context, joint) for joint in context.moving()],
    }


def residuals(context: ReportContext) -> Content | None:
    """What the model does not explain."""
    if not context.comparison.runs:
        return None
    return {
        "parts": tables.budget_table(context.comparison, context.robot),
        "figures": [model.residual_figure(context, joint) for joint in context.moving()],
        "worst": tables.worst_runs_table(context.comparison, context.robot, count=WORST, units=context.units),
    }


def missing(context: ReportContext) -> Content | None:
    """The diagnosis that was made of the model, as `pumaid diagnose` prints it, with a figure of each finding."""
    if context.diagnosis is None:
        return None

    def figures(number: int, item: Finding | JointDiagnosis | None) -> list[Drawing]:
        if isinstance(item, JointDiagnosis):
            shape = item.unexplained
            return [model.shape_figure(item.joint, shape, context.robot, units=context.units)] if shape else []
        return [
            model.finding_figure(*pair, context.robot, name=f"finding_{number}", units=context.units)
            for pair in ([(item, curve) for curve in item.curves] if item else [])
        ]

    blocks = diagnosis_blocks(context.diagnosis, context.robot, units=context.units)
    return {
        "stale": context.stale,
        "blocks": [{"parts": parts, "figures": figures(number, item)} for number, (item, parts) in enumerate(blocks)],
    }


def history(context: ReportContext) -> Content | None:
    """The models of the experiment, if there are several."""
    ladder = context.ladder
    return {"table": tables.history_table(ladder)} if ladder and len(ladder.rungs) > 1 else None


def limits(context: ReportContext) -> Content:
    """What the numbers do not say."""
    return {
        "notes": text.merge_notes((*context.dataset.notes, *context.estimate.notes, *context.comparison.notes)),
        "limits": METHOD_LIMITS,
    }


def sources(context: ReportContext) -> Content:
    """What is needed to repeat the identification."""
    effects = [
        catalogue()[name]
        for name in dict.fromkeys(name.split(".")[0] for name in context.estimate.names)
        if name in catalogue()
    ]
    titles = {x.source: [effect.title for effect in effects if effect.source == x.source] for x in effects}
    fitted, compared = context.estimate.logs, context.comparison.logs
    rows = [
        ["recipe", context.robot.origin or "in memory", context.robot.digest or "-"],
        *(["fitted log", name, digest] for name, digest in fitted.items()),
        *(["compared log", name, digest] for name, digest in compared.items() if digest not in fitted.values()),
    ]
    return {
        "sources": titles,
        "inputs": Table("Inputs", ("kind", "file", "SHA-256"), rows, words=(0, 1, 2)),
        "model_version": context.estimate.version,
    }


SECTIONS = (
    Section("summary", "Summary", 0, summary),
    Section("arm", "Arm", 10, arm),
    Section("data", "Data", 20, data),
    Section("parameters", "Parameters", 30, parameters),
    Section("prediction", "Model against measurement", 40, prediction),
    Section("residuals", "Residuals", 50, residuals),
    Section("diagnosis", "Missing effects", 60, missing),
    Section("history", "History", 70, history),
    Section("limits", "Notes and limits", 80, limits),
    Section("sources", "Sources and versions", 90, sources),
)


# Page and files


def all_contents(context: ReportContext) -> list[tuple[Section, Content]]:
    """The sections that have something to show, in the order of the page, with what their templates see."""
    modules = [importlib.import_module(f"{__name__}.{info.name}") for info in pkgutil.iter_modules(__path__)]
    sections = [*SECTIONS, *(section for module in modules for section in module.SECTIONS)]
    contents = [(section, section.content(context)) for section in sorted(sections, key=lambda item: item.order)]
    return [(section, content) for section, content in contents if content is not None]


def all_figures(content: object) -> Iterator[Drawing]:
    """Every figure in what `all_contents` returned, or in a part of it, in the order of the page."""
    if isinstance(content, Drawing):
        yield content
    elif isinstance(content, dict | list | tuple):
        for item in content.values() if isinstance(content, dict) else content:
            yield from all_figures(item)


def page(context: ReportContext, contents: Sequence[tuple[Section, Content]], pictures: Mapping[str, str]) -> str:
    """The report as an HTML document without outside references; `pictures`: SVG elements of all figures by name."""

    def figure(drawing: Drawing, style: str = "") -> Markup:
        return _FIGURE.format(drawing.name, style, Markup(pictures[drawing.name]), drawing.title, drawing.caption)

    templates, robot = environment(), context.robot.name
    parts = [
        Markup(templates.get_template(f"{section.name}.html").render(content, figure=figure))
        for section, content in contents
    ]
    whole = templates.get_template("page.html").render(
        robot=robot, sections=[section for section, _ in contents], parts=parts, version=__version__, dark=DARK
    )
    unit, pieces = text.current_unit(context.estimate.notes), re.split(r"(<script.*?</script>)", whole, flags=re.DOTALL)
    return "".join(piece if piece.startswith("<script") else renamed(piece, unit) for piece in pieces)


def report_files(context: ReportContext, forms: Sequence[str]) -> Iterator[tuple[str, bytes]]:
    """Tables, figures in some `forms` and the page, which comes last: relative name and content; nothing is written."""
    for name, table in (
        ("parameters", tables.parameter_table(context.estimate, context.robot, context.units)),
        ("comparison", tables.comparison_table(context.comparison, context.robot)),
    ):
        yield f"tables/{name}.tex", table.latex().encode("utf-8")
        yield f"tables/{name}.md", table.markdown().encode("utf-8")
    frames = parameters_frame(context.estimate, context.units), scores_frame(context.comparison, context.robot)
    for name, frame in zip(("parameters", "runs"), frames, strict=True):
        yield f"tables/{name}.csv", frame.to_csv(index=False, lineterminator="\n").encode("utf-8")
    contents, pictures = all_contents(context), dict[str, str]()
    for drawing in all_figures(contents):
        pictures[drawing.name] = drawing.file(INLINE).decode("utf-8")
        yield from ((f"figures/{drawing.name}.{form}", drawing.file(form)) for form in forms)
    yield "report.html", page(context, contents, pictures).encode("utf-8")
