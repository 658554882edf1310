"""What is assumed of an arm: payloads against masses, earlier models at their word."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from menus import arm, names

from pumaid.dataset import Dataset
from pumaid.design.information import predicted_errors
from pumaid.design.plan import plan
from pumaid.design.prior import loaded, robot_of_estimate
from pumaid.estimate import Estimate
from pumaid.estimation.estimate import identify
from pumaid.robot import Joint, Robot
from pumaid.simulation import Bench, Links, draw, table1

#: Upright it hides all that its first link weighs.
TURRET = Robot("turret", (Joint(1, "turn", "revolute"), Joint(2, "nod", "revolute", alpha=np.pi / 2, a=0.2)))


def test_a_tilt_shows_what_an_upright_base_hides():
    """Upright a note says that a tilt would show joint 1's weight; with it they are promised, and the note is gone."""
    upright, tilted = plan(TURRET, seed=1), plan(replace(TURRET, gravity=(0.0, -2.9, -9.4)), seed=1)
    hidden = {"gravity.l1.x", "gravity.l1.y", "gain_ratio.1.2"}
    assert hidden <= set(upright.unseen)
    assert "plan-needs-tilt" in [note.slug for note in upright.notes]
    assert hidden <= set(tilted.expected)
    assert "plan-needs-tilt" not in [note.slug for note in tilted.notes]


@pytest.mark.parametrize("name", ["puma560", "stanford", "kinova_gen3", "pendulum2"])
def test_payload_is_part_of_the_last_link(name):
    """Joints feel a payload as a last link that is two point masses, also where only constants in amperes are known."""
    truth = draw(arm(name), 3)
    mass, centre = truth.links.mass.copy(), truth.links.centre.copy()
    mass[-1] += 0.5
    centre[-1] = (truth.links.mass[-1] * centre[-1] + 0.5 * np.array([0.1, 0.02, -0.03])) / mass[-1]
    q = np.random.default_rng(1).uniform(-2.0, 2.0, (20, truth.robot.n_joints))
    wanted = replace(truth, links=Links(mass, centre)).gravity_current(q)
    payload, known = (0.5, 0.1, 0.02, -0.03), truth.with_constants(truth.constants)
    assert loaded(truth, payload).gravity_current(q) == pytest.approx(wanted, abs=1e-9)
    # The last motor's gain is then taken from another robot.
    share = draw(arm(name), 0).gain[-1] / truth.gain[-1]
    added = loaded(known, payload).gravity_current(q) - truth.gravity_current(q)
    assert added == pytest.approx(abs(share) * (wanted - truth.gravity_current(q)), abs=1e-9)


def test_payload_shows_the_papers_last_ratio():
    """On the paper's PUMA eta_5/eta_6 is dark, a note says what shows it, and with that payload it is seen."""
    truth = table1.puma560()
    runs = Bench(truth, table1.experiment(), rate=25.0).runs(np.random.default_rng(2))
    prior, name = identify(Dataset(runs), truth.robot), "gain_ratio.5.6"
    value = abs(robot_of_estimate(truth.robot, prior).robots[0].parameters()[name])
    bare, carrying = (
        plan(truth.robot, minutes=10, prior=prior, payload=payload, seed=1) for payload in (None, (0.5, 0.1, 0.0, 0.0))
    )
    assert bare.expected[name] > 0.5 * value
    assert "--payload 0.5,0.1,0,0" in next(note.text for note in bare.notes if note.slug == "plan-needs-weight")
    assert carrying.expected[name] < 0.05 * value
    assert "plan-needs-weight" not in [note.slug for note in carrying.notes]


@cache
def earlier(seed: int) -> Estimate:
    """A model of a pendulum that was drawn, from its first experiment."""
    runs = Bench(draw(arm("pendulum2"), seed), plan(arm("pendulum2"), minutes=6, seed=1), rate=50.0)
    return identify(Dataset(runs.runs(np.random.default_rng(seed))), arm("pendulum2"))


@pytest.mark.parametrize("seed", [41, 42])
def test_an_earlier_model_makes_a_better_plan(seed):
    """For the robot itself the plan by its model promises no worse errors, within 1 %, than that by the recipe."""
    robot, truth, means = arm("pendulum2"), draw(arm("pendulum2"), seed), []
    for model in (None, earlier(seed)):
        made = plan(robot, minutes=6, prior=model, seed=1)
        means.append(np.mean(np.log(list(predicted_errors([truth], made.motions, names(robot)).values()))))
    assert means[1] <= means[0] + 0.01


def test_an_earlier_model_is_taken_at_its_word():
    """The robot that is planned for has the model's parameters; a sample's noise is about that of the robots."""
    shares = []
    for seed in (41, 42):
        assumed = robot_of_estimate(arm("pendulum2"), earlier(seed))
        (truth,) = assumed.robots
        values = {value.name: value.value for value in earlier(seed).values if value.state == "identified"}
        assert {name: truth.parameters()[name] for name in values} == pytest.approx(values)
        assert len(assumed.sentences) == 1
        shares.append(truth.noise.std / draw(arm("pendulum2"), seed).noise.std)
    assert np.all((np.mean(shares, axis=0) > 0.9) & (np.mean(shares, axis=0) < 1.7))
