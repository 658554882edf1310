"""The block `coupling` of a recipe: by what ratio gears turn one joint's motor with another's."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from pumaid.io.recipe_faults import Fault

_FORM = "write r54 where joint 5's motor is turned by joint 4's, and r12_9 where a joint is above 9"


def coupled(key: Any) -> tuple[int, int] | None:
    """Joints (driven, driving), from 1, that a key names: (5, 4) for r54, (12, 9) for r12_9; else None."""
    match = re.fullmatch(r"r([1-9])([1-9])|r([1-9]\d?)_([1-9]\d?)", key) if isinstance(key, str) else None
    if match is None:
        return None
    driven, driving = (int(number) for number in match.groups() if number is not None)
    return driven, driving


def ratios_of(block: dict[str, float]) -> dict[tuple[int, int], float]:
    """Ratios of motor turns by (driven, driving) joint, of a block without faults."""
    return {pair: ratio for key, ratio in block.items() if (pair := coupled(key)) is not None}


def coupling_faults(block: dict[Any, Any], joints: list[Any]) -> Iterator[Fault]:
    """Couplings of joints that the arm has not, the wrong way round, or without the gears that they act through."""
    seen: dict[tuple[int, int], str] = {}
    for key in block:
        path, pair = ("coupling", str(key)), coupled(key)
        if pair is None:
            yield Fault(path, "recipe-unknown-key", f"{str(key)[:60]} does not name two joints", _FORM)
        elif max(pair) > len(joints):
            what = f"there is no joint {max(pair)} for {key}"
            yield Fault(path, "recipe-bad-value", what, f"joints count from 1 to {len(joints)}")
        elif pair[0] <= pair[1]:
            what = f"{key} has joint {pair[0]} driven by joint {pair[1]}, which is not nearer to the base"
            yield Fault(path, "recipe-bad-value", what, _FORM)
        elif seen.setdefault(pair, key) != key:
            yield Fault(path, "recipe-duplicate", f"{seen[pair]} and {key} couple the same joints", "take one away")
    for number in sorted({number for pair in seen for number in pair}):
        joint = joints[number - 1]
        if isinstance(joint, dict) and joint.get("gear_ratio") is None:
            what = f"joint {number} takes part in coupling.{next(key for pair, key in seen.items() if number in pair)}"
            mend = "add gear_ratio: motor turns per joint turn"
            yield Fault(
                ("joints", number - 1, "gear_ratio"), "recipe-missing-key", f"{what} without a gear ratio", mend
            )
