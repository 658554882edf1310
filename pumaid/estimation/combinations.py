"""What the data determine although its single terms are not: friction at one speed, a joint's load in one posture."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from pumaid.estimation.reasons import Facts
from pumaid.estimation.rows import Row
from pumaid.estimation.sheet import Sheet
from pumaid.maths.alike import grouped, marked, near
from pumaid.maths.joint_fit import Bilinear
from pumaid.model import SAME_POSTURE
from pumaid.records import Combination, Samples, Value

Floats = NDArray[np.float64]

#: Postures of a joint whose load is told: one is the usual case, more than three nobody reads.
MOST_POSTURES = 3

#: A sum is determined when what it may be off by, beyond its standard error, is below this share of the joint's RMS
#: current. Held positions creep by a few mrad between runs, so the share is small but never zero.
LEANING = 0.02

#: A sum is worth telling when one of its terms has an error this many times its own.
WORTH = 30.0

#: Terms below this share of the largest are rounding.
SHARE = 1e-9


def determined(sheet: Sheet, values: Sequence[Value]) -> tuple[Combination, ...]:
    """Sums of parameters that the data determine although a term of theirs, of `values`, is not or far less well."""
    errors = {value.name: math.inf if value.std_error is None else value.std_error for value in values}
    found: list[Combination] = []
    for row in sorted(sheet.fitted.rows, key=lambda row: row.joint):
        candidates = [*_friction(sheet, row), *_loads(sheet, row)]
        found += [
            sum_
            for sum_ in (_sum(sheet, row, *item) for item in candidates if _matters(sheet, row, item[0]))
            if any(abs(weight) * errors[name] > WORTH * sum_.std_error for name, weight in sum_.terms.items())
        ]
    found += _of_effects(sheet)
    return tuple(sum_ for sum_ in found if math.isfinite(sum_.value))


def _of_effects(sheet: Sheet) -> Iterable[Combination]:
    """Of each added effect that the data tell only in part from the paper's model: the parts that they do tell."""
    if sheet.gauge is None:
        return
    model = sheet.fitted.model
    for place, one in enumerate(model.effects):
        own = [n for n, column in enumerate(model.columns) if column.place == place and column.shape is None]
        size = np.linalg.norm(sheet.solution.jacobian[:, own], axis=0)
        if not size.all():
            continue
        held = sheet.gauge.rows[:, own] / size
        _, sizes, right = np.linalg.svd(held)
        if not sizes.any():
            continue
        for weights in right[np.count_nonzero(sizes > SHARE * sizes[0]) :]:
            whole = np.zeros(len(sheet.covariance))
            whole[own] = weights * size
            whole /= np.abs(whole).sum() * np.sign(whole[np.argmax(np.abs(whole))])
            where = f" of joint {one.number}" if one.number else ""
            row = next(row for row in sheet.fitted.rows if one.touches(row.joint))
            text = f"{one.effect.name}{where}: what does not pass for the paper's model"
            yield _sum(sheet, row, whole, text, unit=model.columns[own[0]].unit)


def _matters(sheet: Sheet, row: Row, weights: Floats) -> bool:
    """Whether parameters of plausible size would make this sum more than `LEANING` of the joint's current."""
    return float(np.linalg.norm(weights[: len(sheet.numbers)] * sheet.fitted.limit)) > LEANING * math.sqrt(
        row.mean_square
    )


def _sum(sheet: Sheet, row: Row, weights: Floats, text: str, *, unit: str = "A") -> Combination:
    """The sum with its standard error; NaN where it leans on a direction that the data do not determine."""
    names = sheet.fitted.model.names
    bare = weights[: len(names)]
    large = np.abs(bare) > SHARE * np.max(np.abs(bare), initial=0.0)
    terms = {name: float(weight) for name, weight, is_large in zip(names, bare, large, strict=True) if is_large}
    off = float(np.linalg.norm(weights @ sheet.reach()))
    variance = float(weights @ sheet.covariance @ weights) + off**2
    value = float(bare @ sheet.numbers) if off < LEANING * math.sqrt(row.mean_square) else math.nan
    return Combination(terms, value, math.sqrt(max(variance, 0.0)), unit, text)


def _friction(sheet: Sheet, row: Row) -> Iterable[tuple[Floats, str]]:
    """Coulomb plus viscous at the one speed that was run, each way."""
    names = sheet.fitted.model.names
    facts = Facts.of(row.joint, sheet.runs)
    for sign, side, way in ((1, "plus", "forward"), (-1, "minus", "backward")):
        if facts.has_one_speed(sign):
            speed = sign * float(np.mean(facts.speeds[sign]))
            weights = np.zeros(len(sheet.covariance))
            weights[names.index(f"coulomb.j{row.joint}.{side}")] = 1.0
            weights[names.index(f"viscous.j{row.joint}.{side}")] = speed
            yield weights, f"friction of joint {row.joint} {way}, at the one speed that was run"


def _loads(sheet: Sheet, row: Row) -> Iterable[tuple[Floats, str]]:
    """The whole gravity load of a revolute joint at positions 0 and a quarter turn, in each posture that was run."""
    model = sheet.fitted.model
    if not model.robot.joint(row.joint).is_revolute:
        return
    gravity = np.array([column.effect == "gravity" for column in model.columns])
    every = np.nan_to_num(np.array([run.posture for run in row.runs]))
    alike = grouped(len(every), lambda one, others: marked(others, near(every, one, others, within=SAME_POSTURE)))
    postures = list(islice(alike, MOST_POSTURES))
    for number, group in enumerate(postures, start=1):
        position = np.tile(every[group[0]], (2, 1))
        position[:, row.joint - 1] = [0.0, math.pi / 2.0]
        samples = Samples(row.joint, position, np.zeros_like(position), np.zeros(2), np.ones(2))
        which = f" (posture {number})" if len(postures) > 1 else ""
        here = np.full(2, row.joint - 1)
        load = Bilinear(here, model.base(samples) * gravity, np.zeros(2), sheet.fitted.system.owners)
        weights = load.jacobian(sheet.gains, sheet.numbers)
        yield weights[0], f"weight felt by joint {row.joint} at position 0{which}"
        yield weights[1], f"weight felt by joint {row.joint} a quarter turn on{which}"
