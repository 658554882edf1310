"""Hidden effects as the command line writes them."""

from __future__ import annotations

import difflib
import math

from pumaid.errors import ModelError, Where
from pumaid.robot import Robot
from pumaid.simulation.hidden.catalogue import LAWS
from pumaid.simulation.hidden.law import Hidden, Reach

#: SI; no value of a law is larger on any arm, and farther on currents overflow.
GREATEST = 1e9


def parse(text: str, robot: Robot) -> Hidden:
    """A hidden effect as the command line writes it: ``EFFECT[@JOINT][:key=value,...]``.

    Parameters
    ----------
    text
        ``stribeck@3:a=0.1,velocity=0.2``; the joint is a number from 1, a joint's name or ``all``; the letter of the
        catalogue's equation (``v_s``) stands for its key, too.
    robot
        Its joints.

    Returns
    -------
    hidden
        With the values that the text names and no other, see `sized`.

    Raises
    ------
    ModelError [hide-wrong]
        No such effect, joint or value; the nearest right one is named.
    """
    head, _, tail = text.partition(":")
    name, _, joint = head.partition("@")
    if name not in LAWS:
        raise _refusal(text, f"{name!r} is no effect that simulate can hide", name, list(LAWS))
    law = LAWS[name]
    number = _joint(text, joint, robot)
    if law.reach is Reach.ARM and number is not None:
        raise _refusal(text, f"{name} belongs to the whole arm", "", [f"--hide {name}"])
    values = {}
    for part in filter(None, tail.split(",")):
        word, _, value = part.partition("=")
        key = law.letters.get(word, word)
        if key not in law.keys:
            raise _refusal(text, f"{name} has no value {word!r}", word, [*law.keys, *law.letters])
        try:
            values[key] = float(value)
        except ValueError:
            raise _refusal(text, f"{word} is {value!r}, which is no number", "", list(law.keys)) from None
        if not (math.isfinite(values[key]) and abs(values[key]) <= GREATEST):
            what = f"{word} is {value}, which is no finite number, or beyond {GREATEST:g}"
            raise ModelError(
                "hide-wrong", what, Where(field=f"--hide {text}"), f"give {word} a number, or leave it out"
            )
    return Hidden(name, number, values)


def _joint(text: str, joint: str, robot: Robot) -> int | None:
    if joint in ("", "all"):
        return None
    names = {one.name: one.number for one in robot.joints}
    number = names.get(joint) or (int(joint) if joint.isdecimal() else 0)
    if not 1 <= number <= robot.n_joints:
        known = [*names, *(str(one) for one in names.values())]
        raise _refusal(text, f"{robot.name} has no joint {joint!r}", joint, known)
    return number


def _refusal(text: str, what: str, word: str, known: list[str]) -> ModelError:
    near = difflib.get_close_matches(word, known, n=1)
    mend = f"did you mean {near[0]}?" if near else f"known: {', '.join(known)}"
    return ModelError("hide-wrong", what, Where(field=f"--hide {text}"), mend)
