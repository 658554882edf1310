"""What the motors' currents are spent on: the share of every effect, and what is left of each joint's current."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from pumaid.effects import catalogue
from pumaid.records import UNEXPLAINED, JointScore
from pumaid.show.numbers import shortened
from pumaid.show.plots.style import GREY, INK, PALE, VERMILION, Drawing, effect_colour
from pumaid.show.story import Story
from pumaid.units import number

#: Where it stands among the figures of a report.
ORDER = 10

#: Share of a bar below which its figure would not fit inside.
FITS = 0.15

_WORDS = {"gravity": "gravity", "coulomb": "Coulomb friction", "viscous": "viscous friction", "inertia": "inertia"}


def drawings(story: Story) -> Iterator[Drawing]:
    """One figure for the whole arm."""
    if any(score.shares for score in story.comparison.joints):
        yield Drawing(
            "spent",
            f"What the motors' currents of {story.robot.name} are spent on",
            "Left: each joint's share of the mean square of its current, which is what heats the motor."
            " Right: what the model leaves (dot) against the noise floor (bar), below which no model can go.",
            lambda: draw(story),
        )


def draw(story: Story) -> Figure:
    """The figure."""
    scores = [score for score in story.comparison.joints if score.shares]
    effects = [name for name in _ordered(scores) if name != UNEXPLAINED]
    others = [name for name in effects if name not in _WORDS]
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
        _bar(left, float(place), score, colours={name: effect_colour(name, others) for name in effects})
    _frame(left, story, scores, places)
    _left_over(right, scores, places)
    titles: list[Artist] = [Patch(color=effect_colour(name, others), label=_word(name)) for name in effects]
    titles.append(Patch(color=VERMILION, label="unexplained"))
    titles.append(Line2D([], [], linestyle="", marker="o", markersize=6.5, color=VERMILION, label="RMSE"))
    titles.append(Patch(color=GREY, alpha=0.45, label="noise floor"))
    figure.legend(handles=titles, loc="outside lower left", ncols=3, handlelength=1.0, columnspacing=1.4)
    return figure


def _ordered(scores: list[JointScore]) -> list[str]:
    """Effects by their share in the whole arm, the paper's first."""
    total: dict[str, float] = {}
    for score in scores:
        for name, share in score.shares.items():
            total[name] = total.get(name, 0.0) + abs(share)
    known = [name for name in _WORDS if name in total]
    return known + sorted((name for name in total if name not in known), key=lambda name: -total[name])


def _word(effect: str) -> str:
    found = catalogue().get(effect)
    return _WORDS.get(effect) or (effect.replace("_", " ") if found is not None else effect)


def _bar(axes: Axes, place: float, score: JointScore, *, colours: dict[str, str]) -> None:
    ends = {True: 0.0, False: 0.0}
    for name, colour in [*colours.items(), (UNEXPLAINED, VERMILION)]:
        share = score.shares.get(name, 0.0)
        start = ends[share >= 0.0]
        axes.barh(place, share, left=start, height=0.66, color=colour, linewidth=0)
        ends[share >= 0.0] += share
        if share >= FITS:
            axes.text(
                start + share / 2.0, place, f"{100 * share:.0f} %", ha="center", va="center", fontsize=9.5,
                fontweight="bold", color="#1b1e23" if colour in PALE else "white",
            )  # fmt: skip
    axes.text(ends[True] + 0.02, place, f"{number(score.rms or 0.0, 3)} A", va="center", fontsize=9.5)


def _frame(axes: Axes, story: Story, scores: list[JointScore], places: np.ndarray) -> None:
    lowest = min(0.0, *(sum(share for share in score.shares.values() if share < 0.0) for score in scores))
    axes.set_xlim(1.05 * lowest if lowest < -0.01 else 0.0, 1.29 - lowest)
    axes.set_yticks(places, [f"{score.joint}  {story.robot.joint(score.joint).name}" for score in scores])
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
