"""The tables of a run of the blind benchmark, as Markdown."""

from __future__ import annotations

from blind_world import tables
from blind_world.case import OUTSIDE_SIZES, PAIR_SIZE, THIN_SIZE
from blind_world.statistics import Record


def page(records: list[Record]) -> str:
    """All tables.

    Parameters
    ----------
    records
        Of a file of results.
    """
    seeds = sorted({record["seed"] for record in records})
    run = [record for record in records if record["outcome"] != "skipped"]
    crashed = [record["key"] for record in records if record["outcome"] == "crashed"]
    checked = [record["same_on_command_line"] for record in records if "same_on_command_line" in record]
    sections = [
        ("Goals", tables.goals(records)),
        ("All effects by size", tables.by_size(records)),
        ("Effect by effect: first / in the set / wrong / missed", tables.by_effect(records)),
        ("Arm by arm", tables.by_arm(records)),
        ("The error ladder on unseen runs", tables.ladder(records)),
        ("Nothing hidden", tables.clean(records)),
        (
            f"Outside the catalogue, at {' and '.join(f'{s:g}' for s in OUTSIDE_SIZES)} x the limit",
            tables.outside(records),
        ),
        (f"Two at once, each at {PAIR_SIZE:g} x its limit", tables.pairs(records)),
        (f"Thin design, at {THIN_SIZE:g} x its limit", tables.thin(records)),
        ("Not to be seen at a physical size", tables.skipped(records)),
        ("Time", tables.spent(records)),
    ]
    told = f": {', '.join(crashed)}" if crashed else ""
    about = (
        f"{len(run)} experiments, seeds {', '.join(map(str, seeds))}; {len(crashed)} ended in an error{told}."
        f" {len(checked)} also went through the command line, {sum(checked)} of them with the same findings."
    )
    body = "\n\n".join(f"## {title}\n\n{text}" for title, text in sections)
    return f"{about}\n\n{body}\n"
