"""The report: one self-contained HTML page, whose sections are found by looking into ``sections/``, and its files."""

import importlib
import inspect
import pkgutil
from collections.abc import Iterable, Iterator, Mapping, Sequence

from markupsafe import Markup

from pumaid import __version__
from pumaid.reporting import sections
from pumaid.reporting.context import ReportContext
from pumaid.reporting.documents import TABLE_FORMS, frame_as, parameters_as, runs_frame
from pumaid.reporting.figures.style import DARK, INLINE, Drawing
from pumaid.reporting.sections import Content, Section
from pumaid.reporting.table import environment
from pumaid.reporting.tables import comparison_table

#: A figure on the page; the blanks are the file's name, the style, the picture, the title and the caption.
_FIGURE = Markup(
    '<figure id="figure-{}" class="{}">\n<div class="picture">{}</div>\n'
    "<figcaption><b>{}.</b> {}</figcaption>\n</figure>"
)


def all_contents(context: ReportContext) -> list[tuple[Section, Content]]:
    """The sections that have something to show, in the order of the page, with what their templates see."""
    contents = []
    for info in pkgutil.iter_modules(sections.__path__):
        module = importlib.import_module(f"{sections.__name__}.{info.name}")
        for _, kind in inspect.getmembers(module, inspect.isclass):
            if issubclass(kind, Section) and kind is not Section:
                section = kind()
                contents.append((section, section.content(context)))
    ordered = sorted(contents, key=lambda item: item[0].order)
    return [(section, content) for section, content in ordered if content is not None]


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
        picture = Markup(pictures[drawing.name])
        return _FIGURE.format(drawing.name, style, picture, drawing.title, drawing.caption)

    templates, robot = environment(), context.robot.name
    parts = [
        Markup(templates.get_template(f"{section.name}.html").render(content, figure=figure))
        for section, content in contents
    ]
    names = [section for section, _ in contents]
    whole = templates.get_template("page.html")
    return whole.render(robot=robot, sections=names, parts=parts, version=__version__, dark=DARK)


def report_files(context: ReportContext, forms: Iterable[str]) -> Iterator[tuple[str, bytes]]:
    """Tables, figures in some `forms` and the page, which comes last: relative name and content; nothing is written."""
    for form in ("csv", "parquet", "latex", "markdown"):
        content = parameters_as(context.estimate, context.robot, form, units=context.units)
        yield f"tables/parameters.{TABLE_FORMS[form]}", content
    table = comparison_table(context.comparison, context.robot)
    yield "tables/comparison.tex", table.latex().encode("utf-8")
    yield "tables/comparison.md", table.markdown().encode("utf-8")
    for form in ("csv", "parquet"):
        yield f"tables/runs.{form}", frame_as(runs_frame(context.comparison), form)
    contents, pictures = all_contents(context), {}
    for drawing in all_figures(contents):
        files = drawing.files([*forms, INLINE])
        pictures[drawing.name] = files.pop(INLINE).decode("utf-8")
        yield from ((f"figures/{drawing.name}.{form}", content) for form, content in files.items())
    yield "report.html", page(context, contents, pictures).encode("utf-8")
