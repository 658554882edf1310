"""The model and its errors: shares, parameters, history, currents, residuals, and what findings explain."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from pumaid.dataset import BLOCK, Dataset
from pumaid.diagnosis.records import Binned, Curve, Diagnosis, Finding, Unexplained
from pumaid.effect_spec import EffectTerm, terms_of
from pumaid.effects.curve import NAMES, course, spoken_form
from pumaid.estimate import Estimate
from pumaid.estimation.evaluate import TOGETHER, UNEXPLAINED, Comparison, JointScore, RunScore
from pumaid.joint_bins import SAME_POSTURE
from pumaid.maths import Floats
from pumaid.reporting.diagnosis import VARIABLES, form_sentence, label, place
from pumaid.reporting.figures.style import (
    AREAS,
    BACKWARD,
    COLOURS,
    DARK_INK,
    FORWARD,
    GREY,
    INK,
    MOST_POINTS,
    PALE,
    ROOM,
    Drawing,
    clock_shifts,
    direction_handles,
    dots,
    error_marks,
    legend,
    panels,
    styled,
    zero_line,
)
from pumaid.reporting.text import (
    amperes,
    changes,
    in_unit,
    joint_title,
    listed,
    posture_text,
    shortened,
)
from pumaid.results.history import Ladder
from pumaid.robot import Robot, posture_groups

#: Effect -> colour of its share; other effects take the rest of the palette in turn.
EFFECT_COLOURS = dict(zip(("gravity", "coulomb", "viscous", "inertia"), AREAS, strict=False))
EFFECT_NAMES = {"coulomb": "Coulomb friction", "viscous": "viscous friction"}

#: inch of the width of a history; characters that labels of models have for each inch.
HISTORY_WIDTH, LETTERS = 5.4, 9.2

#: Postures of a joint in a figure of currents; bins over position (fine enough for a ripple) and other variables.
MOST_POSTURES, FINE, COARSE = 3, 48, 14

#: A variable is drawn if it varies by more than this: speed (share of the largest), A, posture, K; others always.
LEAST = {"speed": 0.05, "gravity": 1e-6, "posture": 0.5, "temperature": 0.5}

#: Line styles of an effect and of its rivals, in turn.
DASHES: tuple[Any, ...] = ("-", (0, (4, 2)), (0, (1.2, 1.4)), (0, (6, 2, 1.2, 2)), (0, (8, 3)), (0, (3, 1, 1, 1, 1, 1)))

#: s above which times are in minutes; range of a residual in multiples of its largest mark; findings in one figure, and
#: inch of a panel of several.
MINUTES, RANGE, MOST_COLUMNS, NARROW = 300.0, 1.6, 6, 3.6
#: Points of a learned curve.
POINTS = 200


#: Title, effect, curve and label of what is drawn of a finding, or of a residual without a name (no effect).
Column = tuple[str, str, Curve, str]
CURRENT = "residual (A)"


@dataclass(frozen=True, eq=False, slots=True)
class ReportContext:
    """Inputs of figures and sections; `ladder`: the models of the experiment that can be compared with this one.

    `units` is ``"rad"`` or ``"deg"``, the unit of angles; `stale` are sentences on why the diagnosis may not apply to
    this model and these logs.
    """

    robot: Robot
    estimate: Estimate
    dataset: Dataset
    comparison: Comparison
    units: str = "rad"
    diagnosis: Diagnosis | None = None
    stale: tuple[str, ...] = ()
    ladder: Ladder | None = None

    def moving(self) -> list[int]:
        """Joints (from 1) that have runs."""
        return sorted({score.run.joint for score in self.comparison.runs})

    def unit(self, joint: int) -> tuple[float, str]:
        """Factor and name of the unit in which positions of a joint (SI) are shown: ``rad``, ``deg`` or ``m``."""
        return in_unit(self.robot.joint(joint).position_unit, self.units)

    def postures(self, joint: int) -> list[list[RunScore]]:
        """Runs of a joint by the positions of the other joints, the largest group first; blocks are one group."""
        scores = self.comparison.of_joint(joint)
        blocks = [score for score in scores if score.run.kind == BLOCK]
        steady = [score for score in scores if score.run.kind != BLOCK]
        held = np.array([score.run.posture for score in steady])
        groups = [[steady[number] for number in group] for group in posture_groups(held, SAME_POSTURE)]
        return sorted([*groups, blocks] if blocks else groups, key=lambda group: -len(group))


# The model


@styled()
def share_figure(context: ReportContext) -> Drawing:
    """Where each joint's current goes: one bar a joint, with the RMS current beside it."""
    scores = [score for score in context.comparison.joints if score.shares]
    total = {
        name: sum(abs(score.shares.get(name, 0.0)) for score in scores)
        for name in dict.fromkeys(name for score in scores for name in score.shares if name != UNEXPLAINED)
    }
    order, palette = list(EFFECT_COLOURS), cycle(AREAS[4:])  # the paper's effects first, then those of largest share
    names = sorted(total, key=lambda name: (order.index(name) if name in order else len(order), -total[name]))
    colours = {name: EFFECT_COLOURS.get(name) or next(palette) for name in names} | {UNEXPLAINED: BACKWARD}
    figure = Figure(figsize=(5.1, 0.42 * len(scores) + 1.75), layout="constrained")
    axes = figure.subplots()
    _share_bars(axes, scores, colours)
    axes.set_yticks(
        range(len(scores)), [f"{x.joint}  {shortened(context.robot.joint(x.joint).name, 20)}" for x in scores]
    )
    words = {
        name: [EFFECT_NAMES.get(effect, effect.replace("_", " ")) for effect in name.split(TOGETHER)]
        for name in colours
    }
    is_merged = any(TOGETHER in name for name in names)
    handles = [Patch(color=colour, label=" + ".join(words[name])) for name, colour in colours.items()]
    title = f"{shortened(context.robot.name)}\nWhat the motor currents are spent on"
    legend(figure, handles, 1 if is_merged else 3, title=title)
    caption = "Shares of the mean square of each joint's current, which heats the motor; right: RMS current."
    caption += " The fitted logs do not separate effects that share a colour." if is_merged else ""
    return Drawing("spent", f"{context.robot.name}: what the motor currents are spent on", caption, figure)


def _share_bars(axes: Axes, scores: Sequence[JointScore], colours: dict[str, str]) -> None:
    """A bar for each joint: the shares of effects, negative ones below zero, and the RMS current at its end."""
    shares = np.array([[score.shares.get(name, 0.0) for name in colours] for score in scores])
    above, below = shares.clip(min=0.0), shares.clip(max=0.0)
    starts = np.where(shares < 0.0, below.cumsum(axis=1) - below, above.cumsum(axis=1) - above)
    for part, start, colour in zip(shares.T, starts.T, colours.values(), strict=True):
        bars = axes.barh(range(len(scores)), part, left=start, height=0.68, color=colour, linewidth=0)
        texts = [f"{100.0 * share:.0f} %" if share >= ROOM else "" for share in part]
        axes.bar_label(
            bars, texts, label_type="center", color=DARK_INK if colour in PALE else "white", fontweight="bold"
        )
    for row, (score, end) in enumerate(zip(scores, above.sum(axis=1), strict=True)):
        axes.text(end + 0.02, row, amperes(score.rms), va="center", fontsize=9.5)
    lowest = float(below.sum(axis=1).min())
    axes.set(ylim=(len(scores) - 0.4, -0.6), xlim=(1.05 * lowest if lowest < -0.01 else 0.0, 1.2 - lowest))
    axes.set_xticks([0.0, 0.5, 1.0], ["0 %", "50 %", "100 %"])
    axes.spines["bottom"].set_bounds(0.0, 1.0)
    axes.set_xlabel("share of mean square current", x=0.4)
    axes.tick_params(axis="y", left=False)
    axes.spines["left"].set_visible(False)


@styled()
def history_figure(ladder: Ladder) -> Drawing:
    """The whole arm's error of each model, from the first to the current one, as steps."""
    path = ladder.path
    figure = Figure(figsize=(HISTORY_WIDTH, 3.6), layout="constrained")
    axes, edges = figure.subplots(), np.arange(len(path) + 1)
    values = np.array([list(rung.whole.values()) for rung in path], dtype=float).T
    fitted, heldout, floor = np.column_stack([values, values[:, -1]])
    axes.step(edges, fitted, where="post", color=FORWARD, linewidth=2.4, label="fitted runs")
    if np.isfinite(heldout).any():
        axes.step(edges, heldout, "--", where="post", color=BACKWARD, linewidth=2.4, label="held-out runs")
    if np.isfinite(floor).any():
        axes.fill_between(
            edges, 0.0, floor, step="post", label="noise floor", color=GREY, alpha=0.28, linewidth=0, zorder=0
        )
    axes.set(ylim=(0.0, 1.18 * np.nanmax(values, initial=0.0) or 1.0), xlim=(0, len(path)), ylabel="RMSE (A)")
    labels, room = [], int(LETTERS * HISTORY_WIDTH / len(path))
    for rung in path:
        texts = [word.replace("_", " ").replace("@", " @") for word in changes(rung)] if room >= 8 else []
        labels.append("\n".join([str(rung.number), *(textwrap.fill(text, room) for text in texts)]))
    axes.set_xticks(edges[:-1] + 0.5, labels)
    axes.set_title(f"{shortened(ladder.robot)}: error of each model", pad=10)
    legend(figure, axes.get_legend_handles_labels()[0])
    return Drawing(
        "ladder",
        f"{ladder.robot}: error of each model",
        "One step a model, labelled by what it adds. Grey: noise floor, from the differences of repeated runs.",
        figure,
    )


# Currents


@styled()
def current_figure(context: ReportContext, joint: int) -> Drawing:
    """Measured and predicted current of a joint, as in the paper's Fig. 4: one panel a posture.

    Of a joint with blocks of any motion only, one panel a block, against time.
    """
    groups = context.postures(joint)
    steady = [group for group in groups if group[0].run.kind != BLOCK]
    shown = (steady or [[score] for score in groups[0]])[:MOST_POSTURES]
    figure, grid = panels(len(shown), height=2.35 if len(shown) == 1 else 1.85, sharex=True, sharey=True)
    names = " | ".join(dict.fromkeys(context.unit(other.number)[1] for other in context.robot.joints))
    for axes, group in zip(grid.flat, shown, strict=True):
        _course(axes, context, group)
        run = group[0].run
        posture = f"other joints at {posture_text(context.robot, run.posture.tolist(), context.units)} {names}"
        words = posture if steady else f"block from {run.start:.1f} s"
        axes.text(0.0, 1.02, words, transform=axes.transAxes, fontsize=8.5)
        axes.grid(axis="y")
        axes.label_outer()
    grid[0, 0].set_title(shortened(joint_title(context.robot, joint), 40), pad=18)
    legend(
        figure,
        [
            *direction_handles([score.run.direction for group in shown for score in group] if steady else [1, -1]),
            Line2D([], [], color=INK, linewidth=1.1, label="predicted"),
        ],
    )
    rest = f" The {MOST_POSTURES} of {len(steady)} postures with most runs." if len(steady) > MOST_POSTURES else ""
    caption = f"Dots: measured. Lines: predicted, one a run.{rest}"
    return Drawing(f"current_j{joint}", f"{joint_title(context.robot, joint)}: current", caption, figure)


def _course(axes: Axes, context: ReportContext, group: Sequence[RunScore]) -> None:
    """Measured (dots) and predicted (lines) current of runs in one posture, or of blocks against time."""
    joint, is_free = group[0].run.joint, group[0].run.kind == BLOCK
    scale, unit = context.unit(joint)
    axes.set(xlabel="time (s)" if is_free else f"position ({unit})", ylabel="current (A)")
    for score in group:
        run, bins = score.run, score.run.bins
        x = bins.time - run.start if is_free else scale * bins.position[:, joint - 1]
        ways = np.sign(bins.velocity) if is_free else np.full(len(x), run.direction)
        order = np.argsort(x)
        steps = np.diff(x[order], prepend=x[order][:1])
        is_pause = is_free & (steps > 1.5 * np.median(steps))
        axes.plot(x[order], np.where(is_pause, np.nan, score.predicted[order]), color=INK, linewidth=0.7, zorder=1.5)
        for sign in (1, -1):
            dots(
                axes,
                x[ways == sign],
                bins.current[ways == sign],
                alpha=0.7,
                colour=COLOURS[sign],
                size=2.6,
                limit=-(-2 * MOST_POINTS // len(group)),
            )


# Residuals


@styled()
def residual_figure(context: ReportContext, joint: int) -> Drawing:
    """The residual of a joint against position, speed, load, time, posture and temperature, as far as they vary."""
    bins, floor = joint_residuals(context, joint), context.comparison.joints[joint - 1].noise_floor
    names = varying(bins)
    figure, grid = panels(len(names), height=1.28 if len(names) > 2 else 1.6)
    for axes, name in zip(grid.flat, names, strict=True):
        _binned(axes, bins, name, floor)
    title = joint_title(context.robot, joint)
    grid[0, 0].set_title(f"{shortened(title, 32)}: residual")
    band = [] if floor is None else [Patch(color=GREY, alpha=0.4, label="noise floor")]
    legend(figure, [*direction_handles(bins["direction"]), *band])
    postures = [group[0].run.posture.tolist() for group in context.postures(joint)[:4]]
    texts = [f"{k} = {posture_text(context.robot, p, context.units)}" for k, p in enumerate(postures, start=1)]
    caption = f"Postures ({context.unit(joint)[1]}): {'; '.join(texts)}."
    return Drawing(f"residual_j{joint}", f"{title}: residual", caption, figure)


def joint_residuals(context: ReportContext, joint: int) -> pd.DataFrame:
    """The bins of a joint's runs: direction, run and residual (A), then what it may depend on, in units of the axes."""
    (scale, unit), shifts = context.unit(joint), clock_shifts([score.run for score in context.comparison.runs])
    parts: list[pd.DataFrame] = []
    for posture, group in enumerate(context.postures(joint), start=1):
        for score in group:
            run, bins = score.run, score.run.bins
            is_block = run.kind == BLOCK
            speed = np.abs(bins.velocity) if is_block else np.full(len(bins.time), abs(run.speed))
            # A's gravity is not known where only a sum with it is, and 0 where the joint carries no weight.
            is_merged = any("gravity" in name.split(TOGETHER) and name != "gravity" for name in score.parts)
            parts.append(
                pd.DataFrame(
                    {
                        "direction": np.sign(bins.velocity) if is_block else run.direction,
                        "run": len(parts),
                        "residual": score.residual,
                        f"position ({unit})": scale * bins.position[:, joint - 1],
                        f"speed ({unit}/s)": scale * speed,
                        "gravity current (A)": score.parts.get("gravity", np.nan if is_merged else 0.0),
                        "time (min)": (bins.time + shifts[run.clock]) / 60.0,
                        "posture (number)": float(posture),
                        "temperature (°C)": bins.temperature,
                    }
                )
            )
    return pd.concat(parts, ignore_index=True)


def varying(bins: pd.DataFrame) -> list[str]:
    """Names of the variables that vary enough to show a dependence; position and time always."""
    least = {name: LEAST.get(name.split()[0], -1.0) for name in bins.columns[3:]}
    least = {name: x * bins[name].max() if name.startswith("speed") else x for name, x in least.items()}
    return [name for name, limit in least.items() if bins[name].max() - bins[name].min() > limit]


def _binned(axes: Axes, bins: pd.DataFrame, name: str, floor: float | None) -> None:
    zero_line(axes, floor)
    look = (
        {"markersize": 2.4, "linestyle": "-", "linewidth": 0.8} if name.startswith("position") else {"markersize": 4.2}
    )
    count = COARSE if name.startswith(("gravity", "time", "temperature")) else FINE
    for sign in (1, -1):
        side = bins[(bins["direction"] == sign) & np.isfinite(bins[name])]
        if side.empty:
            continue
        dots(axes, side[name], side["residual"], colour=COLOURS[sign], size=1.6, alpha=0.28)
        labels = pd.cut(side[name], count, labels=False)
        means = side.groupby([labels, "run"])["residual"].mean().groupby(level=0)
        error_marks(axes, side[name].groupby(labels).mean(), means.mean(), errors=means.sem(), sign=sign, **look)
    axes.margins(x=0.05)
    axes.locator_params(axis="x", nbins=6)  # small currents have long labels
    axes.set_xlabel(name, labelpad=1)
    top = 1.3 * max(float(bins["residual"].abs().quantile(0.99)), 1.2 * (floor or 0.0), 1e-9)
    axes.set(ylabel=CURRENT, ylim=(-top, top))


# Findings


def finding_figure(finding: Finding, curve: Curve, robot: Robot, *, name: str, units: str = "rad") -> Drawing:
    """What an effect explains at the joint of one of its curves: without it above, with it below."""
    effect, title = label(finding.effect), _title(finding, curve, robot)
    rivals = list(dict.fromkeys(line.effect for line in curve.lines if line.effect != finding.effect))
    broken = f" Broken: {listed(rivals, 'or')}, which these data cannot tell from it." if rivals else ""
    caption = (
        f"Above: residual, means over runs with standard errors; line: current of {effect}.{broken}"
        f" Below: residual with {effect} in the model."
    )
    return Drawing(f"{name}_j{curve.joint}", title, caption, _evidence([(title, effect, curve, CURRENT)], units))


def _title(finding: Finding, curve: Curve, robot: Robot) -> str:
    other = "" if finding.joint == curve.joint else f" of {place(finding, robot)}"
    return f"{joint_title(robot, curve.joint)}: {label(finding.effect)}{other}"


def shape_figure(joint: int, shape: Unexplained, robot: Robot, *, units: str = "rad") -> Drawing:
    """The shape of a joint's residual that no effect explains."""
    return Drawing(
        f"unexplained_j{joint}",
        f"{joint_title(robot, joint)}: residual that no effect explains",
        f"Means of the residual in bins. {form_sentence(shape, units)}",
        _evidence([_unexplained(joint, shape, robot)], units),
    )


def _unexplained(joint: int, shape: Unexplained, robot: Robot) -> Column:
    side = Binned(0, shape.centres, shape.means, np.nan * shape.means, shape.errors, np.ones(len(shape.means)))
    curve = Curve(joint, VARIABLES.get(shape.variable, shape.variable), shape.unit, (side,), ())
    kind = f"viscous (A s/{shape.unit})" if shape.form.startswith("v ") else CURRENT
    return f"{joint_title(robot, joint)}: {shape.form}, unexplained", "", curve, kind


def curve_figures(context: ReportContext) -> list[Drawing]:
    """Each learned curve of the model, with a band of two standard errors."""
    estimate, out = context.estimate, []
    for term in terms_of(estimate.effects):
        names = [part.name for part in term.parts(context.robot, 0)]
        if term.effect.is_free and set(names) <= set(estimate.names):
            numbers = [estimate.names.index(name) for name in names]
            x, covariance = np.linspace(term.shape["low"], term.shape["high"], POINTS), estimate.covariance
            columns, covariance = course(term.shape, x), covariance[np.ix_(numbers, numbers)]
            columns = columns - columns.mean(axis=0)
            errors = np.sqrt(np.maximum(np.einsum("nk,kl,nl->n", columns, covariance, columns), 0.0))
            title = f"{joint_title(context.robot, term.number)}: learned curve {spoken_form(term.shape)}"
            drawn = _learned(context, term, np.array([x, columns @ estimate.solution[numbers], errors]))
            out.append(
                Drawing(
                    f"curve_j{term.number}{term.mark}",
                    title,
                    "About its mean, which is part of Coulomb or viscous friction. Band: two standard errors.",
                    drawn,
                )
            )
    return out


@styled()
def _learned(context: ReportContext, term: EffectTerm, rows: Floats) -> Figure:
    unit, variable = context.robot.joint(term.number).position_unit, NAMES[int(term.shape["of"])]
    units = {"v": f"{unit}/s", "load": "A", "t": "s", "temperature": "degC"}
    scale, word = in_unit(units.get(variable, unit), context.units)
    figure, grid = panels(1, 1, height=2.4)
    axes, (x, y, error) = grid[0, 0], rows
    axes.fill_between(scale * x, y - 2.0 * error, y + 2.0 * error, color=INK, alpha=0.2, linewidth=0.0)
    axes.plot(scale * x, y, color=INK, linewidth=1.4)
    zero_line(axes)
    axes.set(
        xlabel=f"{VARIABLES.get(variable, variable)} ({'°C' if word == 'degC' else word})",
        ylabel=f"A s/{unit}" if term.shape["times"] else "A",
    )
    return figure


def diagnosis_figure(diagnosis: Diagnosis, robot: Robot, units: str = "rad") -> Drawing | None:
    """All findings in one figure, a column each, then shapes without a name; None where there is nothing to draw."""
    pairs = [(finding, curve) for finding in diagnosis.findings for curve in finding.curves]
    columns = [(_title(finding, curve, robot), label(finding.effect), curve, CURRENT) for finding, curve in pairs]
    columns += [_unexplained(x.joint, x.unexplained, robot) for x in diagnosis.joints if x.unexplained is not None]
    title = f"{robot.name}: missing effects"
    return Drawing("diagnosis", title, "", _evidence(columns[:MOST_COLUMNS], units)) if columns else None


@styled()
def _evidence(columns: Sequence[Column], units: str) -> Figure:
    has_effects = any(effect for _, effect, *_ in columns)
    figure, grid = panels(
        1 + has_effects, len(columns), height=1.75 if has_effects else 2.4, sharex="col", sharey="col"
    )
    lines = [line for _, _, curve, _ in columns for line in curve.lines]
    dashes: dict[str, Any] = dict(zip(dict.fromkeys(line.effect for line in lines), cycle(DASHES), strict=False))
    for both, (title, effect, curve, kind) in zip(grid.T, columns, strict=True):
        for axes, name in zip(both, ("before", "after"), strict=False):
            scale = _frame(axes, curve, kind, units=units)
            for side in curve.sides:
                x, y, dash = scale * side.centres, getattr(side, name), "" if side.direction else "-"
                error_marks(axes, x, y, errors=side.errors, sign=side.direction, linestyle=dash)
        for line in curve.lines:
            both[0].plot(
                scale * line.places,
                line.values,
                linewidth=1.4,
                color=COLOURS[line.direction],
                linestyle=dashes[line.effect],
            )
        both[-1].set_title(shortened(f"with {effect}", 44))
        both[0].set_title(shortened(title, 44))
        if has_effects:
            both[1].set_visible(bool(effect))
            both[0].set_xlabel("" if effect else both[1].get_xlabel())
            both[0].tick_params(labelbottom=not effect)
    ways = direction_handles(side.direction for _, _, curve, _ in columns for side in curve.sides)
    legend(
        figure,
        [*ways, *(Line2D([], [], color=INK, linestyle=dash, label=name) for name, dash in dashes.items())],
        2 * len(columns),
    )
    return figure


def _frame(axes: Axes, curve: Curve, kind: str, *, units: str) -> float:
    """Label the axes of a residual; the factor of the variable: degrees if asked for, minutes of long times."""
    is_long = (
        curve.unit == "s"
        and np.nanmax(np.abs(np.concatenate([side.centres for side in curve.sides])), initial=0.0) > MINUTES
    )
    scale, word = (1.0 / 60.0, "min") if is_long else in_unit(curve.unit, units)
    zero_line(axes)
    word = "°C" if word == "degC" else word
    axes.set_xlabel(f"{curve.variable} ({word})" if word else curve.variable, labelpad=1)
    means = [mean for side in curve.sides for mean in (side.before, side.after)]
    top = RANGE * max(1e-9, *(float(np.nanmax(np.abs(mean), initial=0.0)) for mean in means))
    axes.set(ylabel=kind, ylim=(-top, top))
    return scale
