"""What is assumed of a robot before it is measured: robots drawn from the recipe, or an earlier model."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.design.setup import Setup
from pumaid.records import NOT_IDENTIFIABLE, Estimate
from pumaid.robot import Robot
from pumaid.simulation.draw import draw
from pumaid.simulation.recursion import Constants
from pumaid.simulation.truth import Friction, Noise, Truth
from pumaid.units import number

Floats = NDArray[np.float64]

#: Robots drawn from the recipe for which a plan is made.
DRAWN = 4
#: A, noise of a sample, a fifth of its variance being a level that a run shares; a usual arm's.
NOISE = 0.02
#: Solutions below this are nothing, in any of the units.
_ZERO = 1e-12


@dataclass(frozen=True, eq=False, slots=True)
class Assumed:
    """Robots for which a plan is made, and the sentence that says where they come from."""

    truths: tuple[Truth, ...]
    told: tuple[str, ...]

    def sizes(self) -> dict[str, float]:
        """Name -> what is usual of a parameter, SI: the median over the robots, never nothing."""
        each = [truth.parameters() for truth in self.truths]
        median = {name: float(np.median([abs(one[name]) for one in each])) for name in each[0]}
        kinds: dict[str, list[float]] = {}
        for name, value in median.items():
            kinds.setdefault(name.split(".")[0], []).append(value)
        # One that happens to be small is wanted no better than a tenth of what is usual of its kind.
        return {name: max(value, 0.1 * max(kinds[name.split(".")[0]])) or 1.0 for name, value in median.items()}


def assume(robot: Robot, *, prior: Estimate | None, setup: Setup, seed: int) -> Assumed:
    """Robots to plan for: an earlier model's, else several drawn from the recipe; with what the setup adds.

    Parameters
    ----------
    robot
        As it stands.
    prior
        An earlier model of the same arm, or none.
    setup
        A payload.
    seed
        Same seed, same robots.
    """
    found = drawn(robot, seed) if prior is None else known(robot, prior)
    return replace(found, truths=tuple(setup.loaded(truth) for truth in found.truths))


def drawn(robot: Robot, seed: int) -> Assumed:
    """Robots with the recipe's geometry and whatever it does not say drawn from the seed.

    Parameters
    ----------
    robot
        Geometry, limits.
    seed
        Same seed, same robots.
    """
    noise = Noise(np.full(robot.n_joints, NOISE))
    truths = tuple(replace(draw(robot, 1000 * seed + k), noise=noise) for k in range(DRAWN))
    return Assumed(
        truths,
        (
            f"Noise of {NOISE:g} A a sample, a fifth of its variance a level of each run.",
            f"Masses, centres of mass and gains as of {DRAWN} robots drawn from the geometry; errors are their median.",
        ),
    )


def known(robot: Robot, estimate: Estimate) -> Assumed:
    """The robot that an earlier model describes; what it could not tell is taken from a drawn robot.

    Parameters
    ----------
    robot
        By the recipe of the plan.
    estimate
        Of the same arm.
    """
    values = draw(robot, 0).parameters()
    shown = {value.name for value in estimate.values if value.state != NOT_IDENTIFIABLE}
    # Of what no run showed at all the model's solution holds a zero; of sums it holds a share for each term.
    told = {
        name: float(value)
        for name, value in zip(estimate.names, estimate.solution, strict=True)
        if name in values and (name in shown or abs(value) > _ZERO)
    }
    # Of a ratio that was not shown it holds a number, but any would have done.
    for n in range(1, robot.n_joints):
        if (name := f"gain_ratio.{n}.{n + 1}") in shown and np.isfinite(scale := estimate.scales[n - 1, n]):
            told[name] = float(scale)
    values |= told
    noise, shares = [], []
    for fit in estimate.joints:
        std = fit.noise_floor or fit.rmse or NOISE
        level = fit.run_level or np.sqrt(0.2) * std
        noise.append(float(np.hypot(std, level)))
        shares.append(min((level / noise[-1]) ** 2, 0.9))
    joints = range(1, robot.n_joints + 1)
    gravity = {part: np.array([values.get(f"gravity.l{n}.{part}", 0.0) for n in joints]) for part in ("x", "y", "mass")}
    ratio = np.array([values[f"gain_ratio.{n}.{n + 1}"] for n in list(joints)[:-1]])
    friction = Friction(
        *(
            np.array([values[f"{kind}.j{n}.{side}"] for n in joints])
            for kind, side in (("coulomb", "plus"), ("coulomb", "minus"), ("viscous", "plus"), ("viscous", "minus"))
        )
    )
    truth = Truth(
        robot=robot,
        friction=friction,
        noise=Noise(np.array(noise), level_share=float(np.median(shares))),
        known=Constants(gravity["x"], gravity["y"], gravity["mass"], ratio),
    )
    missing = [name for name in values if name not in told]
    sentences = [
        "Parameters as of the earlier model; noise as its runs had it, "
        f"{', '.join(number(one, 2) for one in noise)} A a sample, {100.0 * float(np.median(shares)):.0f} % of the "
        "variance a level of each run."
    ]
    if missing:
        sentences.append(f"The model does not tell {', '.join(missing)}: taken from a robot drawn from the geometry.")
    return Assumed((truth,), tuple(sentences))
