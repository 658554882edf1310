"""The truth as a document: all of it comes back, and its parameters are what currents show."""

import json
from dataclasses import replace

import numpy as np
import pytest

from pumaid.errors import ModelError
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.results.truth_file import as_json, from_json
from pumaid.simulation import Hidden, draw, table1
from pumaid.simulation.hidden_effects import LAWS


@pytest.mark.parametrize("truth", [draw(table1.robot(), 3), table1.puma560()], ids=["masses", "constants"])
def test_truth_remembers(truth):
    """A truth's document brings it back, hidden effects with all values; an early one breaks away at 1.1."""
    names = set(LAWS) - {"payload", "side_load_friction", "coupling"}
    truth = truth.hiding([Hidden(name) for name in sorted(names)])
    document = json.loads(json.dumps(as_json(truth)))
    again = from_json(document, truth.robot)
    assert again.hidden == truth.hidden and as_json(again, seed=truth.seed) == document
    del document["breakaway"]
    assert np.all(from_json(document, truth.robot).breakaway == 1.1)


def test_the_truth_tells_what_currents_show_of_a_slide():
    """What a lift carries is part of its Coulomb terms in `parameters`, as identify finds it, and not in `friction`."""
    robot = read_recipe(shipped_recipes()["pendulum2"])
    lift = replace(robot, joints=(replace(robot.joints[0], kind="prismatic", alpha=0.0), robot.joints[1]))
    truth = draw(lift, 1)
    document, load = as_json(truth), truth.gravity_current(np.zeros((1, 2)))[0, 0]
    assert abs(load) > 0.1
    for side in ("plus", "minus"):
        friction = document["friction"][f"coulomb_{side}"][0]
        assert document["parameters"][f"coulomb.j1.{side}"] == pytest.approx(friction + load, rel=1e-8)


@pytest.mark.parametrize(
    ("name", "entry"),
    [
        ("kind", "model"),
        ("mass", [1.0]),
        ("centre", "here"),
        ("friction", None),
        ("friction", {"coulomb_plus": [1.0] * 6}),
        ("noise", {"std": 0.1}),
        ("inertia", [float("nan")] * 6),
        ("gain", None),
        ("hidden", [{"effect": "magic", "joint": 1, "values": {}}]),
        ("hidden", [{"effect": "spring", "joint": 9, "values": {"a": 1.0}}]),
        ("hidden", [{"effect": "spring", "joint": 1, "values": {"a": None}}]),
        ("hidden", "spring"),
    ],
)
def test_a_damaged_truth_is_refused(name, entry):
    """Whatever is missing, of another size or no number is told as what it is."""
    truth = draw(table1.robot(), 3)
    with pytest.raises(ModelError, match="truth-wrong"):
        from_json(as_json(truth) | {name: entry}, truth.robot)
