"""``pumaid effects``: the catalogue of physics."""

from __future__ import annotations

import difflib
import inspect
from typing import Any

import rich_click as click

from pumaid.cli.options import json_option
from pumaid.cli.output import document, say, table


@click.command()
@click.argument("name", required=False)
@json_option
def command(name: str | None, as_json: bool) -> None:
    """The physics that pumaid knows: all effects, or one explained.

    \b
    Example:
      pumaid effects
      pumaid effects coulomb
      pumaid effects --json | jq '.effects[].effect'
    """
    from pumaid.effects import catalogue
    from pumaid.errors import ModelError
    from pumaid.files.result import heading

    known = catalogue()
    if name is not None and name not in known:
        near = difflib.get_close_matches(name, known, n=1)
        mend = f"did you mean '{near[0]}'?" if near else f"effects are {', '.join(known)}"
        raise ModelError("unknown-effect", f"there is no effect '{name}'", mend=mend)
    chosen = list(known.values()) if name is None else [known[name]]
    if as_json:
        document(heading("effects") | {"effects": [_facts(effect) for effect in chosen]})
    elif name is None:
        _list(chosen)
    else:
        _explain(_facts(chosen[0]))


def _facts(effect: Any) -> dict[str, Any]:
    """What is known of `effect`; its parameters as a revolute (rad) and a prismatic (m) joint or link own them."""
    from pumaid.records import Joint, Robot

    arm = Robot("any arm", (Joint(1, "revolute", "revolute"), Joint(2, "prismatic", "prismatic")))
    parameters = [
        {"joint": joint.kind, "name": found.name, "unit": found.unit.format(unit=joint.position_unit)}
        | {"symbol": found.symbol.format(n="N"), "meaning": found.meaning, "example": found.example}
        for joint in arm.joints
        for found in effect.parameters(arm, joint.number)
    ]
    return {
        "effect": effect.name,
        "title": effect.title,
        "base": effect.base,
        "scope": effect.scope.value,
        "shown_by": [trace.value for trace in effect.trace],
        "physics": inspect.cleandoc(type(effect).__doc__ or ""),
        "parameters": parameters,
        "source": effect.source,
    }


def _list(chosen: list[Any]) -> None:
    from rich.table import Table

    rows = Table("effect", "what it is", "in every model", "shown by", box=None, pad_edge=False)
    for effect in chosen:
        traces = ", ".join(trace.value for trace in effect.trace)
        rows.add_row(effect.name, effect.title, "yes" if effect.base else "no", traces)
    table(rows)


def _explain(facts: dict[str, Any]) -> None:
    from rich.table import Table

    owner = {"joint": "each joint", "link": "each link", "arm": "the whole arm"}[facts["scope"]]
    say(f"{facts['effect']}: {facts['title']}\n\n{facts['physics']}\n")
    say(f"parameters of {owner}:")
    rows = Table("joint", "parameter", "symbol", "unit", "meaning", box=None, pad_edge=False)
    for one in facts["parameters"]:
        rows.add_row(one["joint"], one["name"], one["symbol"], one["unit"], one["meaning"])
    table(rows)
    say(f"\nshown by: {', '.join(facts['shown_by'])} (what the residual depends on where the effect is missing)")
    say(f"source: {facts['source']}")
