"""The report: one self-contained HTML page, whose sections are found by looking into ``sections/``, and its files."""

from __future__ import annotations

import functools
import importlib
import inspect
import pkgutil
from collections.abc import Iterable, Iterator, Mapping

from markupsafe import Markup

from pumaid import __version__
from pumaid.reporting import sections
from pumaid.reporting.context import ReportContext
from pumaid.reporting.documents import TABLE_FORMS, frame_as, parameters_as, runs_frame, table_as
from pumaid.reporting.figures.style import DARK, INLINE, Drawing
from pumaid.reporting.sections import Content, Section
from pumaid.reporting.table import environment
from pumaid.reporting.tables import comparison_table


@functools.cache
def all_sections() -> tuple[Section, ...]:
    """Every section, in the order of the page."""
    instances: list[Section] = []
    for info in pkgutil.iter_modules(sections.__path__):
        module = importlib.import_module(f"{sections.__name__}.{info.name}")
        for member in vars(module).values():
            if inspect.isclass(member) and issubclass(member, Section) and member.__module__ == module.__name__:
                instances.append(member())
    return tuple(sorted(instances, key=lambda section: section.order))


def all_figures(context: ReportContext) -> list[Drawing]:
    """Every figure of the report, in the order of the page."""
    return [drawing for _, content in _contents(context) for drawing in _drawings(content)]


def _contents(context: ReportContext) -> list[tuple[Section, Content]]:
    """The sections that have something to show, with what their templates see."""
    return [(section, section.content(context)) for section in all_sections() if section.applies(context)]


def _drawings(content: object) -> Iterator[Drawing]:
    if isinstance(content, Drawing):
        yield content
    elif isinstance(content, dict | list):
        for item in content.values() if isinstance(content, dict) else content:
            yield from _drawings(item)


def page(context: ReportContext, *, inline: Mapping[str, str] | None = None) -> str:
    """The report as an HTML document without outside references; `inline`: figures by name that are drawn already."""

    def figure(drawing: Drawing, style: str = "") -> Markup:
        svg = Markup((inline or {}).get(drawing.name) or drawing.inline())
        caption = Markup("<b>{}.</b> {}").format(drawing.title, drawing.caption)
        template = Markup(
            '<figure id="figure-{}" class="{}">\n<div class="picture">{}</div>\n<figcaption>{}</figcaption>\n</figure>'
        )
        return template.format(drawing.name, style, svg, caption)

    contents = _contents(context)
    parts = []
    for section, content in contents:
        template = environment().get_template(f"{section.name}.html")
        parts.append(Markup(template.render(content, figure=figure)))
    return (
        environment()
        .get_template("page.html")
        .render(
            robot=context.robot.name,
            sections=[section for section, _ in contents],
            parts=parts,
            version=__version__,
            dark=DARK,
        )
    )


def report_files(context: ReportContext, forms: Iterable[str]) -> Iterator[tuple[str, bytes]]:
    """Tables, figures in some `forms` and the page, which comes last: relative name and content; nothing is written."""
    for form in ("csv", "parquet", "latex", "markdown"):
        content = parameters_as(context.estimate, context.robot, form, units=context.units)
        yield f"tables/parameters.{TABLE_FORMS[form]}", content
    for form in ("latex", "markdown"):
        table = comparison_table(context.comparison, context.robot)
        yield f"tables/comparison.{TABLE_FORMS[form]}", table_as(table, form)
    for form in ("csv", "parquet"):
        yield f"tables/runs.{form}", frame_as(runs_frame(context.comparison), form)
    inline = {}
    for drawing in all_figures(context):
        files = drawing.files([*forms, INLINE])
        inline[drawing.name] = files.pop(INLINE).decode("utf-8")
        yield from ((f"figures/{drawing.name}.{form}", content) for form, content in files.items())
    yield "report.html", page(context, inline=inline).encode("utf-8")
