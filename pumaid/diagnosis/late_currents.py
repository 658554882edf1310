"""Currents that are logged later than positions: ripples line up where positions are taken as early as they are."""

from collections.abc import Sequence

import numpy as np

from pumaid.diagnosis.candidates import spectrum
from pumaid.errors import Note
from pumaid.estimation.fit import Fit
from pumaid.estimation.noise import noise_of
from pumaid.joint_bins import JointBins

#: s that are tried, and twice the log likelihood that one must gain: far more than the best of all frequencies has by
#: chance.
DELAYS, CLEAR = 0.002 * np.arange(-10, 11), 100.0


def current_late(fit: Fit, finest: Sequence[JointBins]) -> list[Note]:
    """The delay at which what a fit leaves at the finest bins of all joints is most of all a ripple, if not none.

    Of a wave that is late by half a period, say, or early, backward, nothing is left over all runs.
    """
    gains, joints = np.zeros(len(DELAYS)), list[str]()
    for bins in finest:
        misfit = fit.misfit(bins)
        noise = noise_of(bins, misfit)
        white = noise.whiten(bins, misfit)
        waves = [spectrum(("ripple", bins.joint), bins, noise, white=white, delay=delay) for delay in DELAYS]
        highest = np.array([0.0 if wave is None else wave.statistic().max() for wave in waves])
        gains += highest
        joints += [str(bins.joint)] if highest.max() - highest[len(DELAYS) // 2] > CLEAR else []
    top = int(np.argmax(gains))
    if gains[top] - gains[len(DELAYS) // 2] < CLEAR or top in (0, len(DELAYS) - 1):
        return []
    before, at, after = gains[top - 1 : top + 2]
    delay = float(DELAYS[top] + 0.5 * (before - after) / (before - 2.0 * at + after) * (DELAYS[1] - DELAYS[0]))
    text = (
        f"ripples line up where currents are taken to be drawn {1e3 * abs(delay):.1f} ms"
        f" {'before' if delay > 0.0 else 'after'} the positions beside them (joint {', '.join(joints)}); as logged they"
        f" pass for noise. Put delay: {delay:.4f} into the recipe's log block, and identify again"
    )
    return [Note("current-late", text)]
