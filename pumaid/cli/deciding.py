"""The plan that ``pumaid diagnose --plan`` writes: the runs that would decide, as often as it takes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pumaid.records import Finding
    from pumaid.robot import Robot
    from pumaid.trajectory import Plan


def deciding(findings: Iterable[Finding], robot: Robot) -> Plan:
    """The runs of all findings that have rivals, one whole set after the other.

    A set is run through before it is repeated, so that repeats lie apart in time.

    Parameters
    ----------
    findings
        With or without a next run.
    robot
        For the time that it takes.

    Returns
    -------
    plan
        Without motions where there is nothing to decide.
    """
    from dataclasses import replace

    from pumaid.trajectory import Plan, duration

    motions, told = [], []
    for found in findings:
        run = found.next_run
        if run is None or not run.motions:
            continue
        motions += list(run.motions) * (run.repeats or 1)
        told.append(f"tells {found.effect} from {', '.join(found.rivals)}: {run.text}")
    plan = Plan(robot=robot.name, motions=tuple(motions), assumptions=tuple(told))
    return replace(plan, duration=duration(robot, plan)) if motions else plan
