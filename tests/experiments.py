"""Experiments repeated many times on virtual arms: do intervals hold, and is the error the least possible?"""

from dataclasses import replace
from functools import cache
from itertools import groupby
from pathlib import Path

import numpy as np
import table1
from monte_carlo import Bench
from worlds import fit_runs

from pumaid.dataset import Dataset, Log
from pumaid.estimate import Estimate
from pumaid.estimation.estimate import identify
from pumaid.estimation.fit import Fit
from pumaid.io.write import write_log
from pumaid.preprocessing.ingest import ingest
from pumaid.simulation import Noise, Truth, simulate
from pumaid.trajectory import Plan

#: Experiments of which errors are compared with the least possible.
COMPARED = 120
#: Seeds of these experiments start here; development used seeds below 20000.
SEEDS = 70_000


def white_errors(fitted: Fit) -> dict[str, float]:
    """Standard errors as if every sample were independent: what a plain least-squares program prints."""
    information = np.zeros((len(fitted.model.names) + len(fitted.gains.edges),) * 2)
    for row in fitted.joints:
        J = row.bare * np.sqrt(row.bins.count)[:, None]
        information += J.T @ J / row.rmse**2
    root = np.sqrt(np.diag(information))
    inverse = np.linalg.inv(information / np.outer(root, root)) / np.outer(root, root)
    return dict(zip(fitted.model.names, np.sqrt(np.diag(inverse)), strict=False))


def coverage(
    truth: Truth, bench: Bench, *, experiments: int, white: int = 0
) -> tuple[dict[str, float], dict[str, float]]:
    """Share of 95 % intervals that hold the truth, by parameter: ours, and of `white` experiments white-noise ones."""
    known = truth.parameters()
    ours: dict[str, list[bool]] = {}
    theirs: dict[str, list[bool]] = {}
    for seed in range(experiments):
        runs = bench.runs(np.random.default_rng(SEEDS + seed))
        estimate = identify(Dataset(runs), truth.robot)
        for value in estimate.values:
            if value.ci95 is not None:
                ours.setdefault(value.name, []).append(value.ci95[0] <= known[value.name] <= value.ci95[1])
        if seed < white:
            for name, error in white_errors(fit_runs(truth.robot, runs)).items():
                deviation = estimate.solution[estimate.names.index(name)] - known[name]
                theirs.setdefault(name, []).append(abs(deviation) <= 1.96 * error)
    shares = [{name: float(np.mean(hits)) for name, hits in found.items()} for found in (ours, theirs)]
    return shares[0], shares[1]


def bound(truth: Truth, plan: Plan, rate: float) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Names, true values and Cramer-Rao standard errors of parameters and neighbours' ratios, noise being white."""
    quiet = replace(truth, noise=Noise(np.zeros(truth.robot.n_joints)))
    runs = Bench(quiet, plan, rate=rate).runs(np.random.default_rng(0))
    fitted = fit_runs(truth.robot, runs)
    rows = []
    for row in fitted.joints:
        rows.append(row.bare * np.sqrt(row.bins.count)[:, None] / truth.noise.std[row.bins.joint - 1])
    J = np.vstack(rows)
    root = np.linalg.norm(J, axis=0)
    inverse = np.linalg.inv((J / root).T @ (J / root)) / np.outer(root, root)
    names = [*fitted.model.names, *(f"ratio of {edge + 1}" for edge in fitted.gains.edges)]
    exact = np.append(fitted.values, fitted.gains.ratios)
    return names, exact, np.sqrt(np.diag(inverse))


def losses(truth: Truth, plan: Plan, *, rate: float = 50.0) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Names, and RMS error over the bound of the joint fit and of the recursion, noise being white."""
    bench, (names, exact, least) = Bench(truth, plan, rate=rate), bound(truth, plan, rate)
    errors: dict[str, list[np.ndarray]] = {"joint": [], "first": []}
    for seed in range(COMPARED):
        runs = bench.runs(np.random.default_rng(SEEDS + seed))
        fitted = fit_runs(truth.robot, runs)
        assert fitted.first is not None
        for name, solution in (("joint", fitted.solution), ("first", fitted.first.solution)):
            errors[name].append(np.append(solution.values, solution.gains.ratios) - exact)
    joint_loss, first_loss = (np.sqrt(np.mean(np.square(of_method), axis=0)) / least for of_method in errors.values())
    return names, joint_loss, first_loss


@cache
def quiet_logs(rate: float) -> tuple[Log, ...]:
    """One session of the paper's experiment on the virtual PUMA, without noise of currents."""
    truth = table1.puma560()
    return tuple(simulate(truth.robot, table1.experiment(), seed=900, truth=truth.with_noise(0.0), rate=rate))


def logged(folder: Path, seed: int, *, rate: float = 100.0) -> Estimate:
    """Write the session's logs with the noise of `seed` in their currents to files, and identify from them."""
    truth, rng, logs = table1.puma560(), np.random.default_rng(seed), []
    for log in quiet_logs(rate):
        series = truth.noise.series(rng, log.current.shape, rate=rate, start=rng.standard_normal(6))
        noise = truth.noise.sample_std * series + truth.noise.level_std * rng.standard_normal(6)
        logs.append(replace(log, current=log.current + noise))
    paths = []
    for number, (origin, batches) in enumerate(groupby(logs, key=lambda log: log.origin)):
        paths.append(folder / f"{origin}.{'csv' if number % 2 else 'parquet'}")
        write_log(paths[-1], batches, truth.robot)
    return identify(ingest(paths, truth.robot), truth.robot)
