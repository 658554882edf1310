"""Plans as programs that a robot's own controller runs: one file a form."""

from __future__ import annotations

from collections.abc import Callable

from pumaid.programs.ros2 import trajectory
from pumaid.programs.urscript import script
from pumaid.records import Plan
from pumaid.robot import Robot

#: Form -> (suffix of its files, what writes it).
FORMS: dict[str, tuple[str, Callable[[Plan, Robot], str]]] = {
    "urscript": (".script", script),
    "ros2": (".ros2.yaml", trajectory),
}


def program_text(plan: Plan, robot: Robot, form: str) -> str:
    """A plan as the text of a program.

    Parameters
    ----------
    plan, robot
        The plan and the arm that it is for.
    form
        A key of `FORMS`.

    Raises
    ------
    ModelError [program-other-robot]
        The form is for another kind of arm.
    """
    return FORMS[form][1](plan, robot)
