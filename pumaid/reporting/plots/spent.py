"""What the motors' currents are spent on: the share of every effect, and what is left of each joint's current."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from pumaid.records import TOGETHER, UNEXPLAINED, JointScore
from pumaid.reporting.numbers import shortened
from pumaid.reporting.plots.style import GREY, INK, PALE, VERMILION, Drawing, effect_colour
from pumaid.reporting.story import Story
from pumaid.units import number

#: Where it stands among the figures of a report.
ORDER = 10

#: Share of a bar below which its figure would not fit inside.
FITS = 0.15

#: Width of the stripes of effects that cannot be told apart (points).
STRIPE = 3.5

_STRIPES = " Striped: effects that the fitted logs cannot tell apart; only their sum is known."

_WORDS = {"gravity": "gravity", "coulomb": "Coulomb friction", "viscous": "viscous friction", "inertia": "inertia"}


def drawings(story: Story) -> Iterator[Drawing]:
    """One figure for the whole arm."""
    if any(score.shares for score in story.comparison.joints):
        yield Drawing(
            "spent",
            f"What the motors' currents of {story.robot.name} are spent on",
            "Left: each joint's share of the mean square of its current, which is what heats the motor."
            " Right: what the model leaves (dot) against the noise floor (bar), below which no model can go."
            + _STRIPES
            * any(TOGETHER in name for score in story.comparison.joints for name in score.shares),
            lambda: _striped(story),
        )


def _striped(story: Story) -> Figure:
    with mpl.rc_context({"hatch.linewidth": STRIPE}):
        return draw(story)


def draw(story: Story) -> Figure:
    """The figure."""
    scores = [score for score in story.comparison.joints if score.shares]
    effects = [name for name in _ordered(scores) if name != UNEXPLAINED]
    others = [name for name in dict.fromkeys(_members(effects)) if name not in _WORDS]
    figure = Figure(figsize=(5.1, 0.42 * len(scores) + 1.95), layout="constrained")
    figure.suptitle(
        f"{shortened(story.robot.name)}\nWhat the motors' currents are spent on",
        x=0.01,
        ha="left",
        fontsize=11,
        fontweight="bold",
    )
    left, right = figure.subplots(1, 2, width_ratios=(2.35, 1.0), sharey=True)
    places = np.arange(len(scores))[::-1]
    for place, score in zip(places, scores, strict=True):
        _bar(left, float(place), score, looks={name: _look(name, others) for name in effects})
    _frame(left, story, scores, places)
    _left_over(right, scores, places)
    titles: list[Artist] = [Patch(linewidth=0, label=_short(name), **_look(name, others)) for name in effects]
    titles.append(Patch(color=VERMILION, label="unexplained"))
    titles.append(Line2D([], [], linestyle="", marker="o", markersize=6.5, color=VERMILION, label="RMSE"))
    if any(score.noise_floor is not None for score in scores):
        titles.append(Patch(color=GREY, alpha=0.45, label="noise floor"))
    columns = 2 if any(TOGETHER in name for name in effects) else 3
    figure.legend(handles=titles, loc="outside lower left", ncols=columns, handlelength=1.0, columnspacing=1.4)
    return figure


def _ordered(scores: list[JointScore]) -> list[str]:
    """Effects by their share in the whole arm, the paper's first."""
    total: dict[str, float] = {}
    for score in scores:
        for name, share in score.shares.items():
            total[name] = total.get(name, 0.0) + abs(share)
    base = list(_WORDS)
    known = [name for name in total if name.split(TOGETHER)[0] in base]
    known.sort(key=lambda name: (base.index(name.split(TOGETHER)[0]), name.count(TOGETHER)))
    return known + sorted((name for name in total if name not in known), key=lambda name: -total[name])


def _members(names: Sequence[str]) -> list[str]:
    """The effects behind shares, each of those that cannot be told apart by itself."""
    return [effect for name in names for effect in name.split(TOGETHER)]


def _word(share: str) -> str:
    """The name of a share for a legend or a sentence."""
    effects = share.split(TOGETHER)
    words = [_WORDS.get(effect) or effect.replace("_", " ") for effect in effects]
    if len(effects) == 1:
        return words[0]
    if set(effects) == {"coulomb", "viscous"}:
        return "friction (Coulomb and viscous not told apart)"
    return f"{', '.join(words[:-1])} and {words[-1]} (not told apart)"


def _short(share: str) -> str:
    """The name of a share for the legend."""
    effects = share.split(TOGETHER)
    return (
        _word(share) if len(effects) == 1 else " + ".join(_word(effect).removesuffix(" friction") for effect in effects)
    )


def _look(share: str, others: list[str]) -> dict[str, Any]:
    """Colour of a share; stripes in the colours of the first two effects that cannot be told apart."""
    colours = [effect_colour(effect, others) for effect in share.split(TOGETHER)]
    return {"facecolor": colours[0]} | ({"hatch": "//", "edgecolor": colours[1]} if len(colours) > 1 else {})


def _bar(axes: Axes, place: float, score: JointScore, *, looks: dict[str, dict[str, Any]]) -> None:
    ends = {True: 0.0, False: 0.0}
    for name, look in [*looks.items(), (UNEXPLAINED, {"facecolor": VERMILION})]:
        share = score.shares.get(name, 0.0)
        start, colour = ends[share >= 0.0], look["facecolor"]
        axes.barh(place, share, left=start, height=0.66, linewidth=0, **look)
        ends[share >= 0.0] += share
        if share >= FITS:
            axes.text(
                start + share / 2.0, place, f"{100 * share:.0f} %", ha="center", va="center", fontsize=9.5,
                fontweight="bold", color="#1b1e23" if colour in PALE else "white",
                bbox={"facecolor": colour, "linewidth": 0, "pad": 1.5} if "hatch" in look else None,
            )  # fmt: skip
    axes.text(ends[True] + 0.02, place, f"{number(score.rms or 0.0, 3)} A", va="center", fontsize=9.5)


def _frame(axes: Axes, story: Story, scores: list[JointScore], places: np.ndarray) -> None:
    lowest = min(0.0, *(sum(share for share in score.shares.values() if share < 0.0) for score in scores))
    axes.set_xlim(1.05 * lowest if lowest < -0.01 else 0.0, 1.29 - lowest)
    axes.set_yticks(
        places, [f"{score.joint}  {shortened(story.robot.joint(score.joint).name, 20)}" for score in scores]
    )
    axes.set_ylim(-0.6, len(scores) - 0.4)
    axes.xaxis.set_major_formatter(lambda share, _: f"{100 * share:.0f} %")
    axes.set_xticks([0.0, 0.5, 1.0])
    axes.spines["bottom"].set_bounds(0.0, 1.0)
    axes.set_title("spent on", fontsize=10, fontweight="normal")
    axes.text(1.02, 1.012, "RMS", transform=axes.get_xaxis_transform(), va="bottom", fontsize=9.5)
    axes.set_xlabel("share of mean square current", x=0.4)
    axes.tick_params(left=False)
    axes.spines["left"].set_visible(False)


def _left_over(axes: Axes, scores: list[JointScore], places: np.ndarray) -> None:
    """RMSE and noise floor as shares of the RMS current."""
    for place, score in zip(places, scores, strict=True):
        if score.noise_floor is not None:
            axes.barh(place, score.noise_floor, height=0.66, color=GREY, alpha=0.45, linewidth=0)
        if score.rmse is not None:
            axes.plot(score.rmse, place, "o", color=VERMILION, markersize=6.5, zorder=3)
            axes.annotate(
                f"{number(score.rmse, 2)}", (score.rmse, place), (7, 0), textcoords="offset points", va="center",
                color=INK, fontsize=9,
            )  # fmt: skip
    largest = max((max(score.rmse or 0.0, score.noise_floor or 0.0) for score in scores), default=1.0)
    axes.set_xlim(0.0, 1.65 * largest if largest > 0 else 1.0)
    axes.locator_params(axis="x", nbins=2)
    axes.xaxis.set_major_formatter(lambda current, _: f"{current:g}")
    axes.set_title("left over", fontsize=10, fontweight="normal")
    axes.set_xlabel("current (A)")
    axes.tick_params(left=False, labelleft=False)
    axes.spines["left"].set_visible(False)


def sentence(story: Story, score: JointScore) -> str:
    """What one joint's current is spent on, in words."""
    named = sorted(((s, n) for n, s in score.shares.items() if n != UNEXPLAINED and s > 0.005), reverse=True)
    spent = ", ".join(f"{_word(name)} {100.0 * share:.0f} %" for share, name in named)
    return f"{story.title(score.joint)} draws {number(score.rms or 0.0, 3)} A (RMS): {spent}."
