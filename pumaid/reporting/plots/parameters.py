"""The parameters with their intervals, and how well each is known."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pumaid.records import Value
from pumaid.reporting.numbers import in_unit
from pumaid.reporting.plots.style import BACKWARD, FAINT, FORWARD, GREY, INK, Drawing, panels
from pumaid.reporting.story import Story
from pumaid.reporting.tables import is_absent, place_of, row_label, row_of

#: Where it stands among the figures of a report.
ORDER = 40

#: A parameter whose 95 % interval is wider than its value has no sure sign.
UNSURE = 1.0

#: Marks whose shares differ by less than this factor touch.
TOUCHING = 1.25

#: Panels: title, rows of the table that stand in it.
_PANELS = (
    ("weight: k·g, m·g (A)", (("gravity", "x"), ("gravity", "y"), ("gravity", "mass"))),
    ("Coulomb friction (A)", (("coulomb", "plus"), ("coulomb", "minus"))),
    ("viscous friction ({unit})", (("viscous", "plus"), ("viscous", "minus"))),
    ("ratio of gains ηᵢ/ηᵢ₊₁", (("gain_ratio", ""),)),
)
_LOOKS = ((FORWARD, "o"), (BACKWARD, "s"), (GREY, "D"))


def drawings(story: Story) -> Iterator[Drawing]:
    """The values, and their relative precision."""
    if not any(value.value is not None for value in story.estimate.values):
        return
    yield Drawing(
        "parameters",
        f"Parameters of {story.robot.name} with their 95 % intervals",
        "Blue circles: x and forward terms; orange squares: y and backward terms. Where no bar is seen, the interval is"
        " narrower than the mark. n/i: not identifiable from these data.",
        lambda: values(story),
    )
    if any(value.ci95 is not None for value in story.estimate.values):
        yield Drawing(
            "precision",
            "How well each parameter is known",
            "Half the 95 % interval as a share of the value (logarithmic): the further left, the better known."
            " Beyond 100 % not even the sign is sure.",
            lambda: precision(story),
        )


def values(story: Story) -> Figure:
    """Values by link, with intervals."""
    known = {row_of(value) for value in story.estimate.values if value.value is not None}
    chosen = [(title, keys) for title, keys in _PANELS if known & set(keys)]
    figure, all_axes = panels(len(chosen), height=1.45, sharex=True)
    weight = float(np.linalg.norm(story.robot.gravity))
    for axes, (title, keys) in zip(all_axes, chosen, strict=True):
        axes.axhline(0.0, color=INK, linewidth=0.7)
        units = dict.fromkeys(in_unit(v.unit, story.units)[1] for v in story.estimate.values if row_of(v) in keys)
        axes.set_title(title.format(unit=" | ".join(units)), fontsize=9.5, fontweight="normal")
        shown = [value for value in story.estimate.values if row_of(value) in keys]
        for value in shown:
            _point(axes, value, keys.index(row_of(value)), weight=weight, units=story.units)
        _unknown(axes, shown)
        axes.margins(y=0.18)
        axes.grid(axis="y")
    joints = range(1, story.robot.n_joints + 1)
    all_axes[-1].set_xticks(list(joints))
    all_axes[-1].set_xlim(0.5, story.robot.n_joints + 0.5)
    all_axes[-1].set_xlabel("link")
    return figure


def _point(axes: Axes, value: Value, look: int, *, weight: float, units: str) -> None:
    colour, mark = _LOOKS[min(look, 2)]
    place = (value.joint or 0) + (-0.12, 0.12, 0.0)[min(look, 2)]
    if value.value is None or value.ci95 is None:
        return
    times = in_unit(value.unit, units)[0] * (weight or 1.0 if row_of(value)[0] == "gravity" else 1.0)
    middle, low, high = (times * number for number in (value.value, *value.ci95))
    axes.errorbar(
        place, middle, yerr=[[middle - low], [high - middle]], fmt=mark, color=colour, markersize=4.5, elinewidth=1.4,
        capsize=2.5, markeredgecolor="none", zorder=3,
    )  # fmt: skip


def _unknown(axes: Axes, shown: list[Value]) -> None:
    """``n/i`` where a link has nothing to show in this panel although it could have."""
    told = {value.joint for value in shown if value.value is not None}
    for joint in {value.joint for value in shown if not is_absent(value)} - told:
        axes.annotate("n/i", (joint or 0, 0.0), (0, 3), textcoords="offset points", ha="center", fontsize=8.5)


def precision(story: Story) -> Figure:
    """Relative half width of every interval, a line a row of the table, a number a joint."""
    known = [value for value in story.estimate.values if value.ci95 is not None and value.value]
    rows = sorted(dict.fromkeys(row_of(value) for value in known), key=place_of)
    figure = Figure(figsize=(4.6, 0.42 * len(rows) + 1.1), layout="constrained")
    axes = figure.subplots()
    shares = {value.name: _share(value) for value in known}
    top = max(2.0, *(1.6 * share for share in shares.values())) if shares else 2.0
    for place, row in enumerate(rows):
        axes.axhline(place, color=FAINT, linewidth=0.6, zorder=0)
        for value, lift in _apart([value for value in known if row_of(value) == row], shares):
            unsure = shares[value.name] > UNSURE
            colour = BACKWARD if unsure else FORWARD
            _ball(axes, shares[value.name], place + lift, str(value.joint or ""), colour=colour)
    axes.axvline(UNSURE, color=INK, linewidth=0.8, linestyle=(0, (4, 3)))
    axes.set_xscale("log")
    axes.set_xlim(min([0.02, *(0.6 * share for share in shares.values() if share > 0)]), top)
    axes.xaxis.set_major_formatter(lambda share, _: f"{100 * share:g} %")
    axes.set_yticks(range(len(rows)), [row_label(row) for row in rows])
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_xlabel("half of the 95 % interval, share of the value")
    axes.set_title("How well each parameter is known")
    axes.tick_params(left=False)
    axes.spines["left"].set_visible(False)
    handles = [Line2D([], [], linestyle="", marker="o", color=c, label=t) for c, t in _SURE]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, handletextpad=0.2)
    return figure


def _apart(values: list[Value], shares: dict[str, float]) -> list[tuple[Value, float]]:
    """Marks that would cover each other are lifted and lowered in turn."""
    out: list[tuple[Value, float]] = []
    before, lift = 0.0, 0.0
    for value in sorted(values, key=lambda item: shares[item.name]):
        share = shares[value.name]
        lift = (-0.24 if lift >= 0.0 else 0.24) if share < TOUCHING * before else 0.0
        out.append((value, lift))
        before = share
    return out


_SURE = ((FORWARD, "sign sure (number: joint)"), (BACKWARD, "sign unsure"))


def _share(value: Value) -> float:
    assert value.ci95 is not None and value.value is not None
    return max(0.5 * (value.ci95[1] - value.ci95[0]) / abs(value.value), 1e-12)


def _ball(axes: Axes, x: float, y: float, text: str, *, colour: str) -> None:
    axes.plot(x, y, "o", color=colour, markersize=10.5, alpha=0.95, markeredgecolor="none")
    axes.annotate(text, (x, y), ha="center", va="center_baseline", fontsize=8, color="white", fontweight="bold")
