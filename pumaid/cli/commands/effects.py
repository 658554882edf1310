"""``pumaid effects``: the catalogue of physics."""

from __future__ import annotations

import difflib
from typing import Any

import rich_click as click

from pumaid.cli import options
from pumaid.cli.output import document, say, table


@click.command()
@click.argument("name", required=False)
@options.effects_option
@options.json_option
def command(name: str | None, as_json: bool) -> None:
    """The physics that pumaid knows: all effects, or one explained.

    Explaining one prints its law, parameters, signature and look-alikes, and the command that adds it.

    \b
    Example:
      pumaid effects
      pumaid effects stribeck
      pumaid effects --json | jq '.effects[].equation'
    """
    from pumaid.effect_spec import OWN
    from pumaid.effects import catalogue
    from pumaid.errors import ModelError
    from pumaid.reporting.effects import facts
    from pumaid.results.documents import heading

    effects = catalogue()
    if name is not None and name not in effects:
        near = difflib.get_close_matches(name, effects, n=1)
        mend = f"did you mean '{near[0]}'?" if near else f"effects are {', '.join(effects)}; {OWN}"
        raise ModelError("unknown-effect", f"there is no effect '{name}'", mend=mend)
    chosen = list(effects.values()) if name is None else [effects[name]]
    if as_json:
        document(heading("effects") | {"effects": [facts(effect) for effect in chosen]})
    elif name is None:
        _list([facts(effect) for effect in chosen])
    else:
        _explain(facts(chosen[0]), chosen[0])


def _list(chosen: list[dict[str, Any]]) -> None:
    from pumaid.reporting.table import Table

    rows = [
        [
            f"{effect['effect']} (in all models)" if effect["base"] else effect["effect"],
            *(effect["title"], effect["equation"], effect["family"], ", ".join(effect["look_alikes"])),
        ]
        for effect in sorted(chosen, key=lambda effect: not effect["base"])
    ]
    caption = "s sign of motion, q position, v speed, t time, load: of gravity, drawn: the predicted current (A)"
    header = ("effect", "meaning", "current", "family", "look-alikes")
    table(Table("", header, rows, caption=caption, words=(0, 1, 2, 3, 4)))


def _explain(told: dict[str, Any], effect: Any) -> None:
    from pumaid.reporting.effects import signature, sketch

    say(f"{told['effect']}: {told['title']}\n\n{told['equation']}\n\n{told['physics']}\n")
    say(f"parameters of {told['owner']}:")
    _numbers(told["parameters"], "parameter")
    if told["shapes"]:
        say("\nshape (searched, or given):")
        _numbers(told["shapes"], "shape")
    for kind, reason in told["not_at"].items():
        say(f"\nnot at a {kind} joint: {reason}")
    shown = signature(effect)
    say(f"\nsignature ({shown.text}):\n{sketch(shown)}\n")
    if told["look_alikes"]:
        say(f"look-alikes: {', '.join(told['look_alikes'])}")
    say(f"residual depends on: {', '.join(told['shown_by'])}")
    if told["seen_in"]:
        say(f"best seen in: {told['seen_in']}")
    say(f"to add it: {told['command'] or 'it is in all models'}")
    say(f"source: {told['source']}")


def _numbers(items: list[dict[str, Any]], word: str) -> None:
    from pumaid.reporting.effects import bounds, merged
    from pumaid.reporting.table import Table

    rows = []
    for item in merged(items):
        limits, example = bounds(item["low"], item["high"]), f"{item['example']:g}"
        rows.append([item["owner"], item["name"], item["unit"], limits, example, item["meaning"]])
    table(Table("", ("joint", word, "unit", "bounds", "example", "meaning"), rows, words=(0, 1, 2, 3, 5)))
