"""The sheet of parameters: what is told as known, how well, and what is not told."""

import numpy as np
import pytest
import table1
from monte_carlo import Bench
from scipy import stats
from worlds import CRANE, PENDULUM, STANFORD, arm, dataset, drawn, experiment, only, puma, truth_in_units

from pumaid.dataset import Dataset, first_motions
from pumaid.estimation.estimate import identify
from pumaid.joint_bins import samples_of
from pumaid.model import Model

PUMA = puma()
BENCH = Bench(PUMA, table1.experiment(), rate=50.0)
ESTIMATE = identify(Dataset(BENCH.runs(np.random.default_rng(1))), PUMA.robot)


def test_a_parameter_has_an_interval_or_a_reason():
    """What is not identified has a reason instead of a value; what is has Student's interval with its freedoms."""
    for value in ESTIMATE.values:
        is_known = value.state == "identified"
        assert (value.value is None, value.std_error is None, value.ci95 is None) == (not is_known,) * 3
        assert bool(value.reason) is not is_known
        if is_known:
            wanted = stats.t(value.dof, value.value, value.std_error).interval(0.95)
            assert value.ci95 == pytest.approx(wanted, rel=1e-9)


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
        rows = model.regressor(samples_of(run, first_motions([run]))) * scales
        assert np.abs(rows @ estimate.blind).max(initial=0.0) < 0.02 * np.abs(run.bins.current).max()


@pytest.mark.parametrize("missing", [2, 5])
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
    robot = arm("RRPR", [0.0, 0.0, np.pi, 0.0], gravity=(6.9, 0.0, -6.9))
    truth = drawn(robot, noisy=False)
    known = truth.parameters()
    found = identify(dataset(truth, experiment(robot)), robot)
    assert [found.value(f"gain_ratio.{pair}").state for pair in ("2.3", "3.4")] == ["not_identifiable"] * 2
    product = known["gain_ratio.2.3"] * known["gain_ratio.3.4"]
    assert found.value("gain_ratio.2.4").value == pytest.approx(product, rel=1e-8)


TRUTH = drawn(PENDULUM)
ONE_POSTURE = experiment(PENDULUM, postures=1)
ONE_SPEED = experiment(PENDULUM, speeds=(0.5,))


def by_text(estimate) -> dict:
    return {total.text: total for total in estimate.combinations}


def test_load_in_one_posture():
    """In one posture the whole weight on the inner joint is told at two positions, and a reader can add it up."""
    estimate = identify(dataset(TRUTH, ONE_POSTURE, seed=2), PENDULUM)
    assert estimate.value("gain_ratio.1.2").state == "not_identifiable"
    found, position = by_text(estimate), np.tile(ONE_POSTURE.motions[0].hold, (2, 1))
    position[:, 0] = [0.0, np.pi / 2]
    wanted = TRUTH.gravity_current(position)[:, 0]
    for text, load in zip(("at position 0", "a quarter turn on"), wanted, strict=True):
        total = found[f"weight felt by joint 1 {text}"]
        assert abs(total.value - load) < 4 * total.std_error < 0.2
        assert total.unit == "A" and {name.split(".")[0] for name in total.terms} == {"gravity"}
        terms = [weight * estimate.solution[estimate.names.index(name)] for name, weight in total.terms.items()]
        assert total.value == pytest.approx(np.sum(terms), rel=1e-6)


@pytest.mark.parametrize("plan", [ONE_POSTURE, ONE_SPEED, experiment(PENDULUM)], ids=["posture", "speed", "all"])
def test_errors_are_the_spread_of_values_and_sums(plan):
    """Standard errors told, ratios' share included, are the spread of what is told over 20 experiments."""
    bench, told = Bench(TRUTH, plan, rate=50.0), []
    for seed in range(20):
        estimate = identify(Dataset(bench.runs(np.random.default_rng(seed))), PENDULUM)
        entries = [(total.text, total) for total in estimate.combinations]
        # Where sums are told, some parameters have errors as large as they are plausible.
        entries = entries or [(value.name, value) for value in estimate.values if value.state == "identified"]
        told.append({name: (entry.value, entry.std_error) for name, entry in entries})
    texts = [text for text in told[0] if all(text in one for one in told)]
    assert len(texts) >= (1 if plan is ONE_POSTURE else 4)
    values = np.array([[one[text] for text in texts] for one in told])
    ratio = np.sqrt(np.mean(values[:, :, 1] ** 2, axis=0)) / values[:, :, 0].std(axis=0, ddof=1)
    # A spread over 20 is known to 16 %, and six runs a joint make the errors themselves uncertain by a third.
    assert np.all((ratio > 0.55) & (ratio < 1.8))


def test_loads_say_where_the_other_joints_were():
    """Loads in several postures are told one by one, at most three, each the truth's in its posture."""
    truth = drawn(CRANE)
    plan = only(experiment(CRANE, postures=5), lambda motion: motion.joint == 1)
    found = by_text(identify(dataset(truth, plan, seed=5), CRANE))
    loads = {text: total for text, total in found.items() if text.startswith("weight felt by joint 1 at position 0")}
    holds = dict.fromkeys(motion.hold[1:] for motion in plan.motions)
    told = {f"others at (-, {', '.join(f'{place:.2f}' for place in hold)})": hold for hold in holds}
    assert 0 < len(loads) <= 3
    for text, total in loads.items():
        position = np.array([[0.0, *told[text.split(", ", 1)[1]]]])
        assert abs(total.value - truth.gravity_current(position)[0, 0]) < 5 * total.std_error
