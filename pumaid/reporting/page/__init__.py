"""The report: one self-contained HTML page, whose sections are found by looking into this folder, and its files."""

import importlib
import pkgutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from pumaid import __version__
from pumaid.dataset import BLOCK, Dataset
from pumaid.diagnosis.records import Diagnosis
from pumaid.estimate import Estimate
from pumaid.estimation.evaluate import Comparison, RunScore
from pumaid.joint_bins import SAME_POSTURE
from pumaid.reporting.documents import TABLE_FORMS, frame_as, parameters_as, scores_frame
from pumaid.reporting.figures.style import DARK, INLINE, Drawing
from pumaid.reporting.table import environment
from pumaid.reporting.tables import comparison_table
from pumaid.reporting.text import in_unit
from pumaid.results.history import Ladder
from pumaid.robot import Robot, posture_groups

#: What a section's template sees by name.
Content = dict[str, object]

#: A figure on the page; the blanks are the file's name, the style, the picture, the title and the caption.
_FIGURE = Markup(
    '<figure id="figure-{}" class="{}">\n<div class="picture">{}</div>\n'
    "<figcaption><b>{}.</b> {}</figcaption>\n</figure>"
)


@dataclass(frozen=True, eq=False, slots=True)
class ReportContext:
    """Inputs of figures and sections; `ladder`: the models of the experiment that can be compared with this one.

    `units` is ``"rad"`` or ``"deg"``, the unit of angles; `stale` are sentences on why the diagnosis may not apply to
    this model and these logs.
    """

    robot: Robot
    estimate: Estimate
    dataset: Dataset
    comparison: Comparison
    units: str = "rad"
    diagnosis: Diagnosis | None = None
    stale: tuple[str, ...] = ()
    ladder: Ladder | None = None

    def moving(self) -> list[int]:
        """Joints (from 1) that have runs."""
        return sorted({score.run.joint for score in self.comparison.runs})

    def unit(self, joint: int) -> tuple[float, str]:
        """Factor and name of the unit in which positions of a joint (SI) are shown: ``rad``, ``deg`` or ``m``."""
        return in_unit(self.robot.joint(joint).position_unit, self.units)

    def postures(self, joint: int) -> list[list[RunScore]]:
        """Runs of a joint by the positions of the other joints, the largest group first; blocks are one group."""
        scores = self.comparison.of_joint(joint)
        blocks = [score for score in scores if score.run.kind == BLOCK]
        steady = [score for score in scores if score.run.kind != BLOCK]
        held = np.array([score.run.posture for score in steady])
        groups = [[steady[number] for number in group] for group in posture_groups(held, SAME_POSTURE)]
        return sorted([*groups, blocks] if blocks else groups, key=lambda group: -len(group))


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


def all_contents(context: ReportContext) -> list[tuple[Section, Content]]:
    """The sections that have something to show, in the order of the page, with what their templates see."""
    modules = [importlib.import_module(f"{__name__}.{info.name}") for info in pkgutil.iter_modules(__path__)]
    sections = sorted((section for module in modules for section in module.SECTIONS), key=lambda item: item.order)
    contents = [(section, section.content(context)) for section in sections]
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
    return templates.get_template("page.html").render(
        robot=robot, sections=[section for section, _ in contents], parts=parts, version=__version__, dark=DARK
    )


def report_files(context: ReportContext, forms: Sequence[str]) -> Iterator[tuple[str, bytes]]:
    """Tables, figures in some `forms` and the page, which comes last: relative name and content; nothing is written."""
    for form in ("csv", "parquet", "latex", "markdown"):
        yield (
            f"tables/parameters.{TABLE_FORMS[form]}",
            parameters_as(context.estimate, context.robot, form, units=context.units),
        )
    table = comparison_table(context.comparison, context.robot)
    yield "tables/comparison.tex", table.latex().encode("utf-8")
    yield "tables/comparison.md", table.markdown().encode("utf-8")
    for form in ("csv", "parquet"):
        yield f"tables/runs.{form}", frame_as(scores_frame(context.comparison, context.robot), form)
    contents, pictures = all_contents(context), dict[str, str]()
    for drawing in all_figures(contents):
        pictures[drawing.name] = drawing.file(INLINE).decode("utf-8")
        yield from ((f"figures/{drawing.name}.{form}", drawing.file(form)) for form in forms)
    yield "report.html", page(context, contents, pictures).encode("utf-8")
