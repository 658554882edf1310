"""What is assumed of an arm before it is measured: random robots of its geometry or an earlier model, and a payload."""

from dataclasses import dataclass, replace

import numpy as np

from pumaid.errors import ModelError
from pumaid.estimate import NOT_IDENTIFIABLE, Estimate
from pumaid.maths import Floats
from pumaid.robot import Robot
from pumaid.simulation import BREAKAWAY, Constants, Friction, Links, Noise, Truth, constants, draw
from pumaid.units import number

#: Random robots for which a plan is made where no model is given.
DRAWN = 4
#: A, usual noise of a sample; a fifth of its variance is shared by all samples of a run.
NOISE = 0.02
#: kg and m of a payload at most.
_HEAVIEST, _FARTHEST = 1e5, 100.0


#: kg; x, y, z (m) of its centre in the last link's frame.
Payload = tuple[float, float, float, float]


def loaded(truth: Truth, payload: Payload) -> Truth:
    """A prior robot with the payload in its hand; where only constants in A are known, the last gain is a usual one."""
    mass, *at = payload
    n, bare, gain = truth.robot.n_joints, truth.constants, truth.gain
    if truth.given_constants is not None:
        usual = np.copysign(draw(truth.robot, 0).gain[-1], truth.friction.coulomb_plus[-1])
        gain = usual * np.append(np.cumprod(bare.ratio[::-1])[::-1], 1.0)
    last = Links(np.append(np.zeros(n - 1), mass), np.vstack([np.zeros((n - 1, 3)), at]))
    more = constants(truth.robot, last, gain)
    return truth.with_constants(Constants(bare.x + more.x, bare.y + more.y, bare.mass + more.mass, bare.ratio))


@dataclass(frozen=True, eq=False, slots=True)
class Prior:
    """Robots for which a plan is made, and the sentences that say where they come from."""

    robots: tuple[Truth, ...]
    sentences: tuple[str, ...]

    def typical_sizes(self) -> dict[str, float]:
        """Name -> typical size of a parameter (SI): the median over the robots, at least a tenth of its kind's."""
        values = [truth.parameters() for truth in self.robots]
        median = {name: float(np.median([abs(table[name]) for table in values])) for name in values[0]}
        kinds = {name.split(".")[0] for name in median}
        largest = {kind: max(value for name, value in median.items() if name.startswith(kind)) for kind in kinds}
        return {name: max(value, 0.1 * largest[name.split(".")[0]]) or 1.0 for name, value in median.items()}


def prior_robots(
    robot: Robot, *, estimate: Estimate | None = None, payload: Payload | None = None, seed: int = 0
) -> Prior:
    """Robots to plan for, with a payload: that of an earlier model, else several of the arm's geometry.

    Raises ModelError (plan-impossible) where the payload is out of range.
    """
    if estimate is not None:
        prior = robot_of_estimate(robot, estimate)
    else:
        noise, seeds = Noise(np.full(robot.n_joints, NOISE)), [1000 * seed + k for k in range(DRAWN)]
        sentences = (
            f"Noise of {NOISE:g} A a sample, a fifth of its variance a level of each run.",
            f"Masses, centres of mass and gains as of {DRAWN} robots drawn from the geometry; errors are their median.",
        )
        prior = Prior(tuple(replace(draw(robot, number), noise=noise) for number in seeds), sentences)
    if payload is None:
        return prior
    mass, *at = (number(part, 3) for part in payload)
    if not (0.0 < payload[0] <= _HEAVIEST and max(map(abs, payload[1:])) <= _FARTHEST):
        what = f"a payload of {mass} kg at ({', '.join(at)}) m is out of range"
        mend = f"give a mass above 0 and up to {_HEAVIEST:g} kg, and at most {_FARTHEST:g} m along each axis"
        raise ModelError("plan-impossible", what, mend=mend)
    sentence = (
        f"The last link carries {mass} kg at ({', '.join(at)}) m of its frame; gravity parameters are those of the arm"
        " with it, ratios those of the bare arm."
    )
    return Prior(tuple(loaded(truth, payload) for truth in prior.robots), (sentence, *prior.sentences))


def robot_of_estimate(robot: Robot, estimate: Estimate) -> Prior:
    """The robot that an earlier model describes; what it could not identify is taken from a random robot."""
    drawn, n = draw(robot, 0), robot.n_joints
    shown = {value.name for value in estimate.values if value.state != NOT_IDENTIFIABLE}
    values = drawn.parameters()
    # A parameter that no run shows is zero in the solution; of a sum each term has a share.
    identified = {
        name: float(value)
        for name, value in zip(estimate.names, estimate.solution, strict=True)
        if name in values and (name in shown or abs(value) > 1e-12)
    }
    ratios = {f"gain_ratio.{i}.{i + 1}": float(estimate.scales[i - 1, i]) for i in range(1, n)}
    identified |= {name: ratio for name, ratio in ratios.items() if name in shown and np.isfinite(ratio)}
    missing = [name for name in values if name not in identified]
    values |= identified
    std = [fit.noise_floor or fit.rmse or NOISE for fit in estimate.joints]
    level = [fit.run_level or np.sqrt(0.2) * s for fit, s in zip(estimate.joints, std, strict=True)]
    noise = np.hypot(std, level)
    share = float(np.median(np.minimum((np.asarray(level) / noise) ** 2, 0.9)))

    def of_joints(form: str) -> Floats:
        return np.array([values.get(form.format(k), 0.0) for k in range(1, n + 1)])

    sides = ("coulomb.j{}.plus", "coulomb.j{}.minus", "viscous.j{}.plus", "viscous.j{}.minus")
    ratio = np.array([values[f"gain_ratio.{k}.{k + 1}"] for k in range(1, n)])
    x, y, mass = (of_joints(f"gravity.l{{}}.{part}") for part in ("x", "y", "mass"))
    friction = Friction(*map(of_joints, sides))
    bare = replace(drawn, friction=friction, noise=Noise(noise, level_share=share), inertia=np.zeros(n), seed=None)
    truth = replace(bare.with_constants(Constants(x, y, mass, ratio)), breakaway=np.full(n, BREAKAWAY))
    sentences = [
        f"Parameters as of the earlier model; noise as its runs had it, {', '.join(number(s, 2) for s in noise)} A a"
        f" sample, {100.0 * share:.0f} % of the variance a level of each run."
    ]
    if missing:
        sentences.append(f"The model does not tell {', '.join(missing)}: taken from a robot drawn from the geometry.")
    return Prior((truth,), tuple(sentences))
