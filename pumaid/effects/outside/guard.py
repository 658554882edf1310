"""Effects of others at work on a user's robot: what the trial on a small arm did not show is told here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from inspect import signature
from numbers import Real
from typing import Any

import numpy as np

from pumaid.effects.base import Effect, Parameter, Scope, Shape
from pumaid.effects.outside.failing import refused
from pumaid.errors import ModelError, Where

#: A per unit of a parameter; what is larger leaves nothing of other columns beside it.
GREATEST = 1e12

_MEND = "mend the effect; docs/adding_an_effect.md tells what it must keep on every robot and every run"


#: What is wrong with an answer of an effect, given what it was asked; None where nothing is.
Check = Callable[[Effect, Any, Mapping[str, Any]], str | None]


def guarded(effect: Effect, where: Where) -> Effect:
    """The same effect, each of whose methods refuses where it fails or gives what it must not.

    Parameters
    ----------
    effect
        Of a file or of another package, already tried.
    where
        The place that a refusal names.
    """
    for name, check in _CHECKS.items():
        if getattr(type(effect), name) is not getattr(Effect, name):
            # Kept by the effect itself: what the base class calls is looked at as well.
            vars(effect)[name] = _watched(effect, name, check, where=where)
    return effect


def _watched(effect: Effect, name: str, check: Check, *, where: Where) -> Callable[..., Any]:
    method, called, asked = getattr(effect, name), effect.name, signature(getattr(Effect, name))

    def call(*given: Any, **named: Any) -> Any:
        arguments = asked.bind(effect, *given, **named).arguments
        joint = arguments["samples"].joint if "samples" in arguments else None

        def refusal(did: str) -> ModelError:
            what = f"the effect {called} fails on this robot: its {name}() {did}"
            return ModelError("effect-contract", what, replace(where, joint=joint), _MEND)

        # Numbers that come of a division by nothing are found below.
        with refused(lambda words: refusal(f"raises {words}")), np.errstate(all="ignore"):
            found = method(*given, **named)
            fault = check(effect, found, arguments)
        if fault is not None:
            raise refusal(fault)
        return found

    return call


def _all(kind: type) -> Check:
    """A check that an answer is a tuple of a kind."""

    def check(_: Effect, found: Any, __: Mapping[str, Any]) -> str | None:
        if isinstance(found, tuple | list) and all(isinstance(one, kind) for one in found):
            return None
        return f"gives {_shown(found)}, not a tuple of {kind.__name__}"

    return check


def _reason(_: Effect, found: Any, __: Mapping[str, Any]) -> str | None:
    return None if found is None or isinstance(found, str) else f"gives {_shown(found)}, neither a reason nor None"


def _columns(effect: Effect, found: Any, asked: Mapping[str, Any]) -> str | None:
    """What is wrong with the columns of one owner."""
    samples, number = asked["samples"], asked.get("number") or 0
    owner = number if number or effect.scope is Scope.ARM else samples.joint
    wanted = (len(samples), len(effect.parameters(asked["robot"], owner)))
    if not isinstance(found, np.ndarray) or found.shape != wanted or found.dtype.kind not in "fiub":
        return f"gives {_shown(found)}, not numbers of the shape {wanted}: a row an instant, a column a parameter"
    if not np.isfinite(found).all():
        return "gives numbers that are not finite"
    most = float(np.abs(found).max(initial=0.0))
    return f"gives numbers up to {most:.1e}, which are no currents (A per unit)" if most > GREATEST else None


def _columns_each(effect: Effect, found: Any, asked: Mapping[str, Any]) -> str | None:
    if len(found) != len(asked["shapes"]):
        return f"gives {len(found)} arrays for {len(asked['shapes'])} shapes"
    faults = (_columns(effect, one, asked) for one in found)
    return next((fault for fault in faults if fault is not None), None)


def _columns_of(effect: Effect, found: Any, asked: Mapping[str, Any]) -> str | None:
    faults = (_columns(effect, found[number], {**asked, "number": number}) for number in asked["numbers"])
    return next((fault for fault in faults if fault is not None), None)


def _shown(found: object) -> str:
    """What an answer is, in a few words."""
    if isinstance(found, np.ndarray):
        return f"an array of the shape {found.shape} of {found.dtype}"
    return repr(found)[:60] if found is None or isinstance(found, int | float | str) else type(found).__name__


_CHECKS: Mapping[str, Check] = {
    "parameters": _all(Parameter),
    "shapes": _all(Shape),
    "grid": _all(Mapping),
    "signs": _all(Real),
    "applies": _reason,
    "columns": _columns,
    "columns_each": _columns_each,
    "columns_of": _columns_of,
}
