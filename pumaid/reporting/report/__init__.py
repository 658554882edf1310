"""The report: one self-contained page; its sections are found by looking into ``sections/``."""

from __future__ import annotations

import functools
import importlib
import inspect
import pkgutil
from collections.abc import Mapping

import jinja2
from markupsafe import Markup

from pumaid import __version__
from pumaid.reporting.plots import drawings
from pumaid.reporting.plots.style import DARK, Drawing
from pumaid.reporting.report.base import Section
from pumaid.reporting.story import Story

__all__ = ["Section", "all_sections", "page"]


@functools.cache
def all_sections() -> tuple[Section, ...]:
    """Every section, in the order of the page."""
    folder = importlib.import_module(f"{__name__}.sections")
    found: list[Section] = []
    for info in pkgutil.iter_modules(folder.__path__):
        module = importlib.import_module(f"{folder.__name__}.{info.name}")
        for member in vars(module).values():
            if inspect.isclass(member) and issubclass(member, Section) and member.__module__ == module.__name__:
                found.append(member())
    return tuple(sorted(found, key=lambda section: section.order))


def page(story: Story, *, drawn: Mapping[str, str] | None = None) -> str:
    """The report as one HTML document without any outside reference.

    Parameters
    ----------
    story
        What it tells of.
    drawn
        Figures as SVG elements by name, where they are drawn already.

    Returns
    -------
    html
        Styles and figures are in it; the same story gives the same page.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("pumaid.reporting.report"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    figures = {drawing.name: drawing for drawing in drawings(story)}
    known = drawn or {}
    environment.globals["inline"] = lambda drawing: Markup(known.get(drawing.name) or drawing.inline())
    told = [section for section in all_sections() if section.applies(story)]
    parts = [_part(environment, section, story, figures=figures) for section in told]
    return environment.get_template("page.html").render(
        robot=story.robot.name, sections=told, parts=parts, version=__version__, dark=DARK
    )


def _part(environment: jinja2.Environment, section: Section, story: Story, *, figures: Mapping[str, Drawing]) -> Markup:
    template = environment.get_template(f"{section.name}.html")
    return Markup(template.render(section=section, **section.content(story, figures)))
