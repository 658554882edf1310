"""``pumaid effects``: the catalogue of physics."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Any

import rich_click as click

from pumaid.cli.options import effects_option, json_option
from pumaid.cli.output import document, picture_form, remark, say, table


@click.command()
@click.argument("name", required=False)
@click.option("--picture", type=click.Path(path_type=Path), metavar="FILE", help="Draw it: .png, .svg or .pdf.")
@effects_option
@json_option
def command(name: str | None, picture: Path | None, as_json: bool) -> None:
    """The physics that pumaid knows: all effects, or one explained.

    Explaining one prints its law, parameters and look-alikes, the command that adds it, and what it looks like.

    \b
    Example:
      pumaid effects
      pumaid effects stribeck
      pumaid effects ripple --picture ripple.png
      pumaid effects --json | jq '.effects[].equation'
    """
    from pumaid.choices import OWN
    from pumaid.effects import catalogue
    from pumaid.errors import ModelError
    from pumaid.reporting.effects import facts
    from pumaid.results.documents import heading

    known, form = catalogue(), picture_form(picture)
    if name is not None and name not in known:
        near = difflib.get_close_matches(name, known, n=1)
        mend = f"did you mean '{near[0]}'?" if near else f"effects are {', '.join(known)}; {OWN}"
        raise ModelError("unknown-effect", f"there is no effect '{name}'", mend=mend)
    if picture is not None and name is None:
        raise click.UsageError("--picture draws one effect: name it")
    chosen = list(known.values()) if name is None else [known[name]]
    if as_json:
        document(heading("effects") | {"effects": [facts(effect) for effect in chosen]})
    elif name is None:
        _list([facts(effect) for effect in chosen])
    else:
        _explain(facts(chosen[0]), chosen[0])
    if picture is not None:
        _draw(chosen[0], picture, form)


def _list(chosen: list[dict[str, Any]]) -> None:
    from rich.markup import escape
    from rich.table import Table

    rows = Table("effect", "what it is", "current", "family", "may be mistaken for", box=None, pad_edge=False)
    for one in sorted(chosen, key=lambda one: not one["base"]):
        name = f"{one['effect']} (in every model)" if one["base"] else one["effect"]
        rows.add_row(name, *map(escape, (one["title"], one["equation"], one["family"], ", ".join(one["look_alikes"]))))
    table(rows)
    say("\ns sign of the motion, q position, v speed, t time, load of gravity, drawn: the predicted current (A)")


def _explain(told: dict[str, Any], effect: Any) -> None:
    from pumaid.reporting.signature import signature, sketch

    say(f"{told['effect']}: {told['title']}\n\n{told['equation']}\n\n{told['physics']}\n")
    say(f"parameters of {told['owner']}:")
    _numbers(told["parameters"], "parameter")
    if told["shapes"]:
        say("\nshape (found by searching, or given):")
        _numbers(told["shapes"], "shape")
    for kind, reason in told["not_at"].items():
        say(f"\nnot at a {kind} joint: {reason}")
    shown = signature(effect)
    say(f"\nwhat it looks like ({shown.text}):\n{sketch(shown)}\n")
    if told["look_alikes"]:
        say(f"may be mistaken for: {', '.join(told['look_alikes'])}")
    say(f"shown by: {', '.join(told['shown_by'])} (what the residual depends on where the effect is missing)")
    if told["seen_in"]:
        say(f"seen best in: {told['seen_in']}")
    say(f"to add it: {told['command'] or 'it is in every model'}")
    say(f"source: {told['source']}")


def _numbers(found: list[dict[str, Any]], word: str) -> None:
    from rich.table import Table

    from pumaid.reporting.effects import bounds, merged

    rows = Table("joint", word, "unit", "bounds", "example", "meaning", box=None, pad_edge=False)
    for one in merged(found):
        limits, example = bounds(one["low"], one["high"]), f"{one['example']:g}"
        rows.add_row(one["owner"], one["name"], one["unit"], limits, example, one["meaning"])
    table(rows)


def _draw(effect: Any, picture: Path, form: str) -> None:
    from pumaid.io.write import write_file
    from pumaid.reporting.plots.signature import drawing

    write_file(picture, drawing(effect).file(form))
    remark(f"picture written to {picture}")
