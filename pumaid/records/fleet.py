"""Several robots of one kind, each with its own model: what is alike and what is not."""

from __future__ import annotations

from dataclasses import dataclass

from pumaid.records.estimate import Estimate


@dataclass(frozen=True, slots=True)
class Member:
    """One robot's value of a parameter.

    Attributes
    ----------
    robot
        Its folder's name.
    value, std_error
        SI.
    off
        Distance from the mean of the others, SI.
    p_value
        Chance that one of the others' kind is as far, corrected for all robots and parameters.
    stands_out
        Whether that is a finding.
    """

    robot: str
    value: float
    std_error: float
    off: float
    p_value: float
    stands_out: bool


@dataclass(frozen=True, slots=True)
class Shared:
    """One parameter over the fleet.

    Attributes
    ----------
    name, symbol, joint, unit
        As of a `Value`.
    mean, std_error
        Over the robots that have it, weighted by their errors, SI.
    spread
        Standard deviation between robots beyond their errors, SI.
    p_value
        Chance that equal robots differ as much, corrected for all parameters.
    differs
        Whether that is a finding.
    members
        Robots in which it is identified, two at least.
    """

    name: str
    symbol: str
    joint: int | None
    unit: str
    mean: float
    std_error: float
    spread: float
    p_value: float
    differs: bool
    members: tuple[Member, ...]


@dataclass(frozen=True, eq=False, slots=True)
class Fleet:
    """Models by robot, and each parameter that at least two of them have.

    Attributes
    ----------
    robots
        Folder name -> model.
    shared
        In the models' order.
    level
        Level of the findings, each kind for all of its tests together.
    """

    robots: dict[str, Estimate]
    shared: tuple[Shared, ...]
    level: float
