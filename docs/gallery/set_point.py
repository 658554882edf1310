"""Set-point control (the paper's eq. 37 and Fig. 5) of a PUMA 560 in MuJoCo, with models identified from its own logs.

python docs/gallery/set_point.py                                          one robot, the paper's step
python docs/gallery/set_point.py --robots 5 --targets 6 -o set_point.csv  more of both, some minutes
python docs/gallery/set_point.py --read set_point.csv                     the same tables again
python docs/gallery/set_point.py --picture set_point.png
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np
import puma
from numpy.typing import NDArray
from puma import DEG, HOME, SIDE, TICK, Arm, Drive, recipe

import pumaid
from pumaid.exports import export

Floats = NDArray[np.float64]

#: The paper's step, deg, and its gains: A/rad and A s/rad.
TARGET = (50.0, 40.0, 30.0, -30.0, -40.0, -50.0)
K_P, K_D = 100.0, 20.0
#: Eq. (36): what K_P asks for grows no further once a joint would go faster than this, rad/s.
FASTEST = 60.0 * DEG
#: s of a trial, and of its end over which the error is averaged.
SECONDS, END = 4.0, 0.3
#: The model's current is worked out afresh every so many ticks.
EVERY = 4
#: rad/s below which a motor counts as at rest; rad over which the push out of rest fades towards the target.
STILL, NEAR = 0.5 * DEG, 0.01 * DEG

RUNGS = ("PD alone", "+ gravity", "+ friction (20)", "+ wrist gears (38)-(40)", "+ Stribeck friction")


@dataclass(frozen=True)
class Trial:
    """A step: `time` (N,) s and the error (N, 6) rad that is left."""

    time: Floats
    error: Floats

    @property
    def left(self) -> Floats:
        """(6,) deg: size of the steady-state error."""
        return np.abs(self.error[self.time > SECONDS - END].mean(axis=0)) / DEG


class Compensation:
    """The current that a model says holds and moves the arm: eq. (20) and what was added, as ``pumaid export`` has it.

    Parameters
    ----------
    robot, estimate
        The recipe and the model.
    share
        What of the model's friction is given: 0 is gravity alone.
    pushes
        Whether a motor at rest is helped in the direction in which its target lies; the sign of its velocity says
        nothing then.
    """

    def __init__(
        self, robot: pumaid.Robot, estimate: pumaid.Estimate, *, share: float = 1.0, pushes: bool = True
    ) -> None:
        self.robot, self.share, self.pushes = robot, share, pushes
        self.program = ModuleType("puma_model")
        exec(export(estimate, robot, form="python").files[".py"], vars(self.program))

    def current(self, position: Floats, velocity: Floats, error: Floats) -> Floats:
        """(6,) A at (6,) measured rad and rad/s, with (6,) rad to go."""
        shaft, wanted = self.robot.shaft_velocity(np.array([velocity, error]))
        out = np.clip(wanted / NEAR, -1.0, 1.0) if self.pushes else np.zeros(6)
        toward = np.where(np.abs(shaft) < STILL, out, np.sign(shaft))
        rubs = self.program.friction(position, velocity, toward) if self.share else 0.0
        return np.asarray(self.program.gravity(position) + self.share * rubs)


def step(robot: Arm, target: Sequence[float], model: Compensation | None) -> Trial:
    """The arm goes from home to `target` (deg) by eq. (37) and stays there as well as it can."""
    drive, wanted = Drive(robot, HOME), np.array(target) * DEG
    errors, extra = [], np.zeros(6)
    for tick in range(round(SECONDS / TICK)):
        error = wanted - drive.position
        slowed = error * np.minimum(1.0, FASTEST / np.maximum(K_P / K_D * np.abs(error), 1e-12))
        if model is not None and tick % EVERY == 0:
            extra = model.current(drive.position, drive.velocity, error)
        drive.step(SIDE * (K_P * slowed - K_D * drive.velocity) + extra)
        errors.append(error)
    return Trial(TICK * np.arange(len(errors)), np.array(errors))


@dataclass(frozen=True)
class Ladder:
    """A robot, its own log and the runs of it, the paper's model of them, and what each rung adds to PD."""

    robot: Arm
    log: pumaid.Log
    dataset: pumaid.Dataset
    base: pumaid.Estimate
    models: tuple[Compensation | None, ...]

    @classmethod
    def of(cls, robot: Arm) -> Ladder:
        """Make the logs of `robot` and identify three models: plain, with coupled gears, with Stribeck friction."""
        plain, geared = recipe(coupled=False), recipe()
        with tempfile.TemporaryDirectory() as folder:
            (log,) = pumaid.LogReader(puma.record(robot, Path(folder)), geared)
            dataset = pumaid.segment([log], geared)
        base = pumaid.identify(dataset, plain)
        more = pumaid.identify(dataset, geared, effects=[pumaid.EffectChoice("stribeck")])
        models = (
            None,
            Compensation(plain, base, share=0.0),
            Compensation(plain, base),
            Compensation(geared, pumaid.identify(dataset, geared)),
            Compensation(geared, more),
        )
        return cls(robot, log, dataset, base, models)

    def tried(self, target: Sequence[float]) -> list[Trial]:
        """The step on every rung."""
        return [step(self.robot, target, model) for model in self.models]

    def dragged(self) -> list[tuple[int, int, float, float]]:
        """Joint that moves alone, motor behind it, RMS (A) by which the models without and with gears miss its current.

        The current of the motor is none that was fitted: friction is known from the runs of its own joint.
        """
        out = []
        for moving, motor in ((4, 5), (4, 6), (5, 6)):
            parts = [
                self.seen(run, motor) for run in self.dataset.runs if run.joint == moving and run.kind == "constant"
            ]
            measured, plain, geared = (np.concatenate(part) for part in zip(*parts, strict=True))
            out.append((moving, motor, *(float(np.sqrt(np.mean((measured - it) ** 2))) for it in (plain, geared))))
        return out

    def seen(self, run: pumaid.Run, motor: int) -> tuple[Floats, Floats, Floats]:
        """Current (A) of a motor whose joint is held during `run`: measured, by the model without and with gears."""
        # Bins hold the moving joint's current only; those of held ones are in the log.
        first, stop = np.searchsorted(self.log.rows, [run.first_row, run.last_row + 1])
        starts = first + np.cumsum(run.bins.count) - run.bins.count
        assert starts[-1] + run.bins.count[-1] == stop
        measured = np.add.reduceat(self.log.current[:stop, motor - 1], starts.astype(int)) / run.bins.count
        both = [model.program.current(run.bins.position, run.velocity) for model in self.models[2:4] if model]
        return measured, both[0][:, motor - 1], both[1][:, motor - 1]


def targets(count: int, seed: int) -> list[tuple[float, ...]]:
    """The paper's step and others, deg, each joint within 60 of home."""
    rng = np.random.default_rng([seed, 11])
    return [TARGET, *(tuple(np.round(HOME / DEG + rng.uniform(-60.0, 60.0, 6)).tolist()) for _ in range(count - 1))]


def table(left: Floats) -> list[str]:
    """Lines of (R, 6) steady-state errors, deg, rung by rung."""
    lines = [f"{'steady-state error (deg)':26s}" + "".join(f"{f'joint {j}':>9s}" for j in range(1, 7))]
    return lines + [f"{name:26s}" + "".join(f"{x:9.4f}" for x in row) for name, row in zip(RUNGS, left, strict=True)]


def summary(rows: Floats) -> list[str]:
    """Lines on (T, R, 6) errors of T trials: means, and how often a rung was no better than the one before."""
    trials, _, joints = rows.shape
    lines = [
        f"mean of {trials} steps:",
        *table(rows.mean(axis=0)),
        f"worst of {trials} steps:",
        *table(rows.max(axis=0)),
    ]
    lines.append(f"of {trials * joints} errors, a rung left")
    for k in range(1, len(RUNGS)):
        change = rows[:, k] - rows[:, k - 1]
        fewer, same = np.sum(change < -0.001), np.sum(np.abs(change) <= 0.001)
        lines.append(f"{RUNGS[k]:26s}{fewer:4d} smaller, {same:4d} as they were, {np.sum(change > 0.001):4d} larger")
    return lines


def wrist(rows: Sequence[tuple[int, int, float, float]]) -> list[str]:
    """Lines on the currents of motors whose joints are held."""
    lines = ["current of a held joint's motor, RMS of measured less predicted (A)"]
    for moving, motor, plain, geared in rows:
        lines.append(f"motor {motor} while joint {moving} moves   without gears {plain:.3f}   with gears {geared:.3f}")
    return lines


def write(path: Path, rows: Floats, places: Sequence[tuple[int, tuple[float, ...]]]) -> None:
    """Every trial's errors as CSV: robot, target (deg), rung, six errors (deg)."""
    lines = ["robot,target,rung," + ",".join(f"joint{j}" for j in range(1, 7))]
    for (seed, target), errors in zip(places, rows, strict=True):
        where = " ".join(f"{angle:g}" for angle in target)
        lines += [f"{seed},{where},{k}," + ",".join(f"{x:.4f}" for x in row) for k, row in enumerate(errors)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def read(path: Path) -> Floats:
    """(T, R, 6) errors, deg, as `write` wrote them."""
    lines = [line.split(",") for line in path.read_text(encoding="utf-8").splitlines()[1:]]
    return np.array([[float(x) for x in line[3:]] for line in lines]).reshape(-1, len(RUNGS), 6)


def main() -> None:
    """Run what the command line asks for."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--robots", type=int, default=1)
    options.add_argument("--targets", type=int, default=1)
    options.add_argument("-o", "--output", type=Path, help="CSV of every trial")
    options.add_argument("--read", type=Path, help="tables of a CSV of trials")
    options.add_argument("--picture", type=Path, help="figure of the first robot's step, with --read's trials")
    asked = options.parse_args()
    if asked.read is not None and asked.picture is None:
        print("\n".join(summary(read(asked.read))))
        return
    rows, places, ladder = [], [], None
    for seed in range(1, asked.robots + 1):
        ladder = Ladder.of(puma.arm(seed))
        for target in targets(asked.targets, seed):
            trials = ladder.tried(target)
            rows.append([trial.left for trial in trials])
            places.append((seed, target))
            print(f"robot {seed}, step to {' '.join(f'{angle:g}' for angle in target)} deg")
            print("\n".join(table(np.array(rows[-1]))), flush=True)
        print("\n".join(wrist(ladder.dragged())), flush=True)
    if asked.output is not None:
        write(asked.output, np.array(rows), places)
    if len(rows) > 1:
        print("\n".join(summary(np.array(rows))))
    if asked.picture is not None and ladder is not None:
        import set_point_picture

        many = np.array(rows) if asked.read is None else read(asked.read)
        set_point_picture.draw(asked.picture, ladder, ladder.tried(TARGET), many)


if __name__ == "__main__":
    main()
