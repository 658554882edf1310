"""Gravity by the static test, which the paper rejects, against gravity by identification, on a PUMA 560 in MuJoCo.

python docs/gallery/static_test.py              one robot
python docs/gallery/static_test.py --robots 5
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

import numpy as np
import puma
from numpy.typing import NDArray
from puma import DEG, SIDE, TICK, Arm, Drive, pd, recipe

import pumaid
from pumaid.exports import export

Floats = NDArray[np.float64]

#: Joint -> postures (deg) in which its gravity is asked for.
POSTURES = {
    2: [(0, -150, 90, 0, 0, 0), (0, -90, 90, 0, 0, 0), (0, -45, 90, 0, 0, 0), (0, 0, 90, 0, 0, 0)],
    3: [(0, -90, 0, 0, 0, 0), (0, -90, 45, 0, 0, 0), (0, -90, 90, 0, 0, 0), (0, -90, 135, 0, 0, 0)],
    5: [(0, -90, 0, 0, -60, 0), (0, -90, 0, 0, 0, 0), (0, -90, 0, 0, 60, 0), (0, -90, 90, 0, 60, 0)],
}
#: A/s by which the current is raised, rad at which the joint has broken away, s in which the arm is brought to rest.
RISE, AWAY, REST = 0.3, 0.1 * DEG, 1.5


class Bench:
    """An arm at a posture, held by the controller, but for the joint whose current is raised by hand."""

    def __init__(self, robot: Arm, posture: Sequence[float]) -> None:
        self.place = np.array(posture) * DEG
        self.drive, self.integral, self.seconds = Drive(robot, self.place), np.zeros(6), 0.0

    def held(self) -> Floats:
        """(6,) A of a PI controller that brings every joint back to its place."""
        error = self.place - self.drive.position
        self.integral = np.clip(self.integral + 4000.0 * TICK * error, -5.0, 5.0)
        return pd(self.drive, error, np.zeros(6), k_p=400.0) + SIDE * self.integral

    def breaks(self, joint: int, way: float) -> float:
        """A at which the joint moves off, its current raised from what holds it in the direction `way` (+1 or -1)."""
        for _ in range(round(REST / TICK)):
            given = self.drive.step(self.held())
        current = float(given[joint - 1])
        start, kept = self.drive.position[joint - 1], self.integral[joint - 1]
        while abs(self.drive.position[joint - 1] - start) < AWAY:
            current += SIDE[joint - 1] * way * RISE * TICK
            asked = self.held()
            asked[joint - 1] = current
            self.drive.step(asked)
            self.integral[joint - 1] = kept
            self.seconds += TICK
        self.seconds += REST
        return current


def gravity(robot: Arm, joint: int, posture: Sequence[float]) -> tuple[float, float]:
    """A by the static test: half the sum of both directions, each from a fresh start; s that it takes."""
    both = [Bench(robot, posture) for _ in range(2)]
    return 0.5 * (both[0].breaks(joint, 1.0) + both[1].breaks(joint, -1.0)), both[0].seconds + both[1].seconds


def logged(robot: Arm) -> pumaid.Dataset:
    """The runs of the robot's own experiment."""
    with tempfile.TemporaryDirectory() as folder:
        log = pumaid.LogReader(puma.record(robot, Path(folder)), recipe())
        return pumaid.segment(log, recipe())


def errors(robot: Arm, dataset: pumaid.Dataset) -> tuple[dict[int, Floats], float]:
    """Joint -> (P, 2) A by which the static test and the model of `dataset` miss gravity; s that the tests take."""
    program = ModuleType("puma_model")
    exec(export(pumaid.identify(dataset, recipe()), recipe(), form="python").files[".py"], vars(program))
    out, seconds = {}, 0.0
    for joint, postures in POSTURES.items():
        rows = []
        for posture in postures:
            at = np.array(posture) * DEG
            true = robot.truth.gravity_current(at[None])[0, joint - 1]
            static, took = gravity(robot, joint, posture)
            rows.append([static - true, program.gravity(at)[joint - 1] - true])
            seconds += took
        out[joint] = np.array(rows)
    return out, seconds


def unevenness(robot: Arm, joint: int) -> float:
    """A: half the sum of Coulomb friction forward and backward, each signed."""
    friction = robot.truth.friction
    return 0.5 * float(friction.coulomb_plus[joint - 1] + friction.coulomb_minus[joint - 1])


def table(robot: Arm, found: dict[int, Floats]) -> list[str]:
    """Lines of RMS errors, and of what the static test must take for gravity."""
    lines = ["gravity missed by, RMS (A)   static test   identified   unevenness of friction"]
    for joint, rows in found.items():
        rms = np.sqrt(np.mean(rows**2, axis=0))
        lines.append(f"joint {joint}{rms[0]:33.3f}{rms[1]:13.3f}{abs(unevenness(robot, joint)):25.3f}")
    return lines


def main() -> None:
    """Run what the command line asks for."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--robots", type=int, default=1)
    for seed in range(1, options.parse_args().robots + 1):
        robot = puma.arm(seed)
        found, static = errors(robot, logged(robot))
        moving = sum(way.seconds for way in puma.ways())
        print(f"robot {seed}: static tests of 12 postures {static:.0f} s, experiment for all six joints {moving:.0f} s")
        print("\n".join(table(robot, found)), flush=True)


if __name__ == "__main__":
    main()
