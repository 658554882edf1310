"""Effects as users choose them, by recipe or command line: checked, and one joint each."""

from __future__ import annotations

import difflib
import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from pumaid.effects import Effect, Scope, catalogue
from pumaid.errors import ModelError, Where
from pumaid.robot import EffectChoice, Robot

#: The joint that stands for all of them.
ALL = "all"

#: What to do where an effect is not known that may be a user's own.
OWN = "an effect from a file of your own needs that file each time: --effects FILE.py"


def spoken(text: str, robot: Robot, *, option: str = "--add") -> EffectChoice:
    """A choice as the command line writes it: ``EFFECT[@JOINT][:SHAPE=VALUE,...]``, angles in rad.

    Parameters
    ----------
    text
        ``stribeck@3:velocity=0.12``; the joint is a number from 1, a joint's name or ``all`` (as is none).
    robot
        Its joints.
    option
        What the user wrote it after, for the message.

    Raises
    ------
    ModelError [unknown-effect], [effect-joint], [effect-shape], [effect-not-here], [effect-twice]
        There is no such effect, joint or shape, and the nearest one is told; or it cannot act there.
    """
    where = Where(field=f"{option} {text}")
    head, _, tail = text.partition(":")
    name, at, joint = head.partition("@")
    if not name.strip() or (at and not joint.strip()):
        what = "no joint is named after the @" if name.strip() else "no effect is named"
        raise ModelError(
            "effect-joint" if name.strip() else "unknown-effect", what, where, f"write {option} stribeck@3"
        )
    effect = known_effect(name.strip(), where)
    number = _joint(joint.strip(), robot, where)
    shape: dict[str, float] = {}
    for part in filter(None, (piece.strip() for piece in tail.split(","))):
        key, _, value = (piece.strip() for piece in part.partition("="))
        _check_name(effect, robot, number or 1, key=key, where=where)
        if key in shape:
            raise ModelError("effect-shape", f"{key} is given twice", where, "give it once")
        try:
            shape[key] = float(value)
        except ValueError:
            what = f"{key} is {value!r}, which is no number" if value else f"{key} has no value"
            mend = f"write {key}=NUMBER, or leave it out to have it fitted"
            raise ModelError("effect-shape", what, where, mend) from None
    choice = EffectChoice(effect.name, number, shape)
    _expanded(choice, robot, where)
    return choice


def chosen_by(robot: Robot, *, add: Iterable[str] = (), remove: Iterable[str] = ()) -> tuple[EffectChoice, ...]:
    """The recipe's effects without those that `remove` names and with those that `add` does, one joint each.

    Parameters
    ----------
    robot
        With the recipe's effects.
    add
        As `spoken` reads them.
    remove
        ``EFFECT``, ``EFFECT@JOINT`` or ``all``.

    Raises
    ------
    ModelError [effect-not-there], [effect-not-here], [effect-twice] and those of `spoken`
        A choice is wrong, cannot act there, is in the model already, or cannot be taken out.
    """
    kept = expanded(robot.effects, robot)
    for text in remove:
        kept = _without(kept, text, robot)
    return expanded([*kept, *(spoken(text, robot) for text in add)], robot)


def expanded(choices: Sequence[EffectChoice], robot: Robot) -> tuple[EffectChoice, ...]:
    """Each choice at one joint or of the whole arm; a choice for all joints becomes one a joint where it can act.

    Raises
    ------
    ModelError [unknown-effect], [effect-joint], [effect-shape], [effect-not-here], [effect-twice]
        An effect, joint or shape is wrong, cannot act there, or is in the model already.
    """
    out: list[EffectChoice] = []
    for choice in choices:
        where = _where(choice, robot)
        for one in _expanded(choice, robot, where):
            _refuse_twice(one, out, where)
            out.append(one)
    return tuple(out)


def known_effect(name: str, where: Where) -> Effect:
    """The effect of the catalogue called `name`, if it can be added to a model.

    Raises
    ------
    ModelError [unknown-effect], [effect-twice]
        There is none, or every model has it.
    """
    known = catalogue()
    if name not in known:
        near = difflib.get_close_matches(name, known, n=1)
        raise ModelError(
            "unknown-effect",
            f"there is no effect {name} in the catalogue: {', '.join(known)}",
            where,
            f"did you mean {near[0]}?" if near else f"pumaid effects lists the names; {OWN}",
        )
    if known[name].base:
        raise ModelError("effect-twice", f"{name} is in every model already", where, "leave it out")
    return known[name]


def check_known(effects: Iterable[EffectChoice]) -> None:
    """Refuse effects of a model that the catalogue does not have.

    Raises
    ------
    ModelError [unknown-effect]
        There is one; most often it comes from a file that has to be named again.
    """
    for number, choice in enumerate(effects, start=1):
        if choice.effect not in catalogue():
            what = f"the model holds {choice.effect}, which is not in the catalogue"
            raise ModelError("unknown-effect", what, Where(joint=choice.joint, field=f"effects[{number}]"), OWN)


def _joint(word: str, robot: Robot, where: Where) -> int | None:
    if word in ("", ALL):
        return None
    names = {joint.name: joint.number for joint in robot.joints}
    number = names.get(word) or (int(word) if word.isdecimal() else 0)
    if not 1 <= number <= robot.n_joints:
        near = difflib.get_close_matches(word, names, n=1)
        mend = f"did you mean {near[0]}?" if near else f"one of {', '.join(names)}, a number from 1, or {ALL}"
        raise ModelError("effect-joint", f"{robot.name} has no joint {word}", where, mend)
    return number


def _without(choices: Sequence[EffectChoice], text: str, robot: Robot) -> tuple[EffectChoice, ...]:
    """The choices that `text` does not name."""
    if text.strip() == ALL:
        return ()
    option = f"--remove {text}"
    choice = spoken(text, robot, option="--remove")

    def is_named(one: EffectChoice) -> bool:
        differs = choice.shape and dict(choice.shape) != dict(one.shape)
        return one.effect == choice.effect and choice.joint in (None, one.joint) and not differs

    kept = tuple(one for one in choices if not is_named(one))
    if len(kept) == len(choices):
        there = ", ".join(f"{one.effect}@{one.joint}" if one.joint else one.effect for one in choices)
        mend = f"the recipe switches on: {there}" if there else "the recipe switches no effect on; leave it out"
        raise ModelError("effect-not-there", f"the model would not have {text} anyway", Where(field=option), mend)
    return kept


def _where(choice: EffectChoice, robot: Robot) -> Where:
    """The choice's place in the recipe, or its name."""
    for index, (one, line) in enumerate(itertools.zip_longest(robot.effects, robot.effect_lines), start=1):
        if one is choice:
            return Where(file=robot.origin or None, line=line, field=f"effects[{index}]")
    return Where(joint=choice.joint, field=f"effect {choice.effect}")


def _expanded(choice: EffectChoice, robot: Robot, where: Where) -> list[EffectChoice]:
    effect = known_effect(choice.effect, where)
    if effect.scope is Scope.ARM:
        if choice.joint is not None:
            what = f"{effect.name} is of the whole arm, not of joint {choice.joint}"
            raise ModelError("effect-joint", what, where, "leave the joint out")
        _refuse_idle({0: effect.applies(robot, 0)}, effect, where)
        _check_shape(effect, robot, 0, shape=choice.shape, where=where)
        return [choice]
    if choice.joint is not None and not 1 <= choice.joint <= robot.n_joints:
        what = f"{robot.name} has no joint {choice.joint}"
        raise ModelError("effect-joint", what, where, f"joints count from 1 to {robot.n_joints}")
    joints = range(1, robot.n_joints + 1) if choice.joint is None else (choice.joint,)
    refusals = {joint: effect.applies(robot, joint) for joint in joints}
    _refuse_idle(refusals, effect, where)
    free = [joint for joint, why in refusals.items() if why is None]
    for joint in free:
        _check_shape(effect, robot, joint, shape=choice.shape, where=where)
    return [choice if choice.joint else replace(choice, joint=joint) for joint in free]


def _refuse_idle(refusals: Mapping[int, str | None], effect: Effect, where: Where) -> None:
    """Refuse an effect that can act at none of the joints asked for."""
    reasons = [why for why in refusals.values() if why is not None]
    if len(reasons) == len(refusals):
        raise ModelError("effect-not-here", f"{effect.name} cannot act there: {reasons[0]}", where, "leave it out")


def _check_name(effect: Effect, robot: Robot, number: int, *, key: str, where: Where) -> None:
    known = [one.name for one in effect.shapes(robot, number)]
    if key not in known:
        near = difflib.get_close_matches(key, known, n=1)
        listed = f"known: {', '.join(known)}" if known else f"{effect.name} has no shape: leave it out"
        mend = f"did you mean {near[0]}?" if near else listed
        raise ModelError("effect-shape", f"{effect.name} has no shape called {key}", where, mend)


def _check_shape(effect: Effect, robot: Robot, number: int, *, shape: Mapping[str, float], where: Where) -> None:
    known = {one.name: one for one in effect.shapes(robot, number)}
    for name, value in shape.items():
        _check_name(effect, robot, number, key=name, where=where)
        low, high = known[name].low, known[name].high
        if not low <= value <= high:
            what = f"{name} of {effect.name} is {value:g}"
            raise ModelError("effect-shape", what, where, f"write a number from {low:g} to {high:g}")


def _refuse_twice(choice: EffectChoice, before: Sequence[EffectChoice], where: Where) -> None:
    """The same effect twice at a joint is two harmonics at best; two of one shape are one."""
    for other in before:
        if (other.effect, other.joint) != (choice.effect, choice.joint):
            continue
        is_one = bool(choice.shape) and dict(choice.shape) == dict(other.shape)
        if is_one or not catalogue()[choice.effect].is_repeatable:
            place = f" at joint {choice.joint}" if choice.joint else ""
            mend = "give each its own shape" if is_one else "take one of them out"
            raise ModelError("effect-twice", f"{choice.effect}{place} is in the model already", where, mend)


def at_one_joint(choice: EffectChoice, robot: Robot, option: str) -> EffectChoice:
    """The choice, checked; an effect of joints with its joint, one of the whole arm without.

    Parameters
    ----------
    choice
        Effect, joint, shapes.
    robot
        The arm.
    option
        Where it was named, for the message.

    Raises
    ------
    ModelError [unknown-effect], [effect-joint], [effect-not-here]
        There is no such effect, none at that joint, or no joint is named.
    """
    where = Where(field=f"{option} {choice.effect}")
    if known_effect(choice.effect, where).scope is not Scope.ARM and choice.joint is None:
        what = f"{choice.effect} acts at one joint at a time, and none is named"
        raise ModelError("effect-joint", what, where, f"write {choice.effect}@3")
    return expanded([choice], robot)[0]
