"""How effects are shown: facts, signatures, the plot of letters, pictures and the manual's page."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from pumaid.cli import group
from pumaid.effects import catalogue
from pumaid.reporting.effects import facts, merged, signature, sketch

NAMES = sorted(catalogue())
PAGE = (Path(__file__).parents[2] / "docs" / "effects.md").read_text(encoding="utf-8")


def run(*arguments):
    """``pumaid`` with these arguments."""
    return CliRunner().invoke(group, list(arguments), env={"COLUMNS": "400"})


@pytest.mark.parametrize("name", NAMES)
def test_signature_is_a_finite_curve(name):
    """Every effect has a current to show, and one that varies unless it is Coulomb's."""
    shown = signature(catalogue()[name])
    curves = np.array([shown.forward, shown.backward])
    assert np.isfinite(curves).all() and np.abs(curves).max() > 0
    assert name == "coulomb" or np.ptp(shown.forward) > 0


@pytest.mark.parametrize(
    ("name", "variable"),
    [
        ("stribeck", "speed"),
        ("load_friction", "load"),
        ("torque_droop", "predicted current"),
        ("presliding", "travel"),
        ("warmup", "time"),
        ("thermal_friction", "temperature"),
        ("inertia", "acceleration"),
        ("delay", "position"),
        ("payload", "time"),
        ("ripple", "position"),
    ],
)
def test_signature_is_against_its_own_variable(name, variable):
    """The picture is against what the effect depends on."""
    assert signature(catalogue()[name]).variable == variable


def test_signature_knows_what_friction_is():
    """Friction turns round with the motion, a spring does not."""
    friction, spring = signature(catalogue()["stribeck"]), signature(catalogue()["spring"])
    assert np.allclose(friction.forward, -friction.backward) and not friction.is_same_both_ways
    assert spring.is_same_both_ways


def test_a_ripple_shows_three_periods():
    """The range follows the effect's frequency: three periods, so five or six changes of sign."""
    forward = signature(catalogue()["ripple"]).forward
    assert (np.diff(np.sign(forward)) != 0).sum() in (5, 6)


def test_sketch_puts_letters_where_the_curve_is():
    """The first letter of a falling friction is in the top line, its mirror image in the bottom line."""
    shown = signature(catalogue()["stribeck"])
    lines = sketch(shown, width=40, height=9).splitlines()
    assert len(lines) == 11 and "speed (rad/s)" in lines[-1]
    assert lines[1].split("|")[1].startswith("o") and lines[9].split("|")[1].startswith("x")


def test_alike_parameters_are_told_once():
    """What a turning and a sliding joint have alike is one row, what differs in unit is two."""
    assert [one["owner"] for one in merged(facts(catalogue()["stribeck"])["parameters"])] == ["any"]
    assert [one["unit"] for one in merged(facts(catalogue()["spring"])["parameters"])] == ["A/rad", "A/m"]


@pytest.mark.parametrize("name", NAMES)
def test_explaining_tells_everything(name):
    """One effect's page has its equation, parameters, look-alikes, command and source."""
    told, effect = run("effects", name).stdout, catalogue()[name]
    assert effect.equation in told and effect.source in told and "signature" in told
    assert all(other in told for other in effect.look_alikes)
    assert effect.base or f"--add {name}" in told


def test_list_names_every_effect_with_its_equation():
    """The table of all effects has a line for each."""
    told = run("effects").stdout
    assert all(name in told and effect.equation in told for name, effect in catalogue().items())


def test_json_holds_it_all():
    """Other programs get what people get: shapes with bounds, look-alikes, the command, the points of the signature."""
    (one,) = json.loads(run("effects", "stribeck", "--json").stdout)["effects"]
    assert {shape["name"] for shape in one["shapes"]} == {"velocity", "exponent"}
    assert one["look_alikes"] and one["command"].endswith("--add stribeck@5") and one["equation"]
    assert len(one["signature"]["values"]) == len(one["signature"]["forward"]) > 20


def test_manual_has_every_effect():
    """docs/effects.md has a table of all effects first and a section for each, with its equation and source."""
    sections = dict(re.findall(r"^## (\w+)\n(.*?)(?=^## |\Z)", PAGE, re.DOTALL | re.MULTILINE))
    table = PAGE.split("## ")[0]
    for name, effect in catalogue().items():
        assert f"[{name}](#{name})" in table and effect.equation in table
        assert effect.source in sections[name]
        assert all(f"- `{one['name']}`" in sections[name] for one in facts(effect)["parameters"])
    assert set(sections) == set(catalogue())
