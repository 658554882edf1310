"""Least squares that says what it does not know, and rows n to 1 of systems of class (1), knowing no robot."""

import numpy as np
import pytest

from pumaid.dataset import Dataset
from pumaid.estimation.estimate import identify
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.maths import Bilinear, Gains, Recursion, fit_bilinear, independent, least_squares
from pumaid.simulation import Bench, draw
from pumaid.trajectory import Motion, Plan

RNG = np.random.default_rng(4)


def solved(owners, blocks, *, values, gains) -> Recursion:
    """The recursion over rows whose regressors are `blocks` (n arrays (N, p)) and whose targets the truth gives."""
    found = Recursion(np.array(owners), len(blocks))
    for row in reversed(range(len(blocks))):
        scale = gains[row] / np.array(gains)[np.array(owners)]
        found.take(row, blocks[row], blocks[row] @ (scale * values))
    return found


def test_discrete_system_of_the_paper():
    """The 2 x 2 system of the paper's Section V is identified from its simulated states and inputs."""
    a, b = np.array([0.7, -0.3, 1.6, 0.9]), np.array([2.0, -0.5])
    u, x, y = RNG.normal(size=(200, 2)), np.zeros(200), np.zeros(200)
    for k in range(1, 200):
        x[k] = (b[1] * u[k, 1] - a[3] * x[k - 1]) / a[2]
        y[k] = (b[0] * u[k, 0] - a[0] * x[k] - a[1] * x[k - 1] - a[3] * y[k - 1]) / a[2]
    now, before = slice(1, None), slice(None, -1)
    nothing = np.zeros(199)
    first = np.column_stack([x[now], x[before], y[now], y[before]])
    second = np.column_stack([nothing, nothing, x[now], x[before]])
    found = Recursion(np.array([0, 0, 1, 1]), 2)
    found.take(1, second, u[now, 1])
    found.take(0, first, u[now, 0])
    # w*_j = eta_j w_j with eta_i = 1 / b_i.
    assert found.values == pytest.approx([a[0] / b[0], a[1] / b[0], a[2] / b[1], a[3] / b[1]], rel=1e-10)
    assert found.gains.ratio(0, 1) == pytest.approx(b[1] / b[0], rel=1e-10)


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


def test_far_start_still_comes_home():
    """From ratios off by factors of three and with a sign wrong the steps, halved where needed, reach the truth."""
    found = fit_bilinear(SYSTEM, 0.3 * VALUES, chain(1.5, 0.5, 0.7))
    assert found.values == pytest.approx(VALUES, rel=1e-6)
    assert [found.gains.edge[edge] for edge in (3, 1, 2)] == pytest.approx([0.5, -1.5, 2.0], rel=1e-6)


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
