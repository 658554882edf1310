"""The sheet of parameters: what is told as known, how well, and what is not told."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from worlds import CRANE, STANFORD, dataset, drawn, experiment, fit_runs, only, puma, truth_in_units

from pumaid.dataset import Campaign, Dataset
from pumaid.estimation.covariance import recursion_covariance
from pumaid.estimation.estimate import identify
from pumaid.estimation.identifiability import Sheet, _gradient
from pumaid.joint_bins import samples_of
from pumaid.maths.bilinear import Gains
from pumaid.model import Model
from pumaid.robot import Joint, Robot
from pumaid.simulation import Bench, table1

PUMA = puma()
BENCH = Bench(PUMA, table1.experiment(), rate=50.0)
ESTIMATE = identify(Dataset(BENCH.runs(np.random.default_rng(1))), PUMA.robot)


def test_every_parameter_and_ratio_is_told_once():
    """Six joints have four friction terms each, two constants a link, five ratios: all there, known or not."""
    names = [value.name for value in ESTIMATE.values]
    assert len(names) == len(set(names)) == 24 + 12 + 5


def test_open_parameters_have_no_number_and_a_reason():
    """What is not identified has a reason instead of a value, and what is has no reason."""
    for value in ESTIMATE.values:
        is_known = value.state == "identified"
        assert (value.value is None, value.std_error is None, value.ci95 is None) == (not is_known,) * 3
        assert bool(value.reason) is not is_known


def test_intervals_are_students():
    """The interval is Student's with the degrees of freedom told."""
    for value in ESTIMATE.values:
        if value.state == "identified":
            wanted = stats.t(value.dof, value.value, value.std_error).interval(0.95)
            assert value.ci95 == pytest.approx(wanted, rel=1e-9)


def test_ratio_of_an_unfelt_link_is_not_told():
    """The paper's eta_5/eta_6: link 6 is too light, in amperes, and a payload is asked for."""
    value = ESTIMATE.value("gain_ratio.5.6")
    assert value.state == "not_identifiable" and "link 6 is too light to be felt by joint 5" in value.reason
    assert "payload" in value.next_run


def test_ratios_over_two_branches_have_the_slope_of_their_edges():
    """The ratio's derivative by every edge is a finite difference's, also across branches."""

    def forest(edges) -> Gains:
        gains = Gains(5)
        for (upper, lower), ratio in zip([(1, 3), (0, 1), (0, 2), (2, 4)], edges, strict=True):
            gains.merge(upper, lower, ratio)
        return gains

    edges = np.array([0.5, -1.5, 2.0, 3.0])
    order = [forest(edges).edges.index(lower) for lower in (3, 1, 2, 4)]
    for row in range(5):
        for other in range(5):
            value, slope = _gradient(forest(edges), row, other)
            assert value == pytest.approx(forest(edges).ratio(row, other))
            for place, number in enumerate(order):
                step = np.eye(4)[place] * 1e-6
                ahead, back = (forest(edges + sign * step).ratio(row, other) for sign in (1, -1))
                assert slope[number] == pytest.approx((ahead - back) / 2e-6, abs=1e-6)


def test_ratio_between_clusters_has_no_slope():
    """Rows of different clusters have no ratio, and nothing to differentiate."""
    value, slope = _gradient(Gains(3), 0, 2)
    assert np.isnan(value) and slope.size == 0


def test_neighbours_over_a_slide_come_from_edges_over_it():
    """In an arm with a slide in between, where inner rows tie both, neighbours' ratios are still told rightly."""
    truth = drawn(STANFORD)
    estimate = identify(dataset(truth, experiment(STANFORD), seed=3), STANFORD)
    known = truth.parameters()
    for name in ("gain_ratio.2.3", "gain_ratio.3.4"):
        value = estimate.value(name)
        assert abs(value.value - known[name]) < 4 * value.std_error


def test_errors_are_the_spread_of_estimates():
    """Standard errors told on average are the spread of values over 30 experiments."""
    truth, plan = drawn(CRANE), experiment(CRANE)
    bench = Bench(truth, plan, rate=50.0)
    estimates = [identify(Dataset(bench.runs(np.random.default_rng(n))), CRANE) for n in range(30)]
    names = [v.name for v in estimates[0].values if all(e.value(v.name).state == "identified" for e in estimates)]
    spread = np.std([[e.value(n).value for n in names] for e in estimates], axis=0, ddof=1)
    told = np.sqrt(np.mean([[e.value(n).std_error ** 2 for n in names] for e in estimates], axis=0))
    assert len(names) >= 18
    # Each spread is known to 13 %; 18 of them, four standard deviations.
    assert np.max(np.abs(np.log(told / spread))) < 0.55
    assert np.mean(told / spread) == pytest.approx(1.0, abs=0.1)


def test_a_parameter_not_told_apart_names_its_partners():
    """Without joint 3 of the PUMA's outer four, what is tied is named, in parameters of the model."""
    estimate = identify(dataset(PUMA, only(table1.experiment(), lambda motion: motion.joint == 3)), PUMA.robot)
    reason = estimate.value("gravity.l3.x").reason
    assert reason.startswith("only determined together with gravity.l4.x") and "coulomb" not in reason


def test_blind_directions_change_no_fitted_run():
    """Moving along what is blind, at plausible size, changes no current of the runs that were fitted."""
    found = dataset(PUMA, only(table1.experiment(), lambda motion: motion.joint in (3, 6)))
    estimate = identify(found, PUMA.robot)
    model = Model.of_estimate(PUMA.robot, estimate)
    assert estimate.blind.shape[1] > 0
    for run in found.runs:
        scales = np.nan_to_num(estimate.scales[run.joint - 1])[model.owners - 1]
        rows = model.regressor(samples_of(run, Campaign.of([run]))) * scales
        assert np.abs(rows @ estimate.blind).max(initial=0.0) < 0.02 * np.abs(run.bins.current).max()


def test_covariance_is_symmetric_and_no_variance_negative():
    """Whatever mixture of clustered and modelled variances it is made of."""
    for estimate in (ESTIMATE, identify(dataset(drawn(CRANE), experiment(CRANE, postures=1)), CRANE)):
        assert estimate.covariance == pytest.approx(estimate.covariance.T, rel=1e-9, abs=1e-18)
        assert np.all(np.diag(estimate.covariance) >= 0.0)


def test_sheet_of_the_recursion_has_its_own_ratios():
    """Where the recursion leaves a ratio open that the joint fit carries along, its sheet does not mix them up."""
    holds: dict[int, tuple] = {}
    for motion in table1.experiment().motions:
        holds.setdefault(motion.joint, motion.hold)
    runs = dataset(PUMA, only(table1.experiment(), lambda motion: motion.hold == holds[motion.joint])).runs
    fitted = fit_runs(PUMA.robot, runs)
    assert len(fitted.first.solution.gains.edges) < len(fitted.gains.edges)
    first = recursion_covariance(
        fitted.first.system, fitted.first.solution.values, fitted.first.solution.gains, runs=fitted.run_of
    )
    values = {value.name: value for value in Sheet.of_recursion(fitted, runs, first).values()}
    assert values["gain_ratio.2.3"].state == values["gravity.l2.x"].state == "not_identifiable"
    assert values["gravity.l6.x"].state == "identified"


@pytest.mark.parametrize("missing", [2, 4, 5, 6])
def test_recursion_tells_no_ratio_of_a_load_left_open(missing):
    """Where an outer row left its load open, an inner row's ratio to it rests on a guess and is not told."""
    truth = drawn(STANFORD, noisy=False)
    plan = only(experiment(STANFORD, postures=2), lambda motion: motion.joint != missing)
    estimate = identify(dataset(truth, plan), STANFORD, recursive=True)
    known = truth_in_units(truth, range(1, 7))
    told = {value.name: value.value for value in estimate.values if value.name.startswith("gain") and value.value}
    assert {name: value for name, value in told.items() if abs(value - known[name]) > 1e-9} == {}


def test_a_ratio_beyond_a_joint_that_carries_nothing():
    """On a SCARA whose slide keeps its angle to gravity, eta2/eta4 is told though eta2/eta3 and eta3/eta4 are not."""
    twists = (0.0, 0.0, np.pi, 0.0)
    kinds = ("revolute", "revolute", "prismatic", "revolute")
    joints = tuple(
        Joint(n, f"j{n}", kind, alpha=twist, a=0.3, d=0.1)
        for n, (kind, twist) in enumerate(zip(kinds, twists, strict=True), start=1)
    )
    robot = Robot("SCARA on a slope", joints, gravity=(6.9, 0.0, -6.9))
    truth = drawn(robot, noisy=False)
    known = truth.parameters()
    found = identify(dataset(truth, experiment(robot)), robot)
    assert [found.value(f"gain_ratio.{pair}").state for pair in ("2.3", "3.4")] == ["not_identifiable"] * 2
    product = known["gain_ratio.2.3"] * known["gain_ratio.3.4"]
    assert found.value("gain_ratio.2.4").value == pytest.approx(product, rel=1e-8)
