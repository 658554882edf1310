"""A model against measurement: on logs that it was fitted to, or on any others."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import Note
from pumaid.files.result import check_same_recipe
from pumaid.model import Block, Model
from pumaid.motion.replicates import noise_floor
from pumaid.records import (
    UNEXPLAINED,
    Cells,
    Comparison,
    Estimate,
    Evidence,
    JointScore,
    OutsideScore,
    Robot,
    Run,
    RunScore,
    Samples,
)

Floats = NDArray[np.float64]

#: Share of the largest term in an undetermined direction below which a term is not named.
PART = 0.05

#: Instants whose regressor is made at once: enough to spare calls, some ten megabytes.
AT_ONCE = 20_000

#: A (A) below which a contribution is rounding.
NOTHING = 1e-9

#: Outside runs a joint counts as moving above this share of its largest speed in the stretch: below it the direction of
#: friction is not known.
MOVING = 0.05


def compare(estimate: Estimate, evidence: Evidence, robot: Robot) -> Comparison:
    """Score a model on logs: per joint and per run, and apart from these what lies outside runs.

    A run's RMSE and bias are exact over its samples; predictions and their parts are given at its cells. Runs that the
    plan holds out are scored apart.

    Parameters
    ----------
    estimate
        The model.
    evidence
        Of any logs of the same arm.
    robot
        The arm, by the recipe that the model was made with.

    Returns
    -------
    comparison
        With a flag on each run of which the fitted data could not tell enough to predict it.

    Raises
    ------
    ModelError [model-other-recipe]
        The model was identified with another recipe.

    Source
    ------
    S.-K. Lin, section IV: the estimated against the measured current, and the standard deviation in Table I.
    """
    check_same_recipe(estimate, robot)
    judge = Judge(Model.of_estimate(robot, estimate), estimate)
    fitted_files = {facts.name for facts in evidence.files if facts.digest in set(estimate.logs.values())}
    known = [not run.heldout and run.origin in fitted_files for run in evidence.runs]
    tallies = [judge.tally(block) for block in judge.model.blocks(evidence.runs)]
    means = {joint: _mean([t for t in tallies if t.run.joint == joint]) for joint in {t.run.joint for t in tallies}}
    rows = judge.rows([judge.model.samples_of(run) for run in evidence.runs])
    scores = [
        judge.score(tally, row, mean=means[tally.run.joint], is_fitted=was)
        for tally, row, was in zip(tallies, rows, known, strict=True)
    ]
    joints = tuple(_of_joint(joint.number, tallies, scores) for joint in robot.joints)
    counted = [tally for joint in robot.joints for tally in _counted(joint.number, tallies)]
    return Comparison(
        robot=robot.name,
        joints=joints,
        runs=tuple(scores),
        outside=judge.outside(evidence),
        rmse=_rmse(counted),
        logs={facts.name: facts.digest for facts in evidence.files},
        notes=tuple(_notes(estimate, evidence, joints)),
        heldout=_rmse([tally for tally in tallies if tally.run.heldout]),
        recipe_digest=robot.digest,
        version=estimate.version,
    )


@dataclass(frozen=True, slots=True)
class Tally:
    """A run's sums over its samples: of squares of the residual and the current (A2), of both themselves (A).

    `products` maps an effect to the sum of measured current times its part of the prediction (A2).
    """

    run: Run
    samples: int
    squares: float
    total: float
    current_squares: float
    current_total: float
    products: dict[str, float]


@dataclass(frozen=True, eq=False, slots=True)
class Judge:
    """A model with the values that it is judged with."""

    model: Model
    estimate: Estimate

    def scaled(self, joint: int) -> Floats:
        """(p,) what each parameter counts in joint `joint`: value times ratio of gains, 0 where that is unknown."""
        return np.nan_to_num(self.estimate.scales[joint - 1])[self.model.owners - 1] * self.estimate.solution

    def effects(self) -> dict[str, NDArray[np.bool_]]:
        """Effect -> (p,) which parameters are its own, in the model's order."""
        names = [column.effect for column in self.model.columns]
        return {name: np.array([other == name for other in names]) for name in dict.fromkeys(names)}

    def tally(self, block: Block) -> Tally:
        """Sums over all samples of a run, from its equations alone."""
        weights = self.scaled(block.run.joint)
        residual = block.target - block.regressors @ weights
        products = {
            name: float(block.target @ (block.regressors[:, own] @ weights[own]))
            for name, own in self.effects().items()
        }
        return Tally(
            run=block.run,
            samples=block.samples,
            squares=float(residual @ residual) + block.rest,
            total=float(block.ones @ residual),
            current_squares=float(block.target @ block.target) + block.rest,
            current_total=float(block.ones @ block.target),
            products=products,
        )

    def rows(self, many: Sequence[Samples]) -> Iterator[Floats]:
        """The regressor (M, p) of each of `many`; neighbours of one joint are looked at together, which is quicker."""
        start = 0
        while start < len(many):
            end, instants = start, 0
            while end < len(many) and many[end].joint == many[start].joint and instants < AT_ONCE:
                instants += len(many[end])
                end += 1
            together = self.model.regressor(_joined(many[start:end]))
            yield from np.split(together, np.cumsum([len(samples) for samples in many[start:end]])[:-1])
            start = end

    def score(self, tally: Tally, rows: Floats, *, mean: float, is_fitted: bool) -> RunScore:
        """A run's figures and its prediction at cells, whose regressor `rows` (M, p) is."""
        run, weights = tally.run, self.scaled(tally.run.joint)
        parts = {name: rows[:, own] @ weights[own] for name, own in self.effects().items() if rows[:, own].any()}
        predicted = rows @ weights
        about = tally.current_squares - 2.0 * mean * tally.current_total + tally.samples * mean**2
        reason = self._undetermined(run, rows, is_fitted=is_fitted)
        residual = run.cells.current[:, run.joint - 1] - predicted
        return RunScore(
            run=run,
            rmse=float(np.sqrt(tally.squares / tally.samples)),
            bias=tally.total / tally.samples,
            largest=float(np.max(np.abs(residual), initial=0.0)),
            predicted=predicted,
            undetermined=reason is not None,
            reason=reason,
            explained=1.0 - tally.squares / about if about > NOTHING**2 * tally.samples else None,
            parts=parts,
        )

    def _undetermined(self, run: Run, rows: Floats, *, is_fitted: bool) -> str | None:
        """Why the fitted data cannot tell what `run` should draw, or None where they can."""
        if is_fitted:
            return None
        scale = self.estimate.scales[run.joint - 1][self.model.owners - 1]
        if self.model.is_foreign(run):
            stand_in = any(joint == run.joint for joint, _ in self.estimate.stroke_postures)
            instead = "that of the nearest posture stands in" if stand_in else "none is counted"
            return f"the inertia of joint {run.joint} in this posture was not identified; {instead}"
        unknown = np.isnan(scale) & (np.abs(rows * self.estimate.solution).max(axis=0, initial=0.0) > NOTHING)
        if unknown.any():
            link = int(self.model.owners[np.flatnonzero(unknown)[0]])
            return (
                f"eta{run.joint}/eta{link} was not determined: what link {link} weighs on joint {run.joint} is known"
                " only for the postures that were fitted"
            )
        used = rows * np.nan_to_num(scale)
        off = np.sqrt(np.mean((used @ self.estimate.blind) ** 2, axis=0))
        if float(np.linalg.norm(off)) <= max(self.estimate.joint(run.joint).rmse or 0.0, NOTHING):
            return None
        size = np.sqrt(np.mean((used * self.estimate.blind[:, int(np.argmax(off))]) ** 2, axis=0))
        names = [self.model.names[k] for k in np.argsort(-size)[:3] if size[k] > PART * size.max()]
        return f"this run needs {' and '.join(names)}, which the fitted data do not determine"

    def outside(self, evidence: Evidence) -> tuple[OutsideScore, ...]:
        """Scores of what is no run, by joint and reason; cells in which a joint rests are not its own."""
        stretches = [
            (joint, reject.reason, reject.cells)
            for reject in evidence.rejects
            for joint in reject.joints
            if reject.cells is not None
        ]
        stretches.sort(key=lambda stretch: stretch[:2])
        seen = [_moving(cells, joint) for joint, _, cells in stretches]
        many = [_ramp(cells, joint, keep) for (joint, _, cells), keep in zip(stretches, seen, strict=True)]
        found: dict[tuple[int, str], list[tuple[Floats, Floats]]] = {}
        for (joint, reason, cells), keep, rows in zip(stretches, seen, self.rows(many), strict=True):
            residual = cells.current[keep, joint - 1] - rows @ self.scaled(joint)
            found.setdefault((joint, reason), []).append((cells.count[keep].astype(float), residual))
        out = []
        for (joint, reason), pieces in found.items():
            counts = np.concatenate([count for count, _ in pieces])
            residual = np.concatenate([values for _, values in pieces])
            if counts.sum() > 0:
                rmse = float(np.sqrt(np.average(residual**2, weights=counts)))
                bias = float(np.average(residual, weights=counts))
                out.append(OutsideScore(joint, reason, int(counts.sum()), rmse, bias))
        return tuple(out)


def _moving(cells: Cells, joint: int) -> NDArray[np.bool_]:
    """(M,) whether `joint` moves, and its current is measured."""
    speed = np.abs(cells.velocity[:, joint - 1])
    return np.isfinite(cells.current[:, joint - 1]) & (speed > MOVING * np.max(speed, initial=0.0))


def _ramp(cells: Cells, joint: int, keep: NDArray[np.bool_]) -> Samples:
    """The cells `keep` as what effects see of `joint`; without acceleration, since inertia is missing by design."""
    velocity = cells.velocity[keep]
    return Samples(
        joint,
        cells.position[keep],
        velocity,
        acceleration=np.zeros(len(velocity)),
        direction=np.sign(velocity[:, joint - 1]),
        time=cells.time[keep] - cells.time[0],
        travel=np.abs(cells.position[keep, joint - 1] - cells.position[0, joint - 1]),
        temperature=np.full(len(velocity), np.nan),
    )


def _joined(many: Sequence[Samples]) -> Samples:
    """Samples of one joint one after another; `run` counts them from 0."""
    if len(many) == 1:
        return many[0]
    names = ("position", "velocity", "acceleration", "direction", "time", "travel", "temperature", "load")
    fields = {name: np.concatenate([getattr(samples, name) for samples in many]) for name in names}
    run = np.repeat(np.arange(float(len(many))), [len(samples) for samples in many])
    return Samples(many[0].joint, **fields, run=run)


def _mean(tallies: Sequence[Tally]) -> float:
    return sum(t.current_total for t in tallies) / sum(t.samples for t in tallies)


def _rmse(tallies: Sequence[Tally]) -> float | None:
    samples = sum(tally.samples for tally in tallies)
    return float(np.sqrt(sum(tally.squares for tally in tallies) / samples)) if samples else None


def _counted(joint: int, tallies: Sequence[Tally]) -> list[Tally]:
    """Runs of a joint behind its figures: those that are not held out, or all where all are."""
    own = [tally for tally in tallies if tally.run.joint == joint]
    return [tally for tally in own if not tally.run.heldout] or own


def _of_joint(joint: int, tallies: Sequence[Tally], scores: Sequence[RunScore]) -> JointScore:
    own = _counted(joint, tallies)
    heldout = [tally for tally in tallies if tally.run.joint == joint and tally.run.heldout]
    if not own:
        return JointScore(joint, 0, 0, None, None, None, None, f"joint {joint} never moves alone in these logs")
    samples, squares = sum(t.samples for t in own), sum(t.squares for t in own)
    current, mean = sum(t.current_squares for t in own), _mean(own)
    about = current - samples * mean**2
    floor, why = noise_floor([tally.run for tally in own])
    shares = {name: sum(t.products[name] for t in own) / current for name in own[0].products} if current > 0 else {}
    shares = {name: share for name, share in shares.items() if share != 0.0}
    return JointScore(
        joint=joint,
        runs=len(own),
        samples=samples,
        rmse=float(np.sqrt(squares / samples)),
        bias=sum(t.total for t in own) / samples,
        explained=1.0 - squares / about if about > NOTHING**2 * samples else None,
        noise_floor=floor,
        noise_floor_reason=why,
        rms=float(np.sqrt(current / samples)),
        shares=shares | {UNEXPLAINED: 1.0 - sum(shares.values())} if shares else {},
        heldout_runs=len(heldout),
        heldout=_rmse(heldout),
        undetermined=sum(score.undetermined for score in scores if score.run.joint == joint),
    )


def _notes(estimate: Estimate, evidence: Evidence, joints: Sequence[JointScore]) -> list[Note]:
    notes = list(evidence.notes)
    digests = {facts.digest for facts in evidence.files}
    seen = digests & set(estimate.logs.values())
    if digests and seen == digests and not any(joint.heldout_runs for joint in joints):
        which = "the log was" if len(seen) == 1 else f"all {len(seen)} logs were"
        text = (
            f"{which} fitted, so the error is what is left after fitting;"
            " logs that the model never saw show what it predicts"
        )
        notes.append(Note("compared-with-fitted", text))
    lost = sum(joint.undetermined for joint in joints)
    if lost:
        text = (
            f"{lost} runs need something that the fitted logs did not determine; their error says little of the model"
        )
        notes.append(Note("prediction-undetermined", text))
    return notes
