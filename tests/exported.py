"""Models to export, and what pumaid itself says they draw."""

from dataclasses import replace

import numpy as np

from pumaid.effect_spec import expanded, terms_of
from pumaid.effects import Samples, catalogue
from pumaid.estimate import Estimate, JointFit, Value
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.model import Model, loads
from pumaid.robot import EffectChoice, Joint, Robot, placement
from pumaid.simulation import draw
from tests.worlds import CRANE, arm, random_arm

#: Effects that no posture and velocity determine; the contract of docs/export.md.
NOT_WRITTEN = (
    *("warmup", "friction_step", "payload", "torque_constant_drift", "thermal_friction", "presliding", "inertia"),
    *("saturation", "delay"),
)
#: Relative to the largest current: sums of a dozen products in another order.
EXACT = 1e-12


def robot_called(name: str) -> Robot:
    """A shipped arm, one of the tests' own, or twelve joints, half of them placed as in a URDF."""
    if name == "crane":
        return CRANE
    if name == "one":
        return arm("R", [1.0])
    if name == "twelve":
        return _half_placed(random_arm("RRPRRRRPRRRR", np.random.default_rng(12)))
    return read_recipe(shipped_recipes()[name])


def _half_placed(robot: Robot) -> Robot:
    """Every other joint stated by a random placement instead of Denavit-Hartenberg parameters."""
    rng, joints = np.random.default_rng(3), list(robot.joints)
    for joint in joints[::2]:
        frame = placement(rng.uniform(-0.3, 0.3, 3), rng.uniform(-3.0, 3.0, 3))
        joints[joint.number - 1] = Joint(joint.number, joint.name, joint.kind, placement=tuple(map(tuple, frame)))
    return replace(robot, joints=tuple(joints))


def every_effect(robot: Robot) -> tuple[EffectChoice, ...]:
    """Each effect of the catalogue, wherever on this arm it can act, with its example as shape."""
    out: list[EffectChoice] = []
    for name, effect in catalogue().items():
        for joint in range(robot.n_joints + 1) if not effect.base else ():
            owns = bool(effect.parameters(robot, joint)) if joint == 0 else effect.scope.value != "arm"
            if owns and (joint > 0) == (effect.scope.value != "arm") and effect.applies(robot, joint) is None:
                shape = {one.name: one.example for one in effect.shapes(robot, joint)}
                out.append(EffectChoice(name, joint or None, shape))
    return expanded(out, robot)


def fitted(robot: Robot, *, effects: tuple[EffectChoice, ...] = (), seed: int = 0) -> Estimate:
    """A model of a drawn robot as an identification without error would have it; effects get sizes at random."""
    truth, rng = draw(robot, seed), np.random.default_rng(seed)
    model = Model(robot, effects=terms_of(effects))
    known = truth.parameters()
    gain = np.append(np.cumprod(truth.constants.ratio[::-1])[::-1], 1.0)
    solution = [known.get(column.name, float(rng.uniform(-0.1, 0.1))) for column in model.columns]
    return Estimate(
        robot=robot.name,
        joints=tuple(JointFit(joint.number, 1, 1, 0.01, None) for joint in robot.joints),
        values=tuple(
            Value(column.name, column.symbol, column.owner or None, column.unit, value)
            for column, value in zip(model.columns, solution, strict=True)
        ),
        names=model.names,
        solution=np.array(solution),
        covariance=np.zeros((len(solution),) * 2),
        scales=np.triu(gain[:, None] / gain[None, :]),
        blind=np.zeros((len(solution), 0)),
        effects=tuple(effects),
        recipe_digest=robot.digest,
        origin=robot.origin,
    )


def motions(robot: Robot, *, count: int = 40, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Random postures and velocities, (N, J) each, all joints in motion."""
    rng = np.random.default_rng(seed)
    position = rng.uniform(-1.0, 1.0, (count, robot.n_joints)) * np.where(robot.is_revolute, np.pi, 1.0)
    return position, rng.uniform(-2.0, 2.0, (count, robot.n_joints))


def predicted(robot: Robot, estimate: Estimate, position: np.ndarray, *, velocity: np.ndarray) -> np.ndarray:
    """(N, J) A by `Model.predict`, joint by joint, without the effects that are not written."""
    gone = [name.split(".")[0] in NOT_WRITTEN for name in estimate.names]
    bare = replace(estimate, solution=np.where(gone, 0.0, estimate.solution))
    model, out = Model.of_estimate(robot, bare), np.empty_like(position)
    driving = velocity @ robot.shaft_speeds.T
    filled = {name: np.zeros(len(position)) for name in ("acceleration", "time", "elapsed", "travel", "temperature")}
    for joint in range(1, robot.n_joints + 1):
        direction = np.sign(driving[:, joint - 1])
        samples = Samples(joint, position, velocity, direction=direction, run=np.zeros(len(position)), **filled)
        seen = replace(samples, loads=loads(model, samples, solution=bare.solution, scales=bare.scales))
        out[:, joint - 1] = model.predict(bare, seen)
    return out


def off(found: np.ndarray, wanted: np.ndarray) -> float:
    """Largest difference, relative to the largest current of its joint."""
    return float((np.abs(found - wanted).max(axis=0) / np.abs(wanted).max(axis=0)).max())
