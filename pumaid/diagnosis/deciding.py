"""The runs that would decide between two effects, or show one that the data cannot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import special

from pumaid.diagnosis.candidates import Suspect
from pumaid.diagnosis.design import EQUAL, Goal, best
from pumaid.diagnosis.prospect import Duel, Prospect
from pumaid.diagnosis.score_test import ScoreTest
from pumaid.diagnosis.stepwise import DECISIVE, evidence
from pumaid.diagnosis.wording import because, decided, shown
from pumaid.effect_spec import EffectTerm
from pumaid.effects import Effect
from pumaid.estimation.fit import Fit
from pumaid.records import NextRun

Floats = NDArray[np.float64]

#: Laps (there and back) of a set of runs at most, each made twice.
PICKED = 2
#: Chance with which a decision is promised.
PROMISED = 0.9
#: Sets of runs beyond which no decision is promised.
MOST_REPEATS = 20
#: By how much a set must be more than enough before runs of it are left out.
SPARE = 2.0
#: Standard deviations below which a set of runs is not worth making.
LEAST = 0.5
#: Lead of evidence that is believed at most: what are rivals still is not told apart by evidence alone.
BELIEVED = 2.0
#: Natural logarithm of the fewest and most sets, and steps in which their number is found.
MOST_SETS, HALVINGS = 14.0, 18
#: Shapes of its grid with which a rival is fitted at first.
SHAPES = 24
#: Standard deviations with which an effect is found among a whole catalogue nine times in ten.
FOUND = 5.0


def deciding(solved: Fit, chosen: ScoreTest, rival: ScoreTest, *, picked: int = PICKED) -> NextRun:
    """The feasible runs after which it is soonest decided which of two effects it is.

    Each effect is fitted, with its shape and the whole model, to the data so far and to what the other predicts of the
    new runs; what it leaves is what these runs would tell. The smaller of the two misfits is made as large as possible,
    a little less so where the data lean to one effect already. Runs are there and back at one speed, on one stretch, in
    one posture of the data or a new one, each made twice.

    Parameters
    ----------
    solved
        The model without either.
    chosen, rival
        On `solved`, at their best shapes.
    picked
        Laps, there and back, of a set at most; each is made twice.

    Returns
    -------
    next_run
        With motions that a plan can hold; without, where no run within the limits decides.

    Source
    ------
    A. C. Atkinson and V. V. Fedorov, Biometrika 62 (1975) 57-70 (T-optimality); shapes that a rival may take are added
    one by one as in K. Shimizu and E. Aiyoshi, IEEE Trans. Automatic Control 25 (1980) 62-66.
    """
    effects = (chosen.added, rival.added)
    if any(isinstance(one.effect, Suspect) for one in effects):
        return NextRun(because(effects))

    def duels(prospect: Prospect) -> tuple[Duel, ...]:
        pairs = ((chosen, rival), (rival, chosen))
        return tuple(Duel(prospect, truth, other, _shapes(solved, other.added)) for truth, other in pairs)

    lead = evidence(solved, chosen) - evidence(solved, rival)
    found = best(solved, effects, Goal(duels, lambda gains: _haste(gains, lead), SPARE, picked))
    if found is None or found.gains.max() < LEAST**2:
        return NextRun(because(effects))
    apart = np.sqrt(found.gains)
    repeats = _repeats(found.times(MOST_REPEATS), lead)
    text = decided(solved.model.robot, found.made, effects, apart=(float(apart[0]), float(apart[1])), age=found.age)
    if repeats is None:
        once, often = (100.0 * float(_chance(found.times(MOST_REPEATS), lead)[k]) for k in (0, -1))
        text += f"; they decide with a chance of {once:.0f} %, made {MOST_REPEATS} times with {often:.0f} %"
    return NextRun(text, found.motions, float(apart.min()), repeats)


def showing(
    solved: Fit,
    effect: Effect,
    joint: int | None,
    *,
    size: float | None = None,
    shape: Mapping[str, float] | None = None,
    picked: int = PICKED,
) -> NextRun | None:
    """The feasible runs that show an effect best which the data cannot show.

    Parameters
    ----------
    solved
        The model without it.
    effect, joint
        What may be missing, and where (from 1; None: the whole arm).
    size
        Of its first parameter, others in the proportion of the effect's examples; the example's where not given.
    shape
        Where it is known; else one from the middle of the effect's grid.
    picked
        Laps, there and back, of a set at most; each is made twice.

    Returns
    -------
    next_run
        None where no feasible run shows an effect of this size, nor any an instant that has passed.
    """
    robot = solved.model.robot
    examples = np.array([one.example for one in effect.parameters(robot, joint or 0)])
    if isinstance(effect, Suspect) or not examples.size or effect.applies(robot, joint or 0) is not None:
        return None
    sizes = examples if size is None or examples[0] == 0.0 else examples * size / examples[0]
    grid = _grid(solved, effect, joint) or [{one.name: one.example for one in effect.shapes(robot, joint or 0)}]
    added = EffectTerm(effect, joint, {**grid[len(grid) // 2], **(shape or {})})
    if "time" in added.shape:
        return None
    none = np.zeros((len(sizes), len(sizes)))
    trials = [ScoreTest(added, 0.0, none, sizes=one, scores=none, visible=0.0, signs=none[0]) for one in np.diag(sizes)]

    def duels(prospect: Prospect) -> tuple[Duel, ...]:
        return tuple(Duel(prospect, one, None) for one in trials)

    found = best(solved, [added], Goal(duels, lambda gains: gains.min(axis=0), FOUND**2, picked))
    if found is None or MOST_REPEATS * found.worth < FOUND**2:
        return None
    text = shown(robot, found.made, added, apart=float(np.sqrt(found.worth)), age=found.age)
    return NextRun(text, found.motions, float(np.sqrt(found.worth)), int(np.ceil(FOUND**2 / found.worth)))


def _shapes(solved: Fit, added: EffectTerm) -> list[EffectTerm]:
    """Shapes of an effect's grid, evenly thinned."""
    grid = _grid(solved, added.effect, added.joint)
    some = np.linspace(0, len(grid) - 1, min(len(grid), SHAPES)).round().astype(int)
    return [EffectTerm(added.effect, added.joint, {**added.shape, **grid[k]}) for k in some]


def _grid(solved: Fit, effect: Effect, joint: int | None) -> Sequence[Mapping[str, float]]:
    rows = [row for row in solved.joints if row.bins.joint == joint]
    if not rows or effect.periodic is not None:
        return ()
    return effect.grid(solved.model.robot, rows[0].bins.extent(rows[0].drawn))


def _repeats(gains: Floats, lead: float) -> int | None:
    """How often a set is made until a decision has the chance `PROMISED`, by its gains (2, K) made once to K times."""
    enough = np.flatnonzero(_chance(gains, lead) >= PROMISED)
    return int(enough[0]) + 1 if len(enough) else None


def _chance(gains: Floats, lead: float) -> Floats:
    """(M,) chance that one effect is decisively ahead after gains (2, M), where `lead` is the first's so far.

    Where the first is true its lead grows by a normal variate of mean g and variance 4 g, else it falls so; which is
    true is weighed by the lead so far, of which no more is believed than `BELIEVED`.
    """
    believed = float(np.clip(lead, -BELIEVED, BELIEVED))
    leads, first = np.array([[believed], [-believed]]), special.expit(0.5 * believed)
    sure = special.ndtr((leads + gains - DECISIVE) / (2.0 * np.sqrt(gains) + EQUAL))
    return np.asarray(np.array([first, 1.0 - first]) @ sure)


def _haste(gains: Floats, lead: float) -> Floats:
    """(M,) one over how often sets with gains (2, M) must be made, as if gains grew in proportion: T-optimality.

    With no lead the smaller gain rules it, with a lead that of the effect ahead.
    """
    low, high = np.full(gains.shape[1], -MOST_SETS), np.full(gains.shape[1], MOST_SETS)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        enough = _chance(gains * np.exp(middle), lead) >= PROMISED
        low, high = np.where(enough, low, middle), np.where(enough, middle, high)
    return np.asarray(np.exp(-high))
