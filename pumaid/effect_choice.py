"""How users name an effect, to add it to a model or to hide it in a virtual robot: EFFECT@JOINT:KEY=VALUE."""

import difflib
from collections.abc import Iterable

from pumaid.errors import ModelError, Where
from pumaid.robot import EffectChoice, Robot

#: The joint that stands for all of them.
ALL = "all"


def read_choice(text: str, robot: Robot, option: str) -> EffectChoice:
    """What a user writes after `option`, ``EFFECT[@JOINT][:KEY=VALUE,...]``; the effect and its keys are not checked.

    The joint is a number from 1, a joint's name or ``all`` (as is none). Raises ModelError: effect-joint where there is
    no such joint, effect-shape where a value is no number or given twice.
    """
    where = Where(field=f"{option} {text}")
    head, _, tail = text.partition(":")
    name, at, word = (part.strip() for part in head.partition("@"))
    if at and not word:
        raise ModelError("effect-joint", "no joint is named after the @", where, f"write {option} stribeck@3")
    joint: int | None = None
    if word not in ("", ALL):
        names = {axis.name: axis.number for axis in robot.joints}
        joint = names.get(word) or (int(word) if word.isdecimal() else 0)
        if not 1 <= joint <= robot.n_joints:
            mend = did_you_mean(word, names, f"one of {', '.join(names)}, a number from 1, or {ALL}")
            raise ModelError("effect-joint", f"{robot.name} has no joint {word}", where, mend)
    shape: dict[str, float] = {}
    for key, _, value in (part.partition("=") for part in tail.split(",") if part.strip()):
        key = key.strip()
        if key in shape:
            raise ModelError("effect-shape", f"{key} is given twice", where, "give it once")
        try:
            shape[key] = float(value)
        except ValueError:
            what = f"{key} is {value!r}, which is no number"
            raise ModelError("effect-shape", what, where, f"write {key}=NUMBER, or leave it out") from None
    return EffectChoice(name, joint, shape)


def did_you_mean(word: str, names: Iterable[str], otherwise: str) -> str:
    """What to mend: the nearest name there is, if one is near."""
    near = difflib.get_close_matches(word, names, n=1)
    return f"did you mean {near[0]}?" if near else otherwise
