"""A wrist whose gears couple it, from logs: what the key `coupling` covers and what the effect of that name adds."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import table1
from free_motion import reach, recorded, waves
from menus import arm
from monte_carlo import Bench
from worlds import GEARS, wrist

import pumaid
from pumaid.dataset import Dataset, first_motions
from pumaid.design.information import gravity_names, predicted_errors
from pumaid.design.plan import plan
from pumaid.estimate import Estimate
from pumaid.estimation.estimate import identify
from pumaid.estimation.nonlinear import fit_effects
from pumaid.model import Model, minimal
from pumaid.simulation import Truth, draw

WRIST = wrist()
#: An arm with hands' weight in its wrist, and what its gears pass on as effects.
TRUTH = draw(WRIST, 3)
PASSED = (pumaid.EffectChoice("coupling", 6, {"on": 5.0}), pumaid.EffectChoice("coupling", 5, {"on": 4.0}))


@cache
def dataset() -> Dataset:
    """The paper's runs of the wrist, as that arm makes them."""
    plan = table1.experiment()
    plan = replace(plan, motions=tuple(motion for motion in plan.motions if motion.joint >= 4))
    return pumaid.segment(pumaid.simulate(WRIST, plan, truth=TRUTH, seed=1, rate=100.0), WRIST)


@cache
def model(*effects: int) -> Estimate:
    """The model of these runs with some of the effects."""
    return pumaid.identify(dataset(), WRIST, effects=[PASSED[number] for number in effects])


def off(estimate: Estimate, *kinds: str) -> float:
    """How many standard errors the parameters of these kinds are off the truth, at most."""
    true = TRUTH.parameters()
    values = [value for value in estimate.values if value.name in true and value.value is not None and value.std_error]
    return max(abs(v.value - true[v.name]) / v.std_error for v in values if v.name.startswith(kinds))


def test_friction_is_found_whatever_the_gears():
    assert off(model(), "coulomb", "viscous") < 4.0


def test_loads_that_gears_pass_on_are_the_effects():
    """Without the effects gravity takes up what motors carry of joints beyond; with them it does not."""
    # Motor 5 carries -r65 r6/r5 of joint 6's load, in the currents of both motors: that is the effect's size.
    assert off(model(), "gravity", "gain_ratio") > 5.0
    assert off(model(0, 1), "gravity", "gain_ratio") < 3.0
    for beyond, on, ratio in ((6, 5, 0.18), (5, 4, 0.0139)):
        share = -ratio * GEARS[on - 1] / GEARS[beyond - 1] * TRUTH.gain[on - 1] / TRUTH.gain[beyond - 1]
        value = model(0, 1).value(f"coupling.j{beyond}.c")
        assert abs(value.value - share) < 3.0 * value.std_error


def note(estimate: Estimate) -> str:
    """The note on loads that gears pass on."""
    return "".join(note.text for note in estimate.notes if note.slug == "load-through-gears")


def test_loads_that_gears_pass_on_are_told():
    """The note names each pair and what adds it; what the model has is not named, and nothing without gears."""
    text = note(model())
    assert all(f"--add coupling@{pair}" in text for pair in ("5:on=4", "6:on=4", "6:on=5"))
    assert f"motor 5 carries {-0.18 * GEARS[4] / GEARS[5]:.2g}" in text and "parallel" not in text
    assert "@6:on=5" not in note(model(0))
    assert not note(pumaid.identify(dataset(), replace(WRIST, coupling={})))


def test_on_parallel_axes_the_ratio_is_off_as_the_note_says():
    """Gears between two parallel axes: the ratio that is found is the motors' times one less the share."""
    plain = arm("ur5e")
    geared = tuple(
        replace(joint, gear_ratio=gear) for joint, gear in zip(plain.joints, (80, 100, -90, 70, 70, 60), strict=True)
    )
    robot = replace(plain, joints=geared, coupling={(3, 2): 0.3})
    truth = draw(robot, 11)
    logs = pumaid.simulate(robot, pumaid.plan(robot, minutes=6.0, seed=0), truth=truth, seed=5, rate=100.0)
    estimate = pumaid.identify(pumaid.segment(logs, robot), robot)
    found = next(value for value in estimate.values if value.name == "gain_ratio.2.3")
    factor = 1.0 - 0.3 * 100 / -90
    assert abs(found.value / truth.parameters()["gain_ratio.2.3"] - factor) < 0.02 * factor
    assert "motor 2 carries 0.33 of joint 3's load" in note(estimate) and f"{factor:.3g} times" in note(estimate)


pytestmark = pytest.mark.slow


@cache
def at_work() -> tuple[Truth, Dataset]:
    """A wrist with gears near 1:1, and a minute of all its joints moving."""
    robot = wrist({(6, 5): 0.9 * GEARS[5] / GEARS[4]})
    truth, rng = draw(robot, 9312), np.random.default_rng(9312)
    log = recorded(truth, waves(rng, 60.0, reach(robot)), rng, counts=2e4)
    return truth, pumaid.segment([log], robot)


def test_errors_know_whose_friction_is_passed_on():
    """The fit's derivative by friction of joint 6 in motor 5 is by how much its prediction moves with it."""
    truth, dataset = at_work()
    base, choices = Model.of_runs(truth.robot, dataset.runs), (pumaid.EffectChoice("coupling", 6, {"on": 5.0}),)
    fitted = fit_effects(base, dataset.runs, choices, begun=first_motions(dataset.runs)).fit
    place, n = [row.joint for row in fitted.rows].index(5), fitted.model.names.index("coulomb.j6.plus")
    parts = np.split(fitted.solution.jacobian, np.cumsum([row.target.size for row in fitted.rows])[:-1])
    step, bins = 1e-3 * (np.arange(len(fitted.values)) == n), fitted.rows[place].bins
    moved = replace(fitted, solution=replace(fitted.solution, values=fitted.values + step))
    change = fitted.noises[5].whiten(bins, moved.misfit(bins) - fitted.misfit(bins)) / 1e-3
    assert np.linalg.norm(change) > 1.0
    # Through loads a bin counts at its middle.
    assert np.linalg.norm(parts[place][:, n]) == pytest.approx(np.linalg.norm(change), rel=0.02)


def test_friction_follows_the_shaft_at_work():
    """All joints moving: friction of motor 6, which a third of the time turns against its joint."""
    truth, dataset = at_work()
    estimate, known = pumaid.identify(dataset, truth.robot), truth.parameters()
    # What motor 5 carries of joint 6's load is left; where friction follows the joint, some twenty times the noise.
    assert estimate.joints[5].rmse < 5.0 * truth.noise.sample_std[5]
    for name in ("coulomb.j6.plus", "coulomb.j6.minus"):
        assert estimate.value(name).value == pytest.approx(known[name], rel=0.15)


def test_forecast_is_what_experiments_scatter():
    """Over 40 experiments the joint estimate scatters by the predicted standard errors."""
    robot = arm("pendulum2")
    made, truth = plan(robot, minutes=6, seed=9), draw(robot, 105)
    names = [name for name in gravity_names(robot) if name not in minimal(robot).absent]
    promised = predicted_errors([truth], made.motions, names)
    bench, rng = Bench(truth, made, rate=50.0), np.random.default_rng(106)
    found = [identify(Dataset(bench.runs(rng)), robot) for _ in range(40)]
    # 40 experiments know a scatter to 11 %; three times that.
    for name, error in promised.items():
        scatter = np.std([estimate.value(name).value for estimate in found])
        assert scatter == pytest.approx(error, rel=0.34), name
