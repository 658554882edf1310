"""Which robots of a fleet differ, parameter by parameter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from pumaid.maths.heterogeneity import alike, apart, between, holm, pooled
from pumaid.records import IDENTIFIED, Estimate, Fleet, Member, Shared, Value

#: Level of the findings, for all parameters (or all robots of all parameters) together.
LEVEL = 0.01


def fleet(robots: Mapping[str, Estimate], *, level: float = LEVEL) -> Fleet:
    """Compare models of several robots of one kind.

    A parameter *differs* where equal robots would hardly give estimates so far apart. A robot *stands out* in it where
    one of the others' kind, by their errors and by how they differ among themselves, would hardly be so far.

    Parameters
    ----------
    robots
        Name -> model, all of the same arm and effects; two at least.
    level
        Chance of a false finding among all parameters, and among all robots of all parameters.

    Returns
    -------
    fleet
        Parameters that at least two robots have.

    Raises
    ------
    ValueError
        Fewer than two robots.
    """
    if len(robots) < 2:
        raise ValueError(f"a fleet has two robots at least, not {len(robots)}")
    names = dict.fromkeys(value.name for one in robots.values() for value in one.values)
    found = [one for name in names if (one := _shared(name, robots)) is not None]
    chances = holm(np.array([one.p_value for one in found]))
    each = holm(np.array([member.p_value for one in found for member in one.members]))
    out, place = [], 0
    for one, chance in zip(found, chances, strict=True):
        own = each[place : place + len(one.members)]
        place += len(one.members)
        members = tuple(
            replace(member, p_value=float(p), stands_out=bool(p < level))
            for member, p in zip(one.members, own, strict=True)
        )
        out.append(replace(one, p_value=float(chance), differs=bool(chance < level), members=members))
    return Fleet(dict(robots), tuple(out), level)


def _shared(name: str, robots: Mapping[str, Estimate]) -> Shared | None:
    """A parameter with its members, chances not yet corrected; None where fewer than two robots have it."""
    known: dict[str, Value] = {}
    for robot, estimate in robots.items():
        value = next((one for one in estimate.values if one.name == name), None)
        if value is not None and value.state == IDENTIFIED and value.value is not None and value.std_error:
            known[robot] = value
    if len(known) < 2:
        return None
    values = np.array([one.value for one in known.values()], dtype=float)
    errors = np.array([one.std_error for one in known.values()], dtype=float)
    freedoms = np.array([one.dof or 1.0 for one in known.values()])
    off, chance = apart(values, errors, freedoms)
    mean, error = pooled(values, errors)
    members = tuple(
        Member(robot, float(v), float(e), float(d), float(p), stands_out=False)
        for robot, v, e, d, p in zip(known, values, errors, off, chance, strict=True)
    )
    first = next(iter(known.values()))
    p_value = alike(values, errors, freedoms)
    spread = between(values, errors)
    return Shared(
        name, first.symbol, first.joint, first.unit, mean, error, spread, p_value, differs=False, members=members
    )
