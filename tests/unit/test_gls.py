"""The model and its fit before it is put into words, runs that repeat others, and the algebra that knows no robot."""

import re
from dataclasses import replace

import numpy as np
import pytest
from monte_carlo import Bench
from scipy import optimize
from scipy.signal import lfilter
from worlds import CRANE, PENDULUM, STANFORD, course, dataset, drawn, experiment, fit_runs, only, run_of

from pumaid.dataset import Dataset
from pumaid.effects import Samples
from pumaid.errors import ModelError
from pumaid.estimation.estimate import identify
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.joint_bins import joint_bins
from pumaid.maths import RATIO_SPREAD, Bilinear, Gains, Recursion, fit_bilinear, independent, least_squares
from pumaid.model import Model
from pumaid.preprocessing.replicates import first_made, noise_floor, pairs, replicates
from pumaid.simulation import draw
from pumaid.trajectory import Motion, Plan


def test_weights_are_each_joints_own():
    """A noisy joint does not loosen what a quiet one says of its own friction."""
    truth = drawn(CRANE)
    loud = replace(truth, noise=replace(truth.noise, std=truth.noise.std * np.array([30.0, 1.0, 1.0])))
    errors = []
    for one in (truth, loud):
        runs = dataset(one, experiment(CRANE)).runs
        fitted = fit_runs(CRANE, runs)
        errors.append(np.sqrt(np.diag(fitted.inverse)))
    index = Model(CRANE).names.index("viscous.j3.plus")
    assert errors[1][index] == pytest.approx(errors[0][index], rel=0.05)


def test_a_column_that_overflows_is_refused():
    """An effect that a search took too far is told, with its joint, not met as an error of the algebra."""
    row = fit_runs(CRANE, dataset(drawn(CRANE), experiment(CRANE)).runs).rows[0]
    design = row.design.copy()
    design[3, 0] = np.inf
    with pytest.raises(ModelError, match="overflow") as refused:
        type(row).of(row.bins, design, row.inner)
    assert refused.value.slug == "effects-astray" and refused.value.where.joint == row.joint


def test_few_runs_take_their_noise_from_inside():
    """With two runs the noise comes from inside them: right within a factor of two, its correlation heeded."""
    truth = drawn(PENDULUM)
    quiet = replace(truth, noise=replace(truth.noise, level_share=0.0, correlation_time=0.05))
    motions = tuple(Motion(2, (0.3, 0.0), -2.0 * s, 2.0 * s, 0.4) for s in (1, -1))
    found = []
    for seed in range(20):
        runs = Bench(quiet, Plan("two", motions), rate=100.0).runs(np.random.default_rng(seed))
        fitted = fit_runs(PENDULUM, runs)
        assert fitted.weak == (2,) and not fitted.noises[2].level.any()
        noise, count = fitted.noises[2], fitted.by_bin[2].bins.count
        density = noise.spread**2 * (1.0 + noise.correlation) / (1.0 - noise.correlation)
        found.append(np.mean(density) * np.mean(count))
    phi = np.exp(-1.0 / (100.0 * 0.05))
    long_run = quiet.noise.std[1] ** 2 * (1 + phi) / (1 - phi)
    assert np.mean(found) == pytest.approx(long_run, rel=0.5)


def test_bins_of_one_sample_show_their_noise():
    """Of a run of ten samples it passed for none, and errors came out a billion times too small."""
    path, current = course("stroke", -1.0, 1.0, duration=4.0, samples=10), np.random.default_rng(2).normal(size=10)
    fitted = fit_runs(PENDULUM, [run_of(PENDULUM, 2, [0.3, 0.0], course=path, current=current, bins=10)])
    assert 0.3 < fitted.noises[2].spread[0] < 3.0


def test_a_load_of_unknown_size_gets_a_usual_ratio():
    """A slide held nearly level in its runs: only ratio times load is known, and the ratio stays of order one."""
    truth, plan = drawn(STANFORD, noisy=False), experiment(STANFORD)
    runs = dataset(truth, only(plan, lambda motion: motion.joint != 3)).runs
    hold = (0.3, 1.558, 0.1, -0.2, 0.4, 0.1)
    slides = tuple(Motion(3, hold, -0.3 * s, 0.3 * s, v) for v in (0.06, 0.2) for s in (1, -1))
    runs = (*runs, *dataset(truth, Plan("level", slides)).runs)
    fitted = fit_runs(STANFORD, runs)
    assert abs(fitted.gains.ratio(1, 2)) < RATIO_SPREAD
    assert not fitted.solution.linear.determined[Model(STANFORD).names.index("gravity.l3.mass")]


#: A name as interfaces.md has it.
NAME = re.compile(
    r"gravity\.l\d\.(x|y|mass)|(coulomb|viscous)\.j\d\.(plus|minus)|inertia\.l\d\.(m[xyz]?|[xyz]{2})|rotor\.j\d"
)


def sampled(robot, joint, hold, moves) -> tuple:
    """A run with random currents, and its samples as effects see them."""
    t, q, qd, qdd = moves
    current = np.random.default_rng(joint).normal(size=len(q))
    position, velocity = np.tile(hold, (len(q), 1)), np.zeros((len(q), robot.n_joints))
    position[:, joint - 1], velocity[:, joint - 1] = q, qd
    direction = np.full(len(q), np.sign(q[-1] - q[0]))
    samples = Samples(joint, position, velocity, acceleration=qdd, direction=direction, time=t)
    return run_of(robot, joint, hold, course=moves, current=current), samples, current


def test_names_are_the_contracts():
    """Every parameter of the Stanford arm has a name of the contract, and the paper's symbol."""
    model = Model(STANFORD, is_dynamic=True)
    assert [name for name in model.names if not NAME.fullmatch(name)] == []
    some = "gravity.l3.mass gravity.l6.x coulomb.j3.minus viscous.j1.plus inertia.l2.zz rotor.j3"
    assert set(some.split()) <= set(model.names)
    symbols = {column.name: (column.symbol, column.unit) for column in model.columns}
    assert symbols["gravity.l3.mass"] == ("m3", "A s2/m")
    assert symbols["gravity.l6.x"] == ("k6x", "A s2/m")
    assert symbols["viscous.j3.plus"] == ("lambda2+", "A s/m") and symbols["viscous.j2.plus"][1] == "A s/rad"
    assert symbols["rotor.j3"][1] == "A s2/m" and symbols["inertia.l2.zz"][1] == "A s2/rad"


def test_outer_links_act_on_inner_joints_only():
    """Gravity of link 1 is nothing to joint 2; friction is the moving joint's own."""
    model = Model(PENDULUM)
    samples = sampled(PENDULUM, 2, (0.3, 0.4), course("constant", -1.0, 1.0))[1]
    moved = dict(zip(model.names, np.abs(model.regressor(samples)).max(axis=0), strict=True))
    assert moved["gravity.l1.x"] == moved["coulomb.j1.plus"] == moved["viscous.j1.minus"] == 0.0
    assert moved["gravity.l2.x"] > 1.0 and moved["coulomb.j2.plus"] == 1.0 and moved["coulomb.j2.minus"] == 0.0


def test_inertia_is_in_the_model_where_something_accelerates():
    """A stroke brings the rigid body's parameters, of which a run at constant speed shows weight alone."""
    stroke, steady = (sampled(CRANE, 2, (0.0, 0.0, 0.1), course(kind, -0.2, 0.2))[0] for kind in ("stroke", "constant"))
    assert not any(name.startswith(("inertia", "rotor")) for name in Model.of_runs(CRANE, [steady]).names)
    model = Model.of_runs(CRANE, [stroke, steady])
    inertial = [n for n, name in enumerate(model.names) if name.startswith(("inertia", "rotor"))]
    shown = [model.design(joint_bins(CRANE, [run])[0])[:, inertial].any() for run in (stroke, steady)]
    assert inertial and shown == [True, False]


def test_prediction_is_the_truth_where_the_fit_is_exact():
    """Predicted currents of a noise-free arm are the truth's, in postures that were never run."""
    truth = drawn(STANFORD, noisy=False)
    estimate = identify(dataset(truth, experiment(STANFORD)), STANFORD)
    model, rng = Model.of_estimate(STANFORD, estimate), np.random.default_rng(3)
    for joint in range(1, 7):
        position, velocity = rng.uniform(-1.0, 1.0, (20, 6)), np.zeros((20, 6))
        velocity[:, joint - 1] = rng.choice([-0.4, 0.7], 20)
        samples = Samples(joint, position, velocity, np.zeros(20), np.sign(velocity[:, joint - 1]))
        wanted = truth.gravity_current(position)[:, joint - 1] + truth.friction.currents(velocity)[:, joint - 1]
        assert model.predict(estimate, samples) == pytest.approx(wanted, abs=1e-9)


SIGMA = 0.1
#: Experiments whose floors are averaged: 48 differences of 400 samples each know a floor to well under 1 %.
EXPERIMENTS = range(12)


def world(seed: int, *, phi: float = 0.0, level: float = 0.0, ripple: float = 0.0, shift: float = 0.0, kind="constant"):
    """Two runs of each of two speeds both ways: weight, friction, ripple, noise (AR(1) of `phi`) and levels."""
    rng, runs = np.random.default_rng(seed), []
    for duration in (2.0, 3.0):
        for way in (2.0, -2.0, 2.0, -2.0):
            moves = course(kind, *(rng.normal() * shift + np.array([-way, way])), duration=duration, samples=400)
            white = rng.normal(size=400)
            noise = lfilter([np.sqrt(1 - phi**2)], [1, -phi], white, zi=[phi * rng.normal()])[0] if phi else white
            current = 3.0 * np.cos(moves[1]) + np.sign(way) + ripple * np.sin(9.0 * moves[1])
            current = current + SIGMA * noise + level * rng.normal()
            runs.append(run_of(PENDULUM, 1, (0.0, 0.3), course=moves, current=current))
    return runs


@pytest.mark.parametrize(
    ("conditions", "expected", "within"),
    [
        *(({"phi": phi, "kind": kind}, SIGMA, 0.04) for phi in (0.0, 0.9, 0.98) for kind in ("constant", "stroke")),
        # 48 pairs know the level's variance, a fifth of all, to 20 %: the floor to 2 %; three of these.
        ({"level": 0.05}, np.hypot(SIGMA, 0.05), 0.06),
        *(({"ripple": 0.3, "shift": shift}, SIGMA, 0.05) for shift in (0.0, 0.05)),
    ],
    ids=str,
)
def test_floor_of_noise(conditions, expected, within):
    """White or correlated, it is the noise's standard deviation and what a run differs by as a whole."""
    # A ripple three times the noise that repeats hardly moves the floor, though bins lie elsewhere in each run.
    floors = [noise_floor(pairs(world(seed, **conditions)))[0] for seed in EXPERIMENTS]
    assert np.sqrt(np.mean(np.square(floors))) == pytest.approx(expected, rel=within)


def test_exact_runs_have_no_floor():
    """Without noise the floor is far below any current sensor's step; without a repeated run it is unknown."""
    moves = course("constant", -2.0, 2.0, samples=4000)
    run = run_of(PENDULUM, 1, (0.0, 0.3), course=moves, current=3.0 * np.cos(moves[1]), bins=400)
    assert noise_floor(pairs([run, run]))[0] < 1e-3
    found, why = noise_floor(pairs(world(0)[:2]))
    assert found is None and "no run is repeated" in why


def pendulum(**changes: object):
    """A run that others are compared with."""
    moves = course("constant", -1.0, 1.0)
    return replace(run_of(PENDULUM, 1, (0.0, 0.3), course=moves, current=np.cos(moves[1])), **changes)


@pytest.mark.parametrize(
    ("changes", "is_same"),
    [
        ({}, True),
        ({"joint": 2}, False),
        ({"kind": "stroke"}, False),
        ({"speed": 1.02}, True),
        ({"speed": 1.05}, False),
        ({"speed": -1.0}, False),
        ({"posture": np.array([np.nan, 0.305])}, True),
        ({"posture": np.array([np.nan, 0.32])}, False),
        ({"span": (-0.9, 1.1)}, True),
        ({"span": (-0.4, 1.6)}, False),
        ({"span": (-1.0 + 2 * np.pi, 1.0 + 2 * np.pi)}, True),
    ],
)
def test_what_repeats_what(changes, is_same):
    """Same joint, kind, direction, speed within 3 %, posture within 0.01 rad, most of the way; turns do not count."""
    found = replicates([pendulum(), pendulum(**changes)])
    assert found == ([[0, 1]] if is_same else [])


def test_groups_keep_apart():
    """Three repeats make one group, two of another speed a second; a lone run is in none."""
    runs = [pendulum(speed=speed) for speed in (1.0, 0.5, 1.0, 2.0, 0.5, 1.0)]
    assert replicates(runs) == [[0, 2, 5], [1, 4]]


def test_motion_that_is_made_again():
    """A path of 7.3 s, with a pause of 3 s before its third time, and other motion, which nothing repeats."""
    time = np.concatenate([np.arange(0.0, 14.6, 0.048), np.arange(17.6, 24.9, 0.048)])
    phase = np.where(time < 15.0, time, time - 17.6) % 7.3
    waves = 2.0 * np.pi / 7.3 * np.array([1.0, 2.0, 3.0])
    path = np.sin(np.outer(phase, waves) + np.array([0.1, 1.0, 2.0]))
    assert np.mean(np.abs(first_made(time, path) - phase) < 0.06) > 0.93  # it is asked every half second
    other = np.sin(np.outer(time, 1.1 * waves * [1.0, 1.37, 0.71]) + np.array([0.1, 1.0, 2.0]))
    np.testing.assert_array_equal(first_made(time, other), time)
    np.testing.assert_array_equal(first_made(time, 1e-3 * other), time)  # an arm that hardly moves, and a short one
    np.testing.assert_array_equal(first_made(time[:9], other[:9]), time[:9])


RNG = np.random.default_rng(4)


def solved(owners, blocks, *, values, gains) -> Recursion:
    """The recursion over rows whose regressors are `blocks` (n arrays (N, p)) and whose targets the truth gives."""
    found = Recursion(np.array(owners), len(blocks))
    for row in reversed(range(len(blocks))):
        scale = gains[row] / np.array(gains)[np.array(owners)]
        found.take(row, blocks[row], blocks[row] @ (scale * values))
    return found


def test_a_load_that_looks_like_the_rows_own_is_named():
    """A nu that lies in the span of own columns leaves the ratio open and marks the columns that absorb it."""
    own, other = RNG.normal(size=(20, 1)), RNG.normal(size=(20, 1))
    blocks = [np.hstack([own, other, 2.0 * own]), np.hstack([0.0 * own, 0.0 * own, other])]
    found = solved([0, 0, 1], blocks, values=np.array([1.0, 4.0, 3.0]), gains=[1.0, 1.0])
    assert found.redundant == [(0, 1)] and np.isnan(found.gains.ratio(0, 1))
    assert found.undetermined.tolist() == [True, False, False]
    # The absorbing column predicts this row all the same: 1 + 2 * 3.
    assert found.values == pytest.approx([7.0, 4.0, 3.0])


ARM, DESIGN = 21, 910_000


def thin(robot) -> Plan:
    """Every joint in two random postures, at two speeds, both ways, twice, in random order."""
    rng, motions = np.random.default_rng(DESIGN), []
    holds = {joint.number: [tuple(rng.uniform(-2.0, 2.0, 6)) for _ in range(2)] for joint in robot.joints}
    for _ in range(2):
        for joint in robot.joints:
            own = [
                Motion(joint.number, hold, -2.0 * way, 2.0 * way, speed)
                for hold in holds[joint.number]
                for speed in (0.3, 0.9)
                for way in (1, -1)
            ]
            motions += [own[k] for k in rng.permutation(len(own))]
    return Plan(robot.name, tuple(motions))


def test_the_joint_fit_leaves_a_wrong_minimum():
    """Every joint ends at its noise floor, and the ratio has its true size within four standard errors."""
    robot = read_recipe(shipped_recipes()["ur3e"])
    truth = draw(robot, ARM)
    runs = Bench(truth, thin(robot), rate=100.0, bins=128).runs(np.random.default_rng(DESIGN))
    estimate = identify(Dataset(runs), robot)
    assert all(one.rmse < 1.2 * one.noise_floor for one in estimate.joints)
    (ratio,) = (value for value in estimate.values if value.name == "gain_ratio.5.6")
    expected = truth.gain[4] / truth.gain[5]
    assert abs(ratio.value) == pytest.approx(abs(expected), abs=4.0 * ratio.std_error)


DRAWS = np.random.default_rng(6)
N, OWNERS = 30, np.array([0, 0, 1, 2, 3])
ROW = np.repeat(np.arange(4), N)
REGRESSORS = np.where(ROW[:, None] <= OWNERS, DRAWS.normal(size=(4 * N, 5)), 0.0)
VALUES = np.array([1.0, -2.0, 0.5, 1.5, -0.7])


def chain(*edges: float) -> Gains:
    """Rows 0 - 1 - 3 on one branch, row 2 on another."""
    gains = Gains(4)
    for (upper, lower), ratio in zip([(1, 3), (0, 1), (0, 2)], edges, strict=True):
        gains.parent[lower], gains.edge[lower] = upper, ratio
    return gains


TRUTH = chain(0.5, -1.5, 2.0)
#: Rows 1 and 2 do not feel each other here, as the branches say.
REGRESSORS[ROW == 1, 3] = 0.0
REGRESSORS[ROW == 2, 4] = 0.0
EXACT = Bilinear(ROW, REGRESSORS, np.zeros(4 * N), OWNERS).scaled(TRUTH) @ VALUES
SYSTEM = Bilinear(ROW, REGRESSORS, EXACT, OWNERS)
WEAK = 0.03


def test_far_start_still_comes_home():
    """From ratios off by factors of three and with a sign wrong the steps, damped where needed, reach the truth."""
    found = fit_bilinear(SYSTEM, 0.3 * VALUES, chain(1.5, 0.5, 0.7))
    assert found.values == pytest.approx(VALUES, rel=1e-6)
    assert [found.gains.edge[edge] for edge in (3, 1, 2)] == pytest.approx([0.5, -1.5, 2.0], rel=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_steps_reach_the_end_of_a_curved_valley(seed):
    """Loads nearly alike in row 0, and faint in their own, bend the valley; scipy finds its end from the truth."""
    draws, rows = np.random.default_rng(seed), REGRESSORS.copy()
    rows[(ROW[:, None] == OWNERS) & (OWNERS > 0)] *= WEAK
    rows[ROW == 0, 3:] = rows[ROW == 0, 2:3] + WEAK * draws.normal(size=(N, 2))
    target = Bilinear(ROW, rows, 0.0 * EXACT, OWNERS).scaled(TRUTH) @ VALUES + 1e-3 * WEAK * draws.normal(size=4 * N)
    system, start = Bilinear(ROW, rows, target, OWNERS), chain(0.1, -0.3, 0.4)
    found = fit_bilinear(system, least_squares(system.scaled(start), target).values, start)
    least = optimize.least_squares(
        lambda at: system.left(at[:5], TRUTH.with_ratios(at[5:])), [*VALUES, *TRUTH.ratios], x_scale="jac", xtol=1e-14
    )
    assert found.residual @ found.residual == pytest.approx(2.0 * least.cost, rel=1e-3)


def test_prior_holds_only_what_the_data_do_not():
    """A ratio whose load is far below the noise stays near its usual value; one that is felt ignores the prior."""
    quiet = VALUES * np.array([1.0, 1.0, 1.0, 1e-6, 1.0])  # row 2's load is a millionth
    noisy = SYSTEM.scaled(TRUTH) @ quiet + 0.01 * DRAWS.normal(size=4 * N)
    weighted = Bilinear(ROW, REGRESSORS / 0.01, noisy / 0.01, OWNERS)
    found = fit_bilinear(weighted, quiet, chain(0.5, -1.5, 2.0), prior=np.repeat([0.0, 0.1], [5, 3]))
    assert abs(found.gains.edge[2] - 1.0) < 30.0
    assert found.gains.edge[1] == pytest.approx(-1.5, abs=0.05)


NUMBERS = np.random.default_rng(3)
ROWS, TARGET = NUMBERS.normal(size=(40, 4)), NUMBERS.normal(size=40)
SHORT = np.column_stack([ROWS[:, :3], ROWS[:, 0] - 2.0 * ROWS[:, 1]])  # the last is a combination of two others


def test_blind_direction_changes_no_prediction():
    """Moving along a blind direction, in unscaled parameters, leaves the rows' product alone."""
    found = least_squares(SHORT, TARGET)
    assert SHORT @ (found.blind[:, 0] / np.linalg.norm(SHORT, axis=0)) == pytest.approx(np.zeros(40), abs=1e-12)
    assert np.linalg.norm(found.blind[:, 0]) == pytest.approx(1.0)


def test_short_rank_gives_the_shortest_solution():
    """Of all solutions it is the shortest in parameters scaled by their columns' norms, as by a pseudo-inverse."""
    size = np.linalg.norm(SHORT, axis=0)
    wanted = np.linalg.pinv(SHORT / size, rcond=1e-9) @ TARGET / size
    assert least_squares(SHORT, TARGET).values == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize("power", [-8, 8])
def test_units_of_columns_do_not_matter(power):
    """A column in another unit changes its own value by the unit and nothing else, dependent or not."""
    unit = np.array([1.0, 10.0**power, 1.0, 1.0])
    plain, scaled = least_squares(SHORT, TARGET), least_squares(SHORT * unit, TARGET)
    assert scaled.values * unit == pytest.approx(plain.values, rel=1e-8)
    assert scaled.determined.tolist() == plain.determined.tolist()


def test_limit_keeps_a_sum_whose_terms_are_vague():
    """Two nearly equal columns: their difference is blind, their sum known."""
    first = np.ones(100)
    rows = np.column_stack([first, first + 1e-6 * NUMBERS.normal(size=100)]) / 0.1  # noise of 0.1
    found = least_squares(rows, rows @ [1.0, 2.0], limit=np.ones(2) * 10.0)
    assert not found.determined.any()
    assert found.values.sum() == pytest.approx(3.0, abs=1e-6)


@pytest.mark.parametrize("weight", [1.0, 1e6, 1e14])
def test_rounding_is_not_information(weight):
    """However large the weights of data without noise, an exact dependence stays blind, limits or not."""
    third = 0.1 * SHORT[:, 0] + 0.3 * SHORT[:, 1]  # equal but for rounding to a combination
    rows = np.column_stack([SHORT[:, :2], third]) * weight
    found = least_squares(rows, rows @ [1.0, 2.0, 3.0], limit=np.full(3, 100.0))
    assert not found.determined.any()


def test_leading_columns_have_the_first_word():
    """What leading columns can say, the others no longer can, and the leading ones keep their place."""
    rows = np.column_stack([SHORT[:, 0], SHORT[:, 1], SHORT[:, 3], SHORT[:, 2]])
    assert independent(rows, first=2).tolist() == [True, True, False, True]
