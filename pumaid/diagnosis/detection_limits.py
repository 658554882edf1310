"""Sizes of effects below which nothing would have been seen."""

from dataclasses import replace

import numpy as np
from scipy import special

from pumaid.diagnosis.candidates import PERIODIC, Key
from pumaid.diagnosis.records import Limit
from pumaid.diagnosis.score_test import (
    GROSS,
    LEVEL,
    WORTH,
    ScoreTable,
    ScoreTest,
    SignFlips,
    alike,
)
from pumaid.effects import Effect, catalogue
from pumaid.estimation.fit import Projector
from pumaid.robot import Robot

#: Chance with which an effect of the limit's size is found.
POWER = 0.8
#: Fourth moment of a normal score over its square's square. Mean square of a wave of size one. Times an effect's usual
#: size beyond which a limit is that of rounding.
NORMAL, WAVE, ABSURD = 3.0, 0.5, 1e6
#: A: errors below this count as it.
TINY = float(np.finfo(float).tiny) ** 0.5
#: Why no size of an effect could be seen.
FAINT = "the fitted model absorbs all of it in these runs"
SHORT = "no run is long enough for one and a half waves"
FOLLOWS = "it is tried at the frequencies of ripples that are found"
AVERAGED = "bins of these runs average it away; slower runs show it"


def detection_limits(scan: ScoreTable, family: SignFlips) -> dict[Key, Limit]:
    """The detection limit of every effect at every joint, in the unit of its first parameter.

    With information S of the parameter, all else refitted, a size a shifts the score by a sqrt(S) standard deviations;
    it is found in `POWER` of all cases when this exceeds the family-wise threshold, as it then is, by the normal
    quantile of `POWER`. It must also lower some joint's error by the share `WORTH`. Of an effect with a shape the limit
    is the median over shapes that can be seen; that of waves holds up to the frequency at which bins average half of
    their power away.
    """
    robot, scale, projector = scan.solved.model.robot, scan.solved.scale, Projector(scan.solved)
    shares = {row.bins.joint: row.bins.count / row.bins.count.sum() for row in scan.solved.joints}
    errors = {row.bins.joint: max(row.rmse, TINY) for row in scan.solved.joints}
    tests, out = {id(test.added): test for test in scan.trials}, dict[Key, Limit]()
    for key, group in scan.candidates.groups.items():
        falls = [shares[joint] @ (values / errors[joint]) ** 2 for joint, values in projector.columns(group).items()]
        largest = np.max(falls, axis=0, initial=0.0).reshape(len(group), -1)[:, 0] if falls else np.zeros(len(group))
        sizes = [
            _size(tests[id(term)], family, scan, fall=fall)
            for term, fall in zip(group, largest, strict=True)
            if id(term) in tests
        ]
        out[key] = _limit(robot, group[0].effect, key, float(np.median(sizes or [np.inf])))
    for waves in scan.spectra:
        shift = needed(family.threshold(waves.key, LEVEL), PERIODIC, runs=len(waves.scores))
        information = (waves.information * waves.power)[waves.visible]
        size = max(
            shift * float(np.sqrt(scale / np.median(information))) if len(information) else np.inf,
            errors[waves.key[1] or 0] * float(np.sqrt(2.0 * WORTH / WAVE)),
        )
        limit = _limit(robot, catalogue()[waves.key[0]], waves.key, size)
        at_end = {"up_to": float(waves.frequency[waves.visible][-1])} if len(information) else {"reason": AVERAGED}
        out[waves.key] = replace(limit, **at_end)
    untold: dict[Key, str] = {
        (effect.name, joint): FOLLOWS if effect.needs_loads else SHORT
        for effect in catalogue().values()
        if effect.periodic
        for joint in shares
    }
    return {key: Limit(*key, "", None, "", why) for key, why in (untold | dict(scan.candidates.excluded)).items()} | out


def _size(test: ScoreTest, family: SignFlips, scan: ScoreTable, *, fall: float) -> float:
    """Of the first parameter, the others zero: what is found, and lowers an error by the share `WORTH`.

    `fall` is the largest share of a joint's squared error that a unit of it makes; what the model absorbs takes none
    away. A fitted size must be expected above a threshold by a margin to pass it with `POWER`.
    """
    information, key = float(test.information[0, 0]), test.added.key
    if information <= 0.0 or fall <= 0.0:
        return float("inf")
    error = float(np.sqrt(scan.solved.scale / information))
    threshold, gross = family.threshold(key, LEVEL), family.gross(key)
    # Runs, each telling as much as any other, that would flip like these.
    runs = min(NORMAL * alike(test.scores[:, :1]) or 1.0, len(test.scores)) / float(np.mean(scan.leverage**2))
    return max(
        needed(threshold, test.width, runs=runs, gross=gross) * error,
        float(np.sqrt(2.0 * WORTH / (test.visible * fall)) + special.ndtri(POWER) * error),
    )


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


def _limit(robot: Robot, effect: Effect, key: Key, size: float) -> Limit:
    """Of that size; where it is infinite, with the reason and the runs in which the effect would be seen."""
    first = effect.parameters(robot, key[1] or 0)[0]
    if size < ABSURD * (abs(first.example) or 1.0):
        return Limit(*key, first.name, size, first.unit)
    return Limit(
        *(*key, first.name, None, first.unit),
        FAINT + (f"; it is seen best in {effect.seen_in}" if effect.seen_in else ""),
    )
