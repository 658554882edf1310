"""Let a virtual robot execute a plan."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from pumaid.errors import ModelError, Where
from pumaid.records import Log
from pumaid.robot import Robot
from pumaid.simulation.draw import draw
from pumaid.simulation.session import BUILTIN, Session
from pumaid.simulation.truth import Truth
from pumaid.trajectory import Plan

#: Hz; slower, and a run of a few seconds would leave a sample or none.
SLOWEST = 1.0
#: Hz; ten times the fastest current loops that are logged.
FASTEST = 100_000.0
#: rad or m; an arm that is said to be farther away was thrown there by a controller out of its depth.
_FARTHEST = 1e3
#: A; no motor draws a thousandth of it.
_MOST = 1e6


def simulate(
    robot: Robot,
    plan: Plan,
    *,
    seed: int = 0,
    truth: Truth | None = None,
    rate: float = 250.0,
    noise: float | None = None,
    runs_per_file: int = 40,
    has_velocity: bool = True,
    has_temperature: bool = False,
    physics: str = BUILTIN,
) -> Iterator[Log]:
    """A virtual robot executes a plan, motion by motion, and logs what a real one would.

    It goes to each motion's start with all joints at once, rests, runs, rests, all in closed loop under the controller
    of the paper's experiment. Motors carry gravity, friction by direction, inertia where the speed changes; joints at
    rest are held by stiction, too. Logs have the steps of encoders and sensors, noise that is correlated from sample to
    sample and a level for each run.

    Parameters
    ----------
    robot
        J joints.
    plan
        Motions in the order of their execution.
    seed
        Same seed, same robot and same noise.
    truth
        The virtual robot; drawn from `seed` where not given.
    rate
        Samples a second.
    noise
        A, standard deviation of every joint's noise; 0 leaves out noise and quantisation. The truth's own where not
        given.
    runs_per_file
        Planned motions in one file.
    has_velocity
        Whether the log has velocities.
    has_temperature
        Whether the log has the motors' temperatures; it has them anyway where something hidden depends on them.
    physics
        ``"builtin"``: every joint by itself; ``"mujoco"``: rigid bodies, which push each other.

    Returns
    -------
    logs
        Batches in order of time; batches of one file share their `origin` (``session_01`` ...).

    Raises
    ------
    ModelError [plan-misfit]
        The plan is for another number of joints, or has a speed that is none.
    ModelError [rate-impossible]
        The rate is below 1 Hz, or beyond that of any drive.
    ModelError [physics-wrong]
        Rigid-body physics cannot be had of this robot or on this machine.
    ModelError [simulation-diverged]
        While the logs are read: the controller does not hold this arm.

    Examples
    --------
    >>> from pumaid.simulation import table1
    >>> truth = table1.puma560()
    >>> first = next(simulate(truth.robot, table1.experiment(), truth=truth, seed=1))
    >>> first.origin, first.current.shape[1]
    ('session_01', 6)
    """
    if not SLOWEST <= rate <= FASTEST:
        mend = f"give a rate of {SLOWEST:g} to {FASTEST:g} Hz"
        raise ModelError("rate-impossible", f"a log cannot have {rate:g} samples a second", mend=mend)
    for number, motion in enumerate(plan.motions, start=1):
        if len(motion.hold) != robot.n_joints or not 1 <= motion.joint <= robot.n_joints:
            raise ModelError(
                "plan-misfit",
                f"run {number} of the plan moves joint {motion.joint} of {len(motion.hold)}; "
                f"{robot.name} has {robot.n_joints} joints",
                Where(field=f"runs[{number}]"),
                "take a plan made for this robot: pumaid plan",
            )
        if not 0.0 < motion.velocity < math.inf:
            what = f"run {number} of the plan has the speed {motion.velocity:g}"
            raise ModelError("plan-misfit", what, Where(field=f"runs[{number}].velocity"), "speeds are positive")
    robot_truth = draw(robot, seed) if truth is None else truth
    if noise is not None:
        robot_truth = robot_truth.with_noise(noise)
    session = Session(
        robot_truth,
        plan,
        np.random.default_rng([seed, 2]),
        rate=rate,
        runs_per_file=runs_per_file,
        has_velocity=has_velocity,
        has_temperature=has_temperature,
        physics=physics,
    )
    return _held(session.logs(), robot)


def _held(logs: Iterator[Log], robot: Robot) -> Iterator[Log]:
    """The logs, as long as the arm stays where an arm can be."""
    while True:
        with np.errstate(all="ignore"):  # what overflows is told here, once
            log = next(logs, None)
        if log is None:
            return
        far = ~(np.abs(log.position) <= _FARTHEST) | ~(np.abs(log.current) <= _MOST)
        if far.any():
            row, j = np.argwhere(far)[0]
            what = f"joint {j + 1} ({robot.joint(int(j) + 1).name}) ran away at {log.time[row]:.3g} s of {log.origin}"
            mend = "make smaller what is out of proportion: hidden effects, coupling, or an edited truth"
            raise ModelError("simulation-diverged", what, Where(joint=int(j) + 1), mend)
        yield log
