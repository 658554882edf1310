"""What the model leaves, against position, speed, load, time, posture, temperature: the shape says what is missing."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pumaid.records import TOGETHER, RunScore
from pumaid.reporting.numbers import shortened
from pumaid.reporting.plots.style import BACKWARD, FORWARD, GREY, INK, Drawing, dots, panels, way_handles
from pumaid.reporting.scores import posture_text
from pumaid.reporting.story import Story

Floats = NDArray[np.float64]

#: Where it stands among the figures of a report.
ORDER = 30

#: Bins over position, fine enough for a ripple of a dozen periods, and over time or temperature, which change slowly.
FINE, COARSE = 48, 14

#: Speeds that differ by less than this share, and temperatures by less than this (K), are one: nothing to see there.
ONE_SPEED, ONE_TEMPERATURE = 0.05, 0.5

#: A: a load that changes by less shows nothing.
ONE_LOAD = 1e-6

#: Labels of axes; that of postures has whole numbers.
POSTURE, LOAD, TIME, TEMPERATURE = "posture (number)", "gravity's current (A)", "time (min)", "temperature (°C)"


@dataclass(frozen=True, eq=False, slots=True)
class Left:
    """The residual of one direction of a joint (from 1).

    (M,) A at cells, with (M,) number of the run, position, speed (SI, absolute), time (s), posture (number of the group
    from 1), temperature (degC) and gravity's current by the model (A, NaN where it is not known by itself).
    """

    joint: int
    sign: int
    residual: Floats
    run: Floats
    position: Floats
    speed: Floats
    time: Floats
    posture: Floats
    temperature: Floats
    load: Floats


def drawings(story: Story) -> Iterator[Drawing]:
    """One figure for each joint that has runs."""
    for joint in story.moving():
        groups = story.postures(joint)
        letters = "; ".join(
            f"{number} = {posture_text(group[0].run, story.robot, story.units)}"
            for number, group in enumerate(groups[:4], start=1)
        )
        unit = story.position_unit(joint)
        yield Drawing(
            f"residual_j{joint}",
            f"{story.title(joint)}: what the model leaves",
            f"Postures ({unit}): {letters}.",
            partial(draw, story, joint),
            joint,
        )


def draw(story: Story, joint: int) -> Figure:
    """The figure of joint `joint` (from 1)."""
    both = sides(story, joint)
    chosen = _telling(story, both, joint)
    figure, all_axes = panels(len(chosen), height=1.28 if len(chosen) > 2 else 1.6, sharey=True)
    floor = story.comparison.joints[joint - 1].noise_floor
    for axes, (word, against) in zip(all_axes, chosen.items(), strict=True):
        axes.axhline(0.0, color=INK, linewidth=0.8, zorder=1)
        if floor is not None:
            axes.axhspan(-floor, floor, color=GREY, alpha=0.18, linewidth=0, zorder=0)
        axes.set_ylabel("left (A)")
        axes.set_xlabel(word, labelpad=1)
        for side in both:
            against(axes, side)
        if word == POSTURE:
            count = len(story.postures(joint))
            axes.set_xlim(0.5, count + 0.5)
            axes.set_xticks(range(1, count + 1, max(1, count // 10)))
    all_axes[0].set_title(shortened(story.title(joint), 40))
    limited(all_axes[0], both, floor)
    handles = way_handles((side.sign for side in both), backward="s", markersize=4.5)
    figure.legend(handles=handles, loc="outside lower center", ncols=2, handlelength=1.2)
    return figure


def _telling(story: Story, both: list[Left], joint: int) -> dict[str, Callable[[Axes, Left], None]]:
    """What the residual is drawn against, by the axis' label: only what differs between this joint's cells."""
    unit = story.position_unit(joint)
    out: dict[str, Callable[[Axes, Left], None]] = {
        f"position ({unit})": partial(against_position, story=story, joint=joint)
    }
    speeds = np.concatenate([side.speed for side in both])
    if np.ptp(speeds) > ONE_SPEED * speeds.max():
        out[f"speed ({unit}/s)"] = partial(against_speed, story=story, joint=joint)
    if has_load(both):
        out[LOAD] = against_load
    out[TIME] = against_time
    if len(story.postures(joint)) > 1:
        out[POSTURE] = lambda axes, side: _discrete(axes, side, side.posture + 0.06 * side.sign)
    if has_temperature(both):
        out[TEMPERATURE] = against_temperature
    return out


def has_load(both: list[Left]) -> bool:
    """Whether gravity draws a current that is known by itself, and not always the same."""
    return _varies([side.load for side in both], ONE_LOAD)


def has_temperature(both: list[Left]) -> bool:
    """Whether temperatures were measured and differ."""
    return _varies([side.temperature for side in both], ONE_TEMPERATURE)


def _varies(pieces: list[Floats], least: float) -> bool:
    values = np.concatenate(pieces) if pieces else np.zeros(0)
    seen = values[np.isfinite(values)]
    return bool(len(seen)) and float(np.ptp(seen)) > least


def sides(story: Story, joint: int) -> list[Left]:
    """The residual of joint `joint` (from 1), forward and backward, as far as it was run."""
    return [side for side in (_left(story, joint, sign) for sign in (1, -1)) if len(side.residual)]


def against_position(axes: Axes, side: Left, story: Story, *, joint: int) -> None:
    """Cells, and their means in bins of position."""
    _continuous(axes, side, story.shown(joint, side.position), bins=FINE)


def against_speed(axes: Axes, side: Left, story: Story, *, joint: int) -> None:
    """Cells, and their means by speed; directions a hair apart, so that neither hides the other."""
    speed = story.shown(joint, side.speed)
    _discrete(axes, side, speed * (1.0 + 0.006 * side.sign))
    axes.update_datalim([(0.92 * speed.min(), 0.0), (1.08 * speed.max(), 0.0)])
    axes.autoscale_view(scaley=False)


def against_load(axes: Axes, side: Left) -> None:
    """Cells, and their means in bins of what gravity draws."""
    _continuous(axes, side, side.load)


def against_time(axes: Axes, side: Left) -> None:
    """Cells, and their means in bins of time."""
    _continuous(axes, side, side.time / 60.0)


def against_temperature(axes: Axes, side: Left) -> None:
    """Cells, and their means in bins of temperature."""
    _continuous(axes, side, side.temperature)


def _left(story: Story, joint: int, sign: int) -> Left:
    """Cells of all runs of a joint in one direction."""
    groups = story.postures(joint)
    chosen = [(n, score) for n, group in enumerate(groups, start=1) for score in group if score.run.direction == sign]
    scores = [score for _, score in chosen]

    def joined(pieces: list[Floats]) -> Floats:
        return np.concatenate(pieces) if pieces else np.zeros(0)

    def constant(values: list[float]) -> Floats:
        return joined([np.full(len(s.predicted), v) for s, v in zip(scores, values, strict=True)])

    starts = _clock(story)
    return Left(
        joint=joint,
        sign=sign,
        residual=joined([score.residual for score in scores]),
        run=constant([float(n) for n in range(len(scores))]),
        position=joined([score.run.bins.position[:, joint - 1] for score in scores]),
        speed=constant([abs(score.run.speed) for score in scores]),
        time=joined([score.run.bins.time + starts[score.run.clock] for score in scores]),
        posture=constant([float(n) for n, _ in chosen]),
        temperature=joined([score.run.bins.temperature for score in scores]),
        load=joined([_load(score) for score in scores]),
    )


def _load(score: RunScore) -> Floats:
    """(M,) A that gravity draws; NaN where only a sum with it is known, 0 where the joint carries no weight."""
    merged = any("gravity" in name.split(TOGETHER) and name != "gravity" for name in score.parts)
    nothing = np.full(len(score.predicted), np.nan if merged else 0.0)
    return score.parts.get("gravity", nothing)


def _clock(story: Story) -> dict[int, float]:
    """What is added to the time of each recording so that they follow one another (s)."""
    spans: dict[int, tuple[float, float]] = {}
    for score in story.comparison.runs:
        first, last = score.run.start, score.run.start + score.run.duration
        low, high = spans.get(score.run.clock, (first, last))
        spans[score.run.clock] = (min(low, first), max(high, last))
    added, so_far = {}, 0.0
    for clock in sorted(spans):
        added[clock] = so_far - spans[clock][0]
        so_far += spans[clock][1] - spans[clock][0]
    return added


def _continuous(axes: Axes, side: Left, x: Floats, *, bins: int = COARSE) -> None:
    seen = np.isfinite(x)
    if not seen.any():
        return
    low, high = float(x[seen].min()), float(x[seen].max())
    edges = np.linspace(low, high if high > low else low + 1.0, bins + 1)
    label = np.clip(np.digitize(x, edges) - 1, 0, bins - 1).astype(float)
    label[~seen] = np.nan
    _drawn(axes, side, x, label=label, joined=bins == FINE)


def _discrete(axes: Axes, side: Left, x: Floats) -> None:
    """Speeds (or postures) that differ by less than 3 % of the largest are one mark."""
    order = np.unique(x)
    width = 0.03 * max(float(np.abs(order).max(initial=0.0)), 1e-12)
    starts = np.concatenate([[True], np.diff(order) > width]) if len(order) else np.zeros(0, dtype=bool)
    label = np.cumsum(starts)[np.searchsorted(order, x)].astype(float)
    _drawn(axes, side, x, label=label)


def _drawn(axes: Axes, side: Left, x: Floats, *, label: Floats, joined: bool = False) -> None:
    colour, mark = (FORWARD, "o") if side.sign > 0 else (BACKWARD, "s")
    dots(axes, x, side.residual, colour=colour, size=1.6, alpha=0.28)
    places, means, errors = [], [], []
    for number in np.unique(label[np.isfinite(label)]):
        inside = label == number
        by_run = np.array([side.residual[inside & (side.run == run)].mean() for run in np.unique(side.run[inside])])
        places.append(float(x[inside].mean()))
        means.append(float(by_run.mean()))
        errors.append(float(by_run.std(ddof=1) / np.sqrt(len(by_run))) if len(by_run) > 1 else np.nan)
    axes.errorbar(
        places, means, yerr=errors, fmt=f"{mark}-" if joined else mark, linewidth=0.8, color=colour,
        markersize=2.4 if joined else 4.2, elinewidth=1.1, capsize=0, zorder=4, markeredgecolor="none",
    )  # fmt: skip


def limited(axes: Axes, both: list[Left], floor: float | None) -> None:
    """The same scale above and below zero, with room for all but the farthest hundredth."""
    everything = np.abs(np.concatenate([side.residual for side in both])) if both else np.zeros(1)
    top = 1.3 * max(float(np.quantile(everything, 0.99)), 1.2 * (floor or 0.0), 1e-9)
    axes.set_ylim(-top, top)
