"""What these data could not have shown: the size at which each effect would have been found."""

from __future__ import annotations

import numpy as np
from scipy import stats

from pumaid.diagnosis.contender import LEVEL
from pumaid.diagnosis.familywise import PERIODIC, Family
from pumaid.diagnosis.scan import Scan, Trial
from pumaid.diagnosis.variants import Catalogue
from pumaid.effects import Effect, Scope
from pumaid.records import Limit, Robot

Key = tuple[str, int | None]

#: Chance with which an effect of the limit's size is found.
POWER = 0.8
#: Share of an effect that is left beside the model, below which a size that could be seen would be no small effect.
FAINT = "the fitted model absorbs all of it in these runs"


def limits(scan: Scan, catalogue: Catalogue, family: Family, *, periodic: Effect | None) -> dict[Key, Limit]:
    """The detection limit of every effect at every joint, in the unit of its first parameter.

    With information S of the parameter, all else refitted, a size a shifts the score by a sqrt(S) standard deviations;
    it is found in `POWER` of all cases when this exceeds the family-wise threshold by the normal quantile of `POWER`.
    Of an effect with a shape it is the median over shapes that can be seen.
    """
    robot, out = scan.solved.model.robot, dict[Key, Limit]()
    sizes: dict[Key, list[float]] = {}
    kinds: dict[Key, Effect] = {}
    for trial in scan.trials:
        key = trial.added.key
        kinds[key] = trial.added.effect
        sizes.setdefault(key, []).append(_size(trial, family, scan.solved.scale))
    for key, some in sizes.items():
        out[key] = _limit(robot, kinds[key], key, float(np.median(some)))
    for joint, spectrum in scan.spectra.items():
        if periodic is not None:
            lowest = needed(family.threshold((periodic.name, joint), LEVEL), PERIODIC) ** 2 * scan.solved.scale
            size = float(np.sqrt(lowest / np.median(spectrum.information)))
            out[periodic.name, joint] = _limit(robot, periodic, (periodic.name, joint), size)
    for key in scan.absorbed:
        out[key] = Limit(*key, "", None, "", FAINT)
    for key, why in catalogue.excluded.items():
        out[key] = Limit(*key, "", None, "", why)
    return out


def needed(surprise: float, freedoms: int) -> float:
    """Standard deviations of shift that are found with `POWER` when the threshold is `surprise` (-log10 p)."""
    threshold = float(stats.chi2.isf(10.0 ** -min(surprise, 300.0), freedoms))
    return float(np.sqrt(threshold) + stats.norm.ppf(POWER))


def _size(trial: Trial, family: Family, scale: float) -> float:
    if trial.information[0, 0] <= 0.0:
        return float("inf")
    variance = scale / float(trial.information[0, 0])  # the effect's other parameters zero
    return needed(family.threshold(trial.added.key, LEVEL), trial.width) * float(np.sqrt(variance))


def _limit(robot: Robot, effect: Effect, key: Key, size: float) -> Limit:
    first = effect.parameters(robot, key[1] or 0)[0]
    joint = robot.joint(key[1]) if key[1] and effect.scope is not Scope.ARM else robot.joints[0]
    unit = first.unit.format(unit=joint.position_unit)
    return Limit(*key, first.name, size, unit) if np.isfinite(size) else Limit(*key, first.name, None, unit, FAINT)
