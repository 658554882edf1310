"""Cells of any motion: current and columns pass one filter, so least squares returns what made the torques."""

from dataclasses import replace

import numpy as np
import pytest
from free_motion import RATE as SAMPLED
from free_motion import TICKS, fourier, picks
from scipy import signal
from test_rigid_body import engine, torques
from worlds import TURN, arm

from pumaid.dataset import Dataset, Log
from pumaid.diagnosis.candidates import spectrum
from pumaid.diagnosis.diagnose import diagnose
from pumaid.effect_spec import chosen_by
from pumaid.estimation.estimate import identify
from pumaid.estimation.gls import fit_bins
from pumaid.estimation.noise import noise_of
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.joint_bins import joint_bins
from pumaid.model import Model
from pumaid.preprocessing.binning import SegmentOptions
from pumaid.preprocessing.parallel_filter import LONGEST_CELL, SHORTEST_CELL, cell_length, cells
from pumaid.preprocessing.segment import segment
from pumaid.rigid_body import base_parameters
from pumaid.robot import Joint, Robot

SECONDS, RATE = 30.0, 250.0


@pytest.mark.parametrize("length", [0.024, 0.1])
def test_one_filter_for_all_leaves_least_squares_the_truth(length):
    """The torque of exact accelerations is explained to the error of differences, however long the cells are."""
    rng = np.random.default_rng(2)
    robot = read_recipe(shipped_recipes()["puma560"])
    model, _ = engine(robot, rng)
    t, exact = fourier(rng, robot.n_joints, SECONDS, RATE)
    torque = torques(model, exact)
    table = cells(t, exact[0].T, torque.T, body=base_parameters(robot), length=length)
    assert table.step == pytest.approx(length, abs=0.5 / RATE)
    for joint in range(robot.n_joints):
        moving = np.isfinite(table.current[:, joint])
        columns, drawn = table.columns[joint][moving], table.current[moving, joint]
        left = drawn - columns @ np.linalg.lstsq(columns, drawn, rcond=None)[0]
        # Differences over 4 ms of motion up to 0.5 Hz are (2 pi 0.5 0.004)^2 / 12 off.
        assert np.sqrt(np.mean(left**2)) < 3e-5 * np.sqrt(np.mean(drawn**2))
        values = np.linalg.lstsq(columns, drawn, rcond=None)[0]
        whole = base_parameters(robot).rows(*exact)[joint].T @ values
        assert np.abs(whole - torque[joint]).max() < 1e-3 * np.abs(torque[joint]).max()


def test_cells_where_a_joint_may_stick_or_was_not_measured_have_no_current():
    """A current that is missing for one sample is missing in the three cells whose windows hold it."""
    rng = np.random.default_rng(5)
    robot = read_recipe(shipped_recipes()["pendulum2"])
    t, (q, rate, _) = fourier(rng, 2, SECONDS, RATE)
    current = np.ones_like(q.T)
    current[4000, 1] = np.nan
    table = cells(t, q.T, current, body=base_parameters(robot), length=0.04)
    missing = np.isnan(table.current[:, 1])
    inside = np.abs(table.time - t[4000]) < 1.3 * table.step
    assert missing[inside].all() and np.count_nonzero(missing & (np.abs(table.time - t[4000]) < 2 * table.step)) <= 3
    slow = np.array([np.abs(rate[0][np.abs(t - middle) < 0.06]).min() < 0.05 for middle in table.time])
    assert np.mean(np.isnan(table.current[:, 0]) == slow) > 0.98
    coarse = cells(t[::25], q.T[::25], current[::25], body=base_parameters(robot), length=0.1)
    for turn in t[1:][np.diff(np.sign(rate[0])) != 0.0][1:-1]:  # faster than 0.05 rad/s at the samples on either side
        assert np.isnan(coarse.current[np.abs(coarse.time - turn).argmin(), 0])


@pytest.mark.parametrize(("counts", "low", "high"), [(1e6, SHORTEST_CELL, 0.03), (2.5e3, 0.06, LONGEST_CELL)])
def test_coarse_encoders_get_longer_cells(counts, low, high):
    """What is left of an encoder's steps in the acceleration is a half percent of it, or the longest cell is taken."""
    rng = np.random.default_rng(6)
    t, (q, _, curve) = fourier(rng, 2, SECONDS, RATE)
    read = np.rint(q * counts) / counts
    length = cell_length(t, read.T, np.full(2, 1.0 / counts / np.sqrt(12.0)))
    assert low <= length <= high
    robot = read_recipe(shipped_recipes()["pendulum2"])
    table = cells(t, read.T, np.ones_like(read.T), body=base_parameters(robot), length=length)
    exact = cells(t, q.T, np.ones_like(read.T), body=base_parameters(robot), length=length)
    noise = np.std(table.acceleration - exact.acceleration) / np.std(curve)
    assert noise < 0.01


def test_coarse_steps_of_positions_leave_friction_its_size():
    """In steps of 0.01 rad at 100 Hz a sample's speed is a step or none; Coulomb friction was off by a fifth RMS."""
    robot, errors = read_recipe(shipped_recipes()["puma560"]), []
    for rng in map(np.random.default_rng, range(3)):
        t, exact = fourier(rng, robot.n_joints, 60.0, 100.0)
        torque = torques(engine(robot, rng)[0], exact)
        current = torque / torque.std(axis=1, keepdims=True) + 0.3 * np.sign(exact[1]) + 0.3 * exact[1]
        table = cells(t, np.round(exact[0].T, 2), current.T, body=base_parameters(robot), length=LONGEST_CELL)
        for speed, drawn, columns in zip(table.velocity.T, table.current.T, table.columns, strict=True):
            design, moving = np.column_stack([np.sign(speed), speed, columns]), np.isfinite(drawn)
            errors.append(np.linalg.lstsq(design[moving], drawn[moving], rcond=None)[0][0] / 0.3 - 1.0)
    assert np.sqrt(np.mean(np.square(errors))) < 0.15


@pytest.mark.parametrize("finest", [(), (1,)])
def test_ripples_are_promised_up_to_half_of_their_power(finest):
    """At the frequency up to which the limit of ripples holds, half of a wave's power is left in cells, or parts."""
    robot = read_recipe(shipped_recipes()["pendulum2"])
    t, (q, *_) = fourier(np.random.default_rng(5), 2, SECONDS, RATE)
    noise = np.random.default_rng(1)
    log = Log("a.csv", np.arange(len(t)) + 2, t, q.T, None, np.cos(q.T) + noise.normal(0.0, 0.01, q.T.shape))
    bins = joint_bins(robot, segment([log], robot).runs, finest=finest)[0]
    rest = noise.normal(size=len(bins))
    waves = spectrum(("ripple", 1), bins, noise_of(bins, rest), white=rest)
    fastest = float(waves.frequency[waves.visible][-1])
    rippled = replace(log, current=np.cos(fastest * q.T))
    drawn = joint_bins(robot, segment([rippled], robot).runs, finest=finest)[0].current
    assert np.mean(drawn**2) / 0.5 == pytest.approx(0.5, abs=0.05)


def rippled(seed: int, waves: float, size: float, *, rate: float = RATE) -> tuple[Robot, Log]:
    """A motion of 40 s with the engine's torques, friction, noise of 0.1 A, and waves a turn in joint 1."""
    rng = np.random.default_rng(seed)
    robot = read_recipe(shipped_recipes()["pendulum2"])
    t, exact = fourier(rng, 2, 40.0, rate)
    drawn = torques(engine(robot, rng)[0], exact).T + 0.5 * np.sign(exact[1]).T + rng.normal(0.0, 0.1, (len(t), 2))
    drawn[:, 0] += size * np.cos(waves * exact[0][0] - 1.0)
    return robot, Log("a.csv", np.arange(len(t)) + 2, t, exact[0].T, None, drawn)


@pytest.mark.parametrize(("seed", "cell"), [(61, None), (62, 0.06), (63, 0.1)])
def test_ripples_that_cells_average_away_are_fitted_in_their_parts(seed, cell):
    """A wave of 18 Hz on average has its size, RMSE falls to the noise, and what else was fitted stays as it was."""
    robot, log = rippled(seed, 150.0, 0.1)
    dataset = segment([log], robot, options=SegmentOptions(cell=cell))
    before, after = (
        identify(dataset, robot, effects=chosen_by(robot, add=add)) for add in ((), ("ripple@1:frequency=150",))
    )
    values = {value.name: value for value in after.values}
    ripple = values["ripple.j1.cos"].value + 1j * values["ripple.j1.sin"].value
    assert abs(ripple - 0.1 * np.exp(1j)) < 4.0 * values["ripple.j1.cos"].std_error < 0.02
    assert before.joint(1).rmse == pytest.approx(np.hypot(0.1, 0.1 / np.sqrt(2.0)), rel=0.05)
    # What parts of 12 ms average away of it is modelled, too.
    assert after.joint(1).rmse == pytest.approx(0.1, rel=0.05)
    assert after.joint(1).samples == before.joint(1).samples  # else history does not compare them
    assert after.joint(1).noise_inside == pytest.approx(0.1, rel=0.05)
    for value in before.values:
        if value.std_error is not None and values[value.name].value is not None:
            assert abs(values[value.name].value - value.value) < 4.0 * value.std_error


@pytest.mark.parametrize("size", [0.0, 0.05])
def test_ripples_that_cells_average_away_are_named(size):
    """Diagnosis of such motion names the wave, at its frequency, and of motion without any nothing."""
    robot, log = rippled(64, 180.0, size)
    dataset = segment([log], robot, options=SegmentOptions(cell=0.06))
    estimate = identify(dataset, robot)
    findings = diagnose(estimate, dataset, robot).findings
    assert [(finding.effect, finding.joint) for finding in findings] == [("ripple", 1)] * bool(size)
    assert all(finding.shape["frequency"] == pytest.approx(180.0, rel=0.01) for finding in findings)


@pytest.mark.parametrize("share", [0.0, 0.1])
def test_inertia_loads_a_joint_that_turns_about_the_vertical(share):
    """Friction that grows with the engine's torque is load friction there, too, with its size; else nothing is."""
    rng = np.random.default_rng(3)
    robot = arm("RRR", [0.0, TURN, 0.0])
    t, exact = fourier(rng, 3, 40.0, RATE)
    torque, way = torques(engine(robot, rng)[0], exact).T, np.sign(exact[1]).T
    drawn = torque + 0.5 * way + rng.normal(0.0, 0.1, torque.shape)
    drawn[:, 0] += share * way[:, 0] * np.abs(torque[:, 0])
    dataset = segment([Log("a.csv", np.arange(len(t)) + 2, t, exact[0].T, None, drawn)], robot)
    findings = diagnose(identify(dataset, robot), dataset, robot).findings
    assert [(finding.effect, finding.joint) for finding in findings] == [("load_friction", 1)] * bool(share)
    for size in (size for finding in findings for size in finding.sizes):
        assert size.name == "drive + back" and abs(size.value - 2.0 * share) < 3.0 * size.std_error


@pytest.mark.parametrize(("seed", "late"), [(75, 1), (76, -2), (77, 0)])
def test_currents_logged_late_are_told_by_ripples(seed, late):
    """By so many samples, or positions are; with the delay that is told in the recipe the ripple is found."""
    robot, log = rippled(seed, 150.0, 0.2)
    first, n = max(late, 0), len(log) - abs(late)
    log = replace(log.part(slice(first, first + n)), current=log.current[first - late : first - late + n])
    for delay in dict.fromkeys((0.0, late / RATE)):
        there = replace(robot, log=replace(robot.log, delay=delay))
        dataset = segment([log], there)
        diagnosis = diagnose(identify(dataset, there), dataset, there)
        told = [note.text.split("delay: ")[1].split()[0] for note in diagnosis.notes if note.slug == "current-late"]
        assert [float(text) for text in told] == pytest.approx([late / RATE] * (delay != late / RATE), abs=3e-4)
    assert [(item.effect, round(item.shape["frequency"])) for item in diagnosis.findings] == [("ripple", 150)]


@pytest.mark.parametrize(("seed", "cut"), [(70, 8.0), (71, 8.0), (71, 4.0)])
def test_what_a_filter_made_of_friction_passes_for_no_effect(seed, cut):
    """Currents without anything beyond some Hz: friction that builds up slowly where a joint turns round is no law."""
    robot, log = rippled(seed, 0.0, 0.0)
    drawn = signal.filtfilt(*signal.butter(4, cut / (0.5 * RATE)), log.current, axis=0)
    dataset = segment([replace(log, current=drawn)], robot)
    estimate = identify(dataset, robot)
    assert [note.slug for note in dataset.notes] == ["current-filtered"]
    assert not diagnose(estimate, dataset, robot).findings
    friction = [(value.value, value.std_error) for value in estimate.values if value.name.startswith("coulomb")]
    assert all(abs(abs(size) - 0.5) < 3.0 * error for size, error in friction)


def test_cells_and_their_parts_have_one_mean_square():
    """Of noise that is as slow as cells, too: what the filter of cells takes of it is scatter inside them."""
    robot, log = rippled(65, 0.0, 0.0)
    slow = np.random.default_rng(66).normal(0.0, 0.3, log.current.shape)
    noise = np.apply_along_axis(np.convolve, 0, slow, np.full(9, 1.0 / 3.0), mode="same")
    runs = segment([replace(log, current=log.current + noise)], robot, options=SegmentOptions(cell=0.06)).runs
    assert np.median(np.diff(runs[0].bins.time)) == pytest.approx(0.06, rel=1e-9)
    fitted = fit_bins(Model.of_runs(robot, runs), joint_bins(robot, runs))
    for finest in ((), (1, 2)):
        for bins in joint_bins(robot, runs, finest=finest):
            square = np.average(bins.squares(fitted.misfit(bins)), weights=bins.count)
            assert np.sqrt(square) == pytest.approx(np.hypot(0.1, 0.3), rel=0.05)


@pytest.mark.parametrize("seed", [60, 80, 101, 164])
def test_cells_of_short_moves_of_few_joints_scatter_by_their_noise(seed):
    """Cells show few directions of motion there, and parts of cells others, to which nothing may be fitted blindly."""
    rng, time, q = np.random.default_rng(seed), np.arange(900) / 100.0, np.tile([0.3, -1.2, 1, 0.4, 0.5, 0.2], (900, 1))
    for start in (0.3, 3.3, 6.3):
        s, moving = np.clip((time - start) / 2.3, 0.0, 1.0), rng.choice(6, rng.integers(2, 4), replace=False)
        ramps = np.minimum(s, 1.0 - s) ** 2 * 8.0 / 3.0
        course = np.select([s < 0.25, s < 0.75], [ramps, (4.0 * s - 0.5) / 3.0], 1.0 - ramps)
        q[:, moving] += course[:, None] * rng.uniform(-0.8, 0.8, len(moving))
    log = Log("a.csv", np.arange(900) + 2, time, np.rint(q * 1e5) / 1e5, None, rng.normal(0.0, 0.05, q.shape))
    runs = segment([log], read_recipe(shipped_recipes()["ur5e"])).runs
    assert max(np.sqrt(run.bins.variance.mean()) for run in runs if run.kind == "block") < 1.5 * 0.05


@pytest.mark.parametrize(("seconds", "kinds"), [(40.0, {"block"}), (6.0, set())])
def test_moves_between_long_pauses_are_blocks(seconds, kinds):
    """Each move from pose to pose is a block of its own, the rests are left out; a move or two alone are nothing."""
    robot = read_recipe(shipped_recipes()["pendulum2"])
    q = picks(np.random.default_rng(3), seconds, np.array([1.0, 1.0]), (2.5, 4.0))[::TICKS]
    log = Log("a.csv", np.arange(len(q)) + 2, np.arange(len(q)) / SAMPLED, q, None, np.cos(q))
    dataset = segment([log], robot)
    assert {run.kind for run in dataset.runs} == kinds
    moves = [reject for reject in dataset.rejects if reject.reason == "rest" and reject.duration > 2.0]
    assert not kinds or len(moves) - 1 <= len({run.start for run in dataset.runs}) <= len(moves) + 1


def test_blocks_of_long_motion_share_a_bounded_number_of_bins(monkeypatch):
    """Beyond it cells are joined: samples and means of all that a fit compares are the same, the RMSE is the noise."""
    robot, rng = read_recipe(shipped_recipes()["pendulum2"]), np.random.default_rng(5)
    t, motion = fourier(rng, 2, 60.0, RATE)
    drawn = np.array([row.sum(axis=0) for row in base_parameters(robot).rows(*motion)]).T + np.sign(motion[1]).T
    q = motion[0]
    log = Log("a.csv", np.arange(len(t)) + 2, t, q.T, None, drawn + rng.normal(0.0, 0.1, drawn.shape))
    fine = segment([log], robot).runs
    monkeypatch.setattr("pumaid.preprocessing.segment.BLOCK_BINS", 700)
    coarse = segment([log], robot).runs
    assert sum(len(run.bins) for run in coarse) <= 700 < sum(len(run.bins) for run in fine)
    for a, b in zip(fine, coarse, strict=True):
        assert a.bins.count.sum() == b.bins.count.sum()
        for name in ("current", "rigid_body", "position", "acceleration"):
            before, after = (run.bins.count @ getattr(run.bins, name) for run in (a, b))
            np.testing.assert_allclose(after, before, rtol=1e-9, atol=1e-9)
    for runs in (fine, coarse):
        assert [fit.rmse for fit in identify(Dataset(runs, ()), robot).joints] == pytest.approx([0.1, 0.1], rel=0.2)


def test_a_motor_on_a_bench_may_move_as_it_likes():
    """An upright axis bears no weight, and what is fitted is friction and inertia."""
    rng = np.random.default_rng(4)
    joint = Joint(1, "motor", "revolute")
    t, (q, v, a) = fourier(rng, 1, SECONDS, RATE)
    current = 0.4 * np.sign(v) + 0.2 * v + 0.05 * a + rng.normal(scale=0.01, size=v.shape)
    log = Log("bench.csv", np.arange(len(t)) + 2, t, q.T, None, current.T)
    robot = Robot("bench", (joint,))
    values = {value.name: value.value for value in identify(segment([log], robot), robot).values}
    assert values["coulomb.j1.plus"] == pytest.approx(0.4, abs=0.01)
    assert values["viscous.j1.minus"] == pytest.approx(0.2, abs=0.02)
