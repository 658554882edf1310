"""Busy arms: zero to five effects at a joint at once, as large as real arms have them."""

from dataclasses import replace

import numpy as np

from blind_world.effects import CATALOGUE, OUTSIDE, fastest, line, snag
from blind_world.hidden import Hidden, Strokes, Unfit
from blind_world.motion import FREE, FULL, STROKES, THIN
from blind_world.world import World

#: Rates (Hz) of the log, and joints that move, by design: so that a diagnosis takes some ten seconds.
DESIGNS: dict[str, tuple[tuple[float, ...], int]] = {
    FULL: ((100.0,), 3),
    STROKES: ((100.0, 200.0, 400.0, 1000.0), 6),
    THIN: ((100.0, 200.0, 400.0), 6),
    FREE: ((100.0, 200.0, 400.0, 1000.0), 6),
}
BUILDERS = CATALOGUE | OUTSIDE | {"snag": snag}
#: Chances of zero to five effects at a joint.
COUNTS = (0.3, 0.2, 0.2, 0.15, 0.1, 0.05)
#: Each effect's weight in the draw, and its smallest and largest size: of the load (1), rad, of a spring's largest,
#: and else of the mean Coulomb friction. Where published:
#: - load_friction: 0.07 of a pendulum's load (docs/validation.md); 22 to 27 % are lost in a strain-wave gear
#:   (Harmonic Drive AG, engineering data CSD-2A, 2014).
#: - stribeck, viscous_power, warmup: A. C. Bittencourt and S. Gunnarsson, J. Dyn. Sys. Meas. Control 134 (2012)
#:   051013; R. Waiboer et al., Multibody Dynamics 2005; L. Simoni et al., Robotica, 10.1017/S0263574717000509. They
#:   have the laws; that a cold joint has 10 to 40 % more, and half as much again at rest, is common experience.
#: - ripple: one and two waves a turn of the wave generator (T. D. Tuttle and W. P. Seering, IEEE Trans. Robotics and
#:   Automation 12 (1996) 368-374); 199 waves a turn of a UR3e with 0.06 of its friction (docs/validation.md).
#: - coupling: the wrist of a PUMA 560 (S.-K. Lin, eq. 38-40). backlash: up to 15 arcmin new (makers of planetary
#:   gears), 1 deg worn. Nothing general is published of the others: their sizes lie between.
SIZES: dict[str, tuple[float, float, float]] = {
    "load_friction": (3.0, 0.04, 0.2),
    "stribeck": (3.0, 0.1, 0.5),
    "viscous_power": (2.0, 0.1, 0.5),
    "ripple": (3.0, 0.02, 0.15),
    "warmup": (1.5, 0.1, 0.4),
    "position_friction": (1.0, 0.05, 0.25),
    "coupling": (1.5, 0.02, 0.15),
    "spring": (1.0, 0.05, 0.3),
    "backlash": (0.7, 0.0017, 0.0175),
    "local_bump": (0.7, 0.2, 0.8),
    "snag": (0.7, 0.1, 0.6),
}


def disturbed(world: World, rng: np.random.Generator) -> World:
    """With spikes in one log of three, drift in one of three, and steps of the current up to twice the noise."""
    drift, spikes = (rng.random(2) < 1 / 3) * rng.uniform([0.1, 1e-5], [0.4, 3e-4])
    step = float(world.noise.step * np.exp(rng.uniform(0.0, np.log(2.5))))
    return replace(world, noise=replace(world.noise, drift=float(drift), spikes=float(spikes), step=step))


def lines(at: Strokes, rng: np.random.Generator) -> list[Hidden]:
    """Two to four ripples from 2.5 to 400 waves a turn; of some, one or two waves a turn of the motor."""
    slides = at.world.arm.slides[at.joint]
    low, high = (60.0, 600.0) if slides else (2.5, 400.0)
    high = min(high, fastest(at))
    waves = np.exp(rng.uniform(np.log(low), np.log(high), rng.integers(2, 5)))
    gear = at.world.arm.gear[at.joint] * rng.integers(1, 3)
    if not slides and gear < high and rng.random() < 0.5:
        waves[0] = gear
    return [line(at, rng, float(count)) for count in waves]


def draw_effects(world: World, rng: np.random.Generator) -> tuple[tuple[Hidden, float], ...]:
    """What is hidden in the whole arm, each with its amplitude."""
    names, out = list(SIZES), list[tuple[Hidden, float]]()
    weights = np.array([weight for weight, _, _ in SIZES.values()])
    for joint in range(world.arm.n):
        at = Strokes(world, joint)
        for name in rng.choice(names, rng.choice(6, p=COUNTS), replace=False, p=weights / weights.sum()):
            try:
                made = lines(at, rng) if name == "ripple" else [BUILDERS[name](at, rng)]
            except Unfit:
                continue
            out += [(hidden, amplitude(at, hidden, rng.uniform(*SIZES[name][1:]))) for hidden in made]
    return tuple(out)


def amplitude(at: Strokes, hidden: Hidden, size: float) -> float:
    """In the effect's own unit."""
    return size * {"A": at.dry, "A/rad": hidden.largest}.get(hidden.unit, 1.0)
