"""Integers that were read as if they had no sign, or whose sign is a bit: told by where a signal's values lie."""

import math

import numpy as np

from pumaid.maths import Counts, Floats

#: Classes of a value's size an octave, and the octaves (powers of 2) that they cover.
AN_OCTAVE, OCTAVES = 64, (-20, 34)
CLASSES = AN_OCTAVE * (OCTAVES[1] - OCTAVES[0])
#: Bits whose place tells a sign: of per mille and per cent in eleven bits, and of integers of 8, 12, 16, 24, 32 bits.
SIGN_BITS = (7, 10, 11, 15, 23, 31)
#: Least share of the samples on either side, and least number.
SHARE, FEWEST = 0.005, 50
#: Share of the range of an integer that must be empty below a negative one, and by which its top may be missed.
EMPTY, TOP = 0.5, 0.1
#: Share of a sign's bit below it that must be empty, and by which the least value above may miss it.
EMPTY_BELOW, MISSED = 0.1, 0.02
#: Shares of the largest value below which a value without sign is next to zero, and at it; share of the former that are
#: the latter: a sixteenth where it turns round at zero, none where its least value happens to lie next to it.
NEXT_TO_ZERO, AT_ZERO, OF_THESE = 0.02, 0.02 / 16.0, 0.02

#: Integers of 16 bits that were read as others are written, and what they are then.
MISREAD = {
    **dict.fromkeys(("int16", "uint16-two-complement"), "sign-bit-15"),
    "sign-bit-15": "uint16-two-complement",
}

#: rad or m, and a second, beyond which a position leaps, and samples to either side by which it is told how it moved.
JUMP, LEAP, BESIDE = 1.0, 50.0, 8
#: rad or m, and usual steps, that a position strays at least where it leaps away and back.
ASTRAY, USUAL = 0.2, 20.0
#: rad/s2 or m/s2; no arm turns back so suddenly. Share by which speeds before and after may differ.
SUDDEN, ALIKE = 200.0, 0.1


def size_counts(values: Floats) -> Counts:
    """(CLASSES,) how many of (N,) positive values are of each size."""
    size = np.floor(AN_OCTAVE * (np.log2(values) - OCTAVES[0])).astype(np.int64)
    return np.bincount(np.clip(size, 0, CLASSES - 1), minlength=CLASSES)


def lost_sign(counts: Floats, step: float) -> tuple[str, str]:
    """How the sign of a signal that moves both ways was lost, and the encoding that reads it, where there is one.

    Both are empty where none was lost. `counts` are of its values' sizes (`size_counts`), none of which was negative;
    `step` is the least change of it.
    """
    total, bounds = counts.sum(), 2.0 ** (OCTAVES[0] + np.arange(CLASSES + 1) / AN_OCTAVE)
    least = max(FEWEST, SHARE * total)
    filled = np.flatnonzero(counts)
    if total < FEWEST:
        return "", ""
    for bit in SIGN_BITS:
        place = step * 2.0**bit
        below, above = filled[bounds[filled] < place * (1.0 - MISSED)], filled[bounds[filled] >= place * (1.0 - MISSED)]
        if min(counts[below].sum(), counts[above].sum()) < least:
            continue
        end, begin, top = bounds[below[-1] + 1], bounds[above[0]], bounds[above[-1] + 1]
        if begin - end > EMPTY * 2.0 * place and abs(top - 2.0 * place) < TOP * 2.0 * place:
            what = f"two's complement of {bit + 1} bits (negative ones stand below {2.0 * place:.6g} A)"
            return what, f"uint{bit + 1}-two-complement"
        if end < (1.0 - EMPTY_BELOW) * place and begin < place * (1.0 + MISSED) and top < 2.0 * place:
            return f"a sign in bit {bit} (negative ones stand above {place:.6g} A)", f"sign-bit-{bit}"
    small, least_of_all = (counts[bounds[:-1] < share * bounds[filled[-1]]].sum() for share in (NEXT_TO_ZERO, AT_ZERO))
    return "sizes without sign (they turn round at zero)" if least <= small <= least_of_all / OF_THESE else "", ""


def leaps(time: Floats, position: Floats, slow: float) -> dict[str, float]:
    """Leaps of (N,) positions before and after which a joint moves as fast, ``jumps``, ``jump_sum`` and
    ``jump_squares`` of their sizes; and ``bounces``, sudden turns at zero. Below the speed `slow` it is held.
    """
    step, pause = np.diff(position), np.diff(time)
    size, rows = np.abs(step), np.arange(BESIDE, len(step) - BESIDE)
    # Steps before and after one that sees a turn go opposite ways.
    turns = (step[rows - 1] * step[rows + 1] < 0.0) & (np.abs(position[rows]) < 2.0 * size[rows - 1])
    rows = rows[turns | (size[rows] > np.maximum(JUMP, LEAP * pause[rows]))]
    total = np.cumsum(np.append(0.0, step))
    before, after = (total[rows] - total[rows - BESIDE]) / BESIDE, (total[rows + 1 + BESIDE] - total[rows + 1]) / BESIDE
    speed, off = np.abs(before), np.abs(np.abs(before) - np.abs(after))
    size, pause = size[rows], pause[rows]
    is_leap = (off < 0.5 * speed) & (speed > slow * pause) & (size > np.maximum(JUMP, 10.0 * speed))
    is_leap &= size > LEAP * pause
    is_sudden = (
        (off < ALIKE * speed) & (before * after < 0.0) & (speed > np.maximum(slow, 0.5 * SUDDEN * pause) * pause)
    )
    is_sudden &= np.abs(position[rows]) < speed
    jumped = size[is_leap]
    sums = {"jump_sum": float(jumped.sum()), "jump_squares": float(jumped @ jumped)}
    return sums | {"jumps": float(len(jumped)), "bounces": float(np.count_nonzero(is_sudden))}


def strays(time: Floats, position: Floats) -> dict[str, float]:
    """How often (N,) positions leap to a number and back, but for whole turns, ``strays``; and the least, ``stray``.

    A leap is faster than any arm, and many times a usual step, which an encoder's flicker is not.
    """
    step = np.diff(position)
    size = np.abs(step)
    far = size > np.maximum(ASTRAY, LEAP * np.diff(time))
    far &= np.abs(size - math.tau * np.round(size / math.tau)) > ASTRAY
    leap = np.flatnonzero(far & (size > USUAL * np.median(size[size > 0.0]))) if far.any() else np.zeros(0, np.int64)
    away, back = leap[:-1], leap[1:]
    # Meanwhile it stands still, and it comes back to where a motion can have led.
    changes, way = np.cumsum(step != 0.0), np.abs(position[back + 1] - position[away])
    is_stray = (step[away] * step[back] < 0.0) & (changes[back] - changes[away] == 1)
    is_stray &= way < LEAP * (time[back + 1] - time[away])
    places = position[back[is_stray]]
    return {"strays": float(len(places)), "stray": float(places.min(initial=np.inf))}


def spikes(current: Floats) -> dict[str, float]:
    """How often (N,) A leap for one sample farther than all others are apart, ``spikes``; their size, ``spike``."""
    step = np.diff(current)
    size = np.minimum(np.abs(step[1:]), np.abs(step[:-1]))
    is_leap = (step[1:] * step[:-1] < 0.0) & (size * len(step) > USUAL * np.abs(step).sum())
    leap = 1 + np.flatnonzero(is_leap)
    leap = leap[size[leap - 1] > np.ptp(np.delete(current, leap))] if len(leap) else leap
    return {"spikes": float(len(leap)), "spike": float(np.abs(current[leap]).max(initial=0.0))}
