"""Detection limits: the size at which each effect would have been found in these data."""

from __future__ import annotations

import numpy as np
from scipy import special

from pumaid.diagnosis.candidates import Key
from pumaid.diagnosis.records import Limit
from pumaid.diagnosis.score_test import Projector, ScoreTable, ScoreTest
from pumaid.diagnosis.sign_flip import GROSS, PERIODIC, SignFlips
from pumaid.diagnosis.stepwise import LEVEL, WORTH, rmse
from pumaid.effects import Effect, Scope
from pumaid.robot import Robot

#: Chance with which an effect of the limit's size is found.
POWER = 0.8
#: Fourth moment of a normal score over its square's square.
NORMAL = 3.0
#: Mean square of a wave of size one.
WAVE = 0.5
#: Why no size of an effect could be seen.
FAINT = "the fitted model absorbs all of it in these runs"


def detection_limits(scan: ScoreTable, family: SignFlips, *, periodic: Effect | None) -> dict[Key, Limit]:
    """The detection limit of every effect at every joint, in the unit of its first parameter.

    With information S of the parameter, all else refitted, a size a shifts the score by a sqrt(S) standard deviations;
    it is found in `POWER` of all cases when this exceeds the family-wise threshold, as it then is, by the normal
    quantile of `POWER`. It must also lower some joint's error by the share `WORTH`. Of an effect with a shape the limit
    is the median over shapes that can be seen.
    """
    robot, out = scan.solved.model.robot, dict[Key, Limit]()
    worth = _WorthwhileSize(scan)
    sizes: dict[Key, list[float]] = {}
    kinds: dict[Key, Effect] = {}
    for trial in scan.trials:
        key = trial.added.key
        kinds[key] = trial.added.effect
        sizes.setdefault(key, []).append(max(_size(trial, family, scan), worth.size(trial) + _margin(trial, scan)))
    for key, values in sizes.items():
        out[key] = _limit(robot, kinds[key], key, float(np.median(values)))
    for joint, spectrum in scan.spectra.items():
        if periodic is not None:
            threshold = family.threshold((periodic.name, joint), LEVEL)
            shift = needed(threshold, PERIODIC, runs=len(spectrum.scores))
            size = shift * float(np.sqrt(scan.solved.scale / np.median(spectrum.information)))
            least = worth.error[joint] * float(np.sqrt(2.0 * WORTH / WAVE))
            out[periodic.name, joint] = _limit(robot, periodic, (periodic.name, joint), max(size, least))
    for term in (group[0] for group in scan.candidates.groups):
        out.setdefault(term.key, Limit(*term.key, "", None, "", _faint(term.effect)))
    for key, why in scan.candidates.excluded.items():
        out[key] = Limit(*key, "", None, "", why)
    return out


class _WorthwhileSize:
    """Sizes with which effects lower the error of some joint by the share `WORTH`."""

    def __init__(self, scan: ScoreTable) -> None:
        rows, projector = scan.solved.joints, Projector(scan.solved)
        self.error = {row.bins.joint: rmse(row.bins, row.misfit) for row in rows}
        shares = {row.bins.joint: row.bins.count / row.bins.count.sum() for row in rows}
        self.squares: dict[int, dict[int, float]] = {}
        for group in scan.candidates.groups:
            for joint, columns in projector.columns(group).items():
                squares = shares[joint] @ columns[:, :: columns.shape[1] // len(group)] ** 2
                for term, square in zip(group, squares, strict=True):
                    self.squares.setdefault(id(term), {})[joint] = float(square)

    def size(self, trial: ScoreTest) -> float:
        """Of the first parameter; what the model absorbs of it takes no error away."""
        squares, tiny = self.squares[id(trial.added)], np.finfo(float).tiny
        best = max(square / max(self.error[joint], tiny) ** 2 for joint, square in squares.items()) * trial.visible
        return float(np.sqrt(2.0 * WORTH / best)) if best > 0.0 else np.inf


def needed(surprise: float, freedoms: int, *, runs: float, gross: float = GROSS) -> float:
    """Standard deviations of shift that are found with `POWER` when the threshold is `surprise` (-log10 p).

    Flipped scores hold the effect, too: a shift of d, spread over R runs, raises the flips' squares and with them the
    threshold by the share d^2 / R; but beyond `gross` no flip is asked.
    """
    more = float(special.ndtri(POWER))
    threshold, surely = (float(special.chdtri(freedoms, 10.0**-alarm)) for alarm in (min(surprise, gross), gross))
    rest = 1.0 - threshold / runs
    upper = float(np.sqrt(surely)) + more
    if rest <= 0.0:
        return upper
    return min((more + float(np.sqrt(more**2 - rest * (more**2 - threshold)))) / rest, upper)


def _size(trial: ScoreTest, family: SignFlips, scan: ScoreTable) -> float:
    if trial.information[0, 0] <= 0.0:
        return float("inf")
    variance = scan.solved.scale / float(trial.information[0, 0])  # the effect's other parameters zero
    key = trial.added.key
    threshold, gross = family.threshold(key, LEVEL), family.gross(key)
    return needed(threshold, trial.width, runs=_runs(trial, scan), gross=gross) * float(np.sqrt(variance))


def _margin(trial: ScoreTest, scan: ScoreTable) -> float:
    """By how much a fitted size must be expected above a threshold to pass it with `POWER`."""
    if trial.information[0, 0] <= 0.0:
        return float("inf")
    return float(special.ndtri(POWER)) * float(np.sqrt(scan.solved.scale / trial.information[0, 0]))


def _runs(trial: ScoreTest, scan: ScoreTable) -> float:
    """Runs, each telling as much as any other, that would flip like these: by their scores' fourth moment."""
    squares = trial.scores[:, 0] ** 2
    alike = float(NORMAL * squares.sum() ** 2 / np.sum(squares**2)) if squares.any() else 1.0
    return min(alike, float(len(squares))) / float(np.mean(scan.leverage**2))


def _limit(robot: Robot, effect: Effect, key: Key, size: float) -> Limit:
    first = effect.parameters(robot, key[1] or 0)[0]
    joint = robot.joint(key[1]) if key[1] and effect.scope is not Scope.ARM else robot.joints[0]
    unit = first.unit.format(unit=joint.position_unit)
    return (
        Limit(*key, first.name, size, unit)
        if np.isfinite(size)
        else Limit(*key, first.name, None, unit, _faint(effect))
    )


def _faint(effect: Effect) -> str:
    """Why no size of an effect could be seen, and in which runs it would be."""
    return FAINT + (f"; it is seen best in {effect.seen_in}" if effect.seen_in else "")
