"""What a search says of one candidate or joint, in numbers and short sentences."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Run
from pumaid.diagnosis.contender import Contender
from pumaid.diagnosis.suspect import Suspect
from pumaid.effect_spec import EffectTerm
from pumaid.estimation.fit import Fit, misfit_at
from pumaid.estimation.noise import FEWEST_PAIRS
from pumaid.joint_bins import JointBins, distinct
from pumaid.maths.rank import pseudo_inverse
from pumaid.records import Size
from pumaid.units import number

Floats = NDArray[np.float64]

#: Cosine of two parameters' information beyond which only their sum, or difference, is told.
TOGETHER = 0.95


def rmse_at(solved: Fit, held: list[JointBins]) -> float:
    """RMSE (A) of samples of runs that were not fitted."""
    square, count = 0.0, 0.0
    for one in held:
        square += float(one.count @ (misfit_at(solved, one) ** 2 + one.inside))
        count += float(one.count.sum())
    return float(np.sqrt(square / count))


def sizes(found: Contender) -> tuple[Size, ...]:
    """Parameters of a candidate with standard errors; of two that only their sum or difference is known of, that."""
    robot, added = found.on.model.robot, found.trial.added
    parameters = added.effect.parameters(robot, added.joint or 0)
    covariance = pseudo_inverse(found.trial.information)[0] * found.on.scale
    errors = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    unit = robot.joint(added.joint or 1).position_unit
    alone = tuple(
        Size(one.name, float(value), float(error), one.unit.format(unit=unit))
        for one, value, error in zip(parameters, found.trial.sizes, errors, strict=True)
    )
    if len(alone) != 2 or alone[0].unit != alone[1].unit:
        return alone
    known, (first, second) = found.trial.information, alone
    alike = known[0, 1] / np.sqrt(max(known[0, 0] * known[1, 1], np.finfo(float).tiny))
    if abs(alike) < TOGETHER:
        return alone
    sign = float(np.sign(alike))
    error = float(np.sqrt(covariance.trace() + 2.0 * sign * covariance[0, 1]))
    word = "+" if sign > 0.0 else "-"
    return (Size(f"{first.name} {word} {second.name}", first.value + sign * second.value, error, first.unit),)


def command(added: EffectTerm) -> str:
    """What adds it."""
    where = "" if added.joint is None else f"@{added.joint}"
    if isinstance(added.effect, Suspect):
        return ""
    shape = ",".join(f"{name}={value:.6g}" for name, value in added.shape.items())
    return f"pumaid identify LOGS --add {added.effect.name}{where}" + (f":{shape}" if shape else "")


def rival_name(key: tuple[str, int | None], joint: int | None) -> str:
    """A rival of an effect at `joint`: its name, with its joint where that is another."""
    name, own = key
    return name if own == joint or own is None else f"{name}@{own}"


def reason(found: Contender, better: str | None = None) -> str:
    """Why a candidate has the verdict that it has; `better` is what was chosen instead of it."""
    if found.fault == "chance":
        return "chance alone makes something as good in these data"
    if found.fault == "heldout":
        return "it does not predict runs that were left out any better"
    if found.fault == "denied" and found.transfer is not None:
        if not found.transfer.is_little:
            return "with it runs that were held out are predicted decidedly worse"
        share, error = (number(100.0 * part, 2) for part in (found.transfer.share, found.transfer.std_error))
        return f"of what it adds to runs that were held out these show only {share} ± {error} %"
    if found.fault == "worth":
        little = f"it would lower the error by {100.0 * found.gain:.1g} % only"
        return little if found.gain > 0.0 else "it lowers no error"
    gain = 100.0 * found.gain
    if better is not None:
        return f"it would lower the error by {gain:.2g} %, but {better} explains the same and more"
    return f"it lowers the error by {gain:.2g} % and predicts runs that were left out"


def weakened(field: JointBins, runs: Sequence[Run]) -> tuple[str, ...]:
    """What makes a joint's diagnosis weaker than it could be."""
    out = []
    if len(field.pairs) < FEWEST_PAIRS:
        few = {0: "no run is", 1: "only one run is"}
        what = few.get(len(field.pairs), f"only {len(field.pairs)} runs are")
        out.append(f"{what} repeated, so noise is told from missing physics by the residual alone")
    if len(field.postures) == 1:
        out.append("one posture only: what depends on the load cannot be told from what depends on the position")
    speeds = distinct([abs(run.speed) for run in field.runs])
    if len(speeds) < 3:
        out.append(f"{len(speeds)} speed{'s' if len(speeds) > 1 else ''} only: effects of speed are absorbed")
    elif len(speeds) == 3:
        out.append("three speeds only: an effect of speed shows its height there, not its course between")
    if len({run.direction for run in field.runs}) == 1:
        out.append("one direction only: friction cannot be told from what pushes the same way in both")
    if any(run.kind == "stroke" for run in field.runs):
        out.append("strokes from rest to rest: speed, position and start of a run change together")
    if len({run.joint for run in runs}) == 1:
        out.append("one joint only: gravity's loads cannot be checked against other joints")
    return tuple(out)
