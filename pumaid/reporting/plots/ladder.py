"""The error ladder as a picture: steps that fall toward the noise floor, named after what was added."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from pumaid.reporting.ladder import of_joint, step
from pumaid.reporting.numbers import shortened
from pumaid.reporting.plots.style import BACKWARD, FORWARD, GREY, Drawing, saved, settle, styled
from pumaid.reporting.story import Story
from pumaid.results.history import Errors, Ladder, Rung
from pumaid.units import number

#: Where it stands among the figures of a report.
ORDER = 70

#: Steps that a picture has room for; of a longer ladder the first is shown, and the last ones.
MOST_STEPS = 8
#: Small panels side by side: three, or two where that fills the rows.
_ACROSS, _FEW_ACROSS = 3, {2: 2, 4: 2}
#: Share of the axis from which the ground is high enough for words.
_ROOM = 0.1
#: inch: a figure of its own, and one on a page that is read at 400 px; the main panel, a row of small ones.
_WIDTH, _ON_PAGE, _MAIN, _SMALL = 7.2, 4.9, 3.1, 1.35
#: Letters that stand side by side in an inch of labels; a step with room for fewer than so many has its number only.
_LETTERS, _FEWEST_LETTERS = 9.2, 8

Floats = NDArray[np.float64]


def drawings(story: Story) -> Iterator[Drawing]:
    """One figure where the experiment has more than one model."""
    ladder = story.ladder
    if ladder is not None and len(ladder.path) > 1:
        yield Drawing(
            "ladder",
            "Error after each addition",
            "One step a model, named after what it adds to the one before. Blue: RMSE of fitted runs; orange: of runs"
            " that no fit saw; the grey ground: what repeated runs differ by, which no model can remove.",
            lambda: draw(ladder, width=_ON_PAGE),
        )


def drawn(ladder: Ladder, form: str) -> bytes:
    """The picture as the content of a ``png``, ``svg`` or ``pdf`` file."""
    with styled():
        figure = draw(ladder)
        settle(figure)
        return saved(figure, form, f"Error of {ladder.robot} after each addition")


def draw(ladder: Ladder, *, width: float = _WIDTH) -> Figure:
    """The whole arm above, each joint below, `width` inch wide; an arm of one moving joint has the one panel."""
    path = shown(ladder)
    joints = [fit.joint for fit in path[-1].joints if any(rung.joints[fit.joint - 1].rmse is not None for rung in path)]
    across = _FEW_ACROSS.get(len(joints), _ACROSS if width > _ON_PAGE else 2)
    rows = -(-len(joints) // across) if len(joints) > 1 else 0
    figure = Figure(figsize=(width, _MAIN + _SMALL * rows + 0.5), layout="constrained")
    spec = figure.add_gridspec(1 + rows, across, height_ratios=[_MAIN, *[_SMALL] * rows])
    main = figure.add_subplot(spec[0, :])
    _main(main, path, _wholes(path, joints), room=int(_LETTERS * width / len(path)))
    told = "error after each addition" if len(path) > 1 else "error of the model"
    main.set_title(f"{shortened(ladder.robot)}: {told}", pad=10)
    for place, joint in enumerate(joints if rows else []):
        axes = figure.add_subplot(spec[1 + place // across, place % across])
        _small(axes, path, [of_joint(rung.joints[joint - 1]) for rung in path])
        axes.set_title(f"joint {joint} (A)", fontsize=9, fontweight="normal")
    figure.legend(handles=_handles(path), loc="outside lower center", ncols=3, handlelength=1.6)
    return figure


def shown(ladder: Ladder) -> tuple[Rung, ...]:
    """The models in the picture."""
    path = ladder.path
    return path if len(path) <= MOST_STEPS else (path[0], *path[1 - MOST_STEPS :])


def _wholes(path: Sequence[Rung], joints: Sequence[int]) -> list[Errors]:
    """The arm's errors; of an arm of which one joint moves, that joint's."""
    return [of_joint(rung.joints[joints[0] - 1]) for rung in path] if len(joints) == 1 else [r.whole for r in path]


def _main(axes: Axes, path: Sequence[Rung], errors: Sequence[Errors], *, room: int) -> None:
    fitted, heldout, floor = _steps(axes, errors, width=2.4)
    if floor[0] > _ROOM * axes.get_ylim()[1]:
        told = f"noise floor {number(float(floor[0]), 3)} A: repeated runs differ by as much"
        axes.text(0.012, 0.5 * floor[0], told, transform=axes.get_yaxis_transform(), va="center", fontsize=9)
    axes.set_ylabel("RMS error of the current (A)")
    axes.set_xticks(np.arange(len(path)) + 0.5, _labels(path, room))
    axes.tick_params(axis="x", length=0, pad=6)
    axes.set_xlabel("model" if room < _FEWEST_LETTERS else "")
    for place, (low, high) in enumerate(zip(fitted, heldout, strict=True)):
        colours = [(low, FORWARD), (high, BACKWARD)]
        known = sorted(((value, colour) for value, colour in colours if np.isfinite(value)), reverse=True)
        for (value, colour), side in zip(known, (1, -1), strict=False):
            _value(axes, place, value, colour=colour, side=side)


def _value(axes: Axes, place: int, value: float, *, colour: str, side: int) -> None:
    """The number of a step, above the upper line and below the lower one."""
    axes.annotate(
        number(value, 3),
        (place + 0.5, value),
        xytext=(0, 5 * side),
        textcoords="offset points",
        ha="center",
        va="bottom" if side > 0 else "top",
        color=colour,
        fontsize=9,
    )


def _small(axes: Axes, path: Sequence[Rung], errors: Sequence[Errors]) -> None:
    _steps(axes, errors, width=1.5)
    axes.set_xticks(np.arange(len(path)) + 0.5, [str(rung.number) for rung in path], fontsize=8)
    axes.tick_params(axis="x", length=0)
    axes.tick_params(axis="y", labelsize=8)
    axes.locator_params(axis="y", nbins=3)


def _steps(axes: Axes, errors: Sequence[Errors], *, width: float) -> tuple[Floats, Floats, Floats]:
    """Both lines and the ground; what is not known is left open. Returns fitted, held out and floor (A)."""
    columns = [[error.fitted, error.heldout, error.noise_floor] for error in errors]
    fitted, heldout, floor = np.array(columns, dtype=float).T
    edges = np.arange(len(errors) + 1.0)
    axes.fill_between(edges, np.append(floor, floor[-1]), step="post", color=GREY, alpha=0.28, linewidth=0, zorder=0)
    axes.step(edges, np.append(floor, floor[-1]), where="post", color=GREY, linewidth=0.8, zorder=1)
    for values, colour, dash in ((heldout, BACKWARD, (0, (4, 1.6))), (fitted, FORWARD, "-")):
        axes.step(edges, np.append(values, values[-1]), where="post", color=colour, linewidth=width, linestyle=dash)
    top = np.nanmax([0.0, *fitted[np.isfinite(fitted)], *heldout[np.isfinite(heldout)], *floor[np.isfinite(floor)]])
    axes.set_ylim(0.0, 1.18 * top if top > 0 else 1.0)
    axes.set_xlim(0.0, len(errors))
    return fitted, heldout, floor


def _labels(path: Sequence[Rung], room: int) -> list[str]:
    """Number and changes of each model, in lines of `room` letters where words allow it."""
    if room < _FEWEST_LETTERS:
        return [str(rung.number) for rung in path]
    word = "model " if len(path) < MOST_STEPS else ""
    labels = []
    for before, rung in zip((None, *path), path, strict=False):
        is_next = before is None or rung.parent == before.number
        phrases = step(rung) if is_next else ["several steps"]
        lines = [line for phrase in phrases for line in _broken(phrase, room)]
        labels.append("\n".join([f"{word}{rung.number}", *lines]))
    return labels


def _broken(phrase: str, room: int) -> list[str]:
    """``+ load_friction@3`` as lines of at most `room` letters where words allow it, the joint on its own."""
    name, at, joints = phrase.partition("@")
    name = name.replace("+ ", "+\u00a0").replace("− ", "−\u00a0").replace("_", " ")
    lines = textwrap.wrap(name, room, break_long_words=False)
    return [*lines, f"joint {joints}" if joints.isdecimal() else f"joints {joints}"] if at else lines


def _handles(path: Sequence[Rung]) -> list[Line2D | Patch]:
    every = [error for rung in path for error in (rung.whole, *map(of_joint, rung.joints))]
    found: list[Line2D | Patch] = [Line2D([], [], color=FORWARD, linewidth=2.4, label="fitted runs")]
    if any(error.heldout is not None for error in every):
        found.append(Line2D([], [], color=BACKWARD, linewidth=2.4, linestyle=(0, (4, 1.6)), label="runs no fit saw"))
    if any(error.noise_floor is not None for error in every):
        found.append(Patch(color=GREY, alpha=0.28, linewidth=0, label="noise floor"))
    return found
