"""From runs to parameters: the n-to-1 identification, refined over all joints, with honest uncertainty."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pumaid import __version__
from pumaid.errors import LogError, Note, Where
from pumaid.fit.combinations import determined
from pumaid.fit.reasons import Facts
from pumaid.fit.sheet import Sheet
from pumaid.fit.rows import Row
from pumaid.fit.system import Fitted, Progress, solve
from pumaid.maths.propagation import recursion_covariance
from pumaid.maths.statistics import Clustered, clustered
from pumaid.model import Model
from pumaid.motion.replicates import noise_floor
from pumaid.records import Estimate, Evidence, JointFit, Robot, Run, Value
from pumaid.units import number

Floats = NDArray[np.float64]


def identify(
    evidence: Evidence, robot: Robot, *, recursive: bool = False, progress: Progress | None = None
) -> Estimate:
    """Identify the arm's parameters from runs.

    Rows are solved from the last joint to the first; then all rows are refined together. Held-out runs are left out.

    Parameters
    ----------
    evidence
        Runs of some or all joints.
    robot
        Geometry and gravity.
    recursive
        Stop after the recursion.
    progress
        Called with the joint at work (0: all) and a word on what is done.

    Returns
    -------
    estimate
        Every parameter of the minimal model, identified or not, with standard errors clustered by run.

    Raises
    ------
    LogError [no-runs]
        There is no run to fit.

    Source
    ------
    S.-K. Lin, "Identification of a Class of Nonlinear Deterministic Systems with Application to Manipulators".
    """
    runs = tuple(run for run in evidence.runs if not run.heldout)
    if not runs:
        number = len(evidence.runs) or len(evidence.rejects)
        what = ("run{}, all held out" if evidence.runs else "stretch{} left out").format
        kept = f"{number} {what('' if number == 1 else 's' if evidence.runs else 'es')}"
        raise LogError(
            "no-runs",
            f"there is no run to fit ({kept})",
            Where(file=evidence.files[0].name if evidence.files else None),
            "see why with: pumaid segment LOGS --rejects",
        )
    model = Model.of_runs(robot, runs)
    fitted = solve(model, runs, recursive=recursive, progress=progress)
    first = recursion_covariance(fitted.first_system, fitted.first_values, fitted.first_gains, runs=fitted.run_of)
    final = first if recursive else _joint_covariance(fitted)
    of_recursion = Sheet.of_recursion(fitted, runs, first)
    sheet = of_recursion if recursive else Sheet.of(fitted, runs, final)
    values = sheet.values()
    p = len(model.names)
    return Estimate(
        robot=robot.name,
        joints=tuple(_joint_fit(fitted, runs, joint) for joint in range(1, robot.n_joints + 1)),
        values=values,
        names=model.names,
        solution=fitted.solution.values,
        covariance=final.covariance[:p, :p],
        scales=_scales(fitted),
        blind=sheet.blind(),
        effects=robot.effects,
        combinations=determined(sheet),
        stroke_postures=model.stroke_postures,
        recursive=of_recursion.values(),
        method="recursive" if recursive else "joint",
        recipe_digest=robot.digest,
        origin=robot.origin,
        logs={facts.name: facts.digest for facts in evidence.files},
        notes=(*evidence.notes, *_notes(fitted, robot), *_odd_friction(values, robot.n_joints)),
        version=__version__,
    )


def _joint_covariance(fitted: Fitted) -> Clustered:
    """Clustered by run; jacobian rows of one run together."""
    order = [np.flatnonzero(fitted.run_of == number) for number in range(int(fitted.run_of.max()) + 1)]
    solution, inverse = fitted.solution, fitted.solution.linear.inverse
    found = clustered([solution.jacobian[rows] for rows in order], [solution.residual[rows] for rows in order], inverse)
    # What rests on the prior of a ratio is as uncertain as the prior says: no run's residual shows that.
    through = inverse[:, len(solution.values) :]
    return Clustered(found.covariance + (through * fitted.pull) @ through.T, found.freedoms)


def _scales(fitted: Fitted) -> Floats:
    """(J, J) eta_i / eta_j as the fit has them; NaN where unknown, 0 below the diagonal."""
    known = fitted.gains.scales()
    n = len(known)
    out = np.zeros((n, n))
    for i in range(n):
        for j in range(i, n):
            unit = int(fitted.assigned[j])
            out[i, j] = known[i, unit] if unit >= i else np.nan
    return out


def _row_of(fitted: Fitted, joint: int) -> Row | None:
    return next((row for row in fitted.rows if row.joint == joint), None)


def _joint_fit(fitted: Fitted, runs: Sequence[Run], joint: int) -> JointFit:
    row = _row_of(fitted, joint)
    if row is None:
        return JointFit(joint, 0, 0, None, None, f"joint {joint} never moves alone in these logs")
    scales = np.nan_to_num(fitted.gains.scales()[joint - 1])[fitted.system.owners]
    misfit = row.target - row.regressors @ (scales * fitted.solution.values)
    own = [run for run in runs if run.joint == joint]
    floor, why = noise_floor(own)
    kinds = {kind: sum(run.kind == kind for run in own) for kind in sorted({run.kind for run in own})}
    return JointFit(
        joint=joint,
        runs=len(own),
        samples=row.samples,
        rmse=float(np.sqrt((np.sum(misfit**2) + row.rest) / row.samples)),
        noise_floor=floor,
        noise_floor_reason=why,
        run_level=None if joint in fitted.weak else float(np.sqrt(fitted.levels[joint].level)),
        posture_groups=Facts.of(joint, runs).postures,
        kinds=kinds,
    )


def _odd_friction(values: Sequence[Value], n_joints: int) -> list[Note]:
    """Viscous terms that are surely of the sign opposite to their joint's Coulomb friction."""
    known = {
        value.name: (value.value, value.std_error, value.ci95, value.unit)
        for value in values
        if value.value is not None and value.std_error is not None and value.ci95 is not None
    }
    notes = []
    for joint, (side, way) in itertools.product(range(1, n_joints + 1), (("plus", "forward"), ("minus", "backward"))):
        if f"viscous.j{joint}.{side}" not in known:
            continue
        slope, error, (low, high), unit = known[f"viscous.j{joint}.{side}"]
        # Friction opposes motion, so the Coulomb terms tell the sign in which the motor counts its current.
        signs = {1.0: f"coulomb.j{joint}.plus", -1.0: f"coulomb.j{joint}.minus"}
        motor = sum(sign * known[name][0] for sign, name in signs.items() if name in known)
        if motor * slope < 0 and not low <= 0.0 <= high:
            text = (
                f"friction of joint {joint} falls with speed going {way} ({number(slope)} ± {number(error, 2)} {unit}),"
                " which viscous friction does not: something else changed with the speed, or Stribeck friction reigns"
            )
            notes.append(Note("friction-falls-with-speed", text, Where(joint=joint)))
    return notes


def _notes(fitted: Fitted, robot: Robot) -> list[Note]:
    notes = []
    for joint in sorted(fitted.weak):
        runs = len(next(row.runs for row in fitted.rows if row.joint == joint))
        notes.append(
            Note(
                "few-runs",
                f"joint {joint} has {runs} run{'s' if runs > 1 else ''} only: its intervals rest on the noise inside"
                " runs and leave out what a repeated run would differ by",
                Where(joint=joint),
            )
        )
    for joint in fitted.model.structure.embodied:
        notes.append(
            Note(
                "load-in-coulomb",
                f"the constant load of prismatic joint {joint} ({robot.joint(joint).name}) is part of its Coulomb"
                " terms",
                Where(joint=joint),
            )
        )
    return notes
