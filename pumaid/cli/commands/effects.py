"""``pumaid effects``: the catalogue of physics."""

from typing import Any

import rich_click as click

from pumaid.cli import options
from pumaid.cli.output import document, say, tables


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
    from pumaid.errors import ModelError, meant
    from pumaid.reporting.effects import facts, sketch
    from pumaid.results.documents import heading

    effects = catalogue()
    if name is not None and name not in effects:
        raise ModelError("unknown-effect", f"there is no effect '{name}'", mend=f"{meant(name, list(effects))}; {OWN}")
    chosen = [facts(effect) for effect in (effects.values() if name is None else [effects[name]])]
    if as_json:
        document(heading("effects") | {"effects": chosen})
    elif name is None:
        _list(chosen)
    else:
        _explain(chosen[0], sketch(chosen[0]["signature"]))


def _list(effects: list[dict[str, Any]]) -> None:
    from pumaid.reporting.table import Table

    rows = []
    for effect in sorted(effects, key=lambda effect: not effect["base"]):
        name = f"{effect['effect']} (in all models)" if effect["base"] else effect["effect"]
        rows.append([name, effect["title"], effect["equation"], effect["family"], ", ".join(effect["look_alikes"])])
    caption = "s sign of motion, q position, v speed, t time, load: of gravity, drawn: the predicted current (A)"
    header = ("effect", "meaning", "current", "family", "look-alikes")
    tables(Table("", header, rows, caption=caption, words=(0, 1, 2, 3, 4)))


def _explain(effect: dict[str, Any], picture: str) -> None:
    from pumaid.reporting.effects import bounds, merged
    from pumaid.reporting.table import Table

    say(f"{effect['effect']}: {effect['title']}\n\n{effect['equation']}\n\n{effect['physics']}\n")
    for kind, title in (("parameter", f"parameters of {effect['owner']}:"), ("shape", "shape (searched, or given):")):
        rows = []
        for item in merged(effect[f"{kind}s"]):
            limits, example = bounds(item["low"], item["high"]), f"{item['example']:g}"
            rows.append([item["owner"], item["name"], item["unit"], limits, example, item["meaning"]])
        if rows:
            header = ("joint", kind, "unit", "bounds", "example", "meaning")
            tables(Table(title, header, rows, words=(0, 1, 2, 3, 5)))
            say()
    lines = [f"not at a {kind} joint: {reason}\n" for kind, reason in effect["not_at"].items()]
    lines += [f"signature ({effect['signature']['at']}):", picture, ""]
    lines += [f"look-alikes: {', '.join(effect['look_alikes'])}"] if effect["look_alikes"] else []
    lines += [f"residual depends on: {', '.join(effect['shown_by'])}"]
    lines += [f"best seen in: {effect['seen_in']}"] if effect["seen_in"] else []
    lines += [f"to add it: {effect['command'] or 'it is in all models'}", f"source: {effect['source']}"]
    say("\n".join(lines))
