"""How effects are shown: facts, signatures, and what a terminal prints."""

import numpy as np
import pytest
from command import answer, run

from pumaid.effects import catalogue
from pumaid.reporting.effects import effect_parts, facts, merged, signature

NAMES = sorted(catalogue())


@pytest.mark.parametrize("name", NAMES)
def test_signature_is_a_finite_curve(name):
    """Every effect has a current to show, and one that varies unless it is Coulomb's."""
    shown = signature(catalogue()[name])
    curves = np.array([shown["forward"], shown["backward"]])
    assert np.isfinite(curves).all() and np.abs(curves).max() > 0
    assert name == "coulomb" or np.ptp(shown["forward"]) > 0


def test_the_signature_is_told_in_points():
    """Forward friction falls from point to point, and backward it is the same with the other sign."""
    table = effect_parts(facts(catalogue()["stribeck"]))[-2]
    speed, forward, backward = np.array(table.rows, dtype=float).T
    assert table.header[0] == "speed (rad/s)" and len(speed) > 10 and (np.diff(speed) > 0.0).all()
    assert forward[0] > 0.0 and (np.diff(forward) <= 0.0).all() and (backward == -forward).all()


def test_alike_parameters_are_told_once():
    """What a turning and a sliding joint have alike is one row, both units if they differ."""
    assert [item["owner"] for item in merged(facts(catalogue()["stribeck"])["parameters"])] == ["any"]
    assert [item["unit"] for item in merged(facts(catalogue()["spring"])["parameters"])] == ["A/rad or A/m"]


@pytest.mark.parametrize("name", ["stribeck", "payload", "gravity", "counterbalance"])
def test_explaining_tells_everything(name):
    """The list has each effect; one effect's page its equation, parameters, look-alikes, command and source."""
    assert name in run("effects", env={"COLUMNS": "400"}).stdout
    told, effect = run("effects", name, env={"COLUMNS": "400"}).stdout, catalogue()[name]
    assert effect.equation in told and effect.source in told and "signature" in told
    assert all(other in told for other in effect.look_alikes)
    assert effect.base or f"--add {name}" in told


def test_json_holds_it_all():
    """Other programs get what people get: shapes with bounds, look-alikes, the command, the points of the signature."""
    (one,) = answer("effects stribeck")["effects"]
    assert {shape["name"] for shape in one["shapes"]} == {"velocity", "exponent"}
    assert one["look_alikes"] and one["command"].endswith("--add stribeck@5") and one["equation"]
    assert len(one["signature"]["values"]) == len(one["signature"]["forward"]) > 20
