"""What the currents of a real arm are spent on: only what the logs can tell apart is told apart."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

import pumaid
from pumaid.io.recipe import shipped_recipes
from pumaid.io.table import LogReader
from pumaid.records import UNEXPLAINED
from pumaid.verbs.segment import segment

DATA = (
    Path(os.environ.get("PUMAID_REAL_DATA") or Path(__file__).parents[2] / "../shared/data") / "kinova-gen3-jointwise"
)

#: How the recordings are written.
LOG = (
    '\nlog: {time: Time, position: "Position{joint}", velocity: "Velocity{joint}", current: "Cur{joint}",'
    ' temperature: "Temp{joint}", units: {time: ms}}\n'
)


@pytest.fixture(scope="module")
def comparison(tmp_path_factory):
    """The Gen3's one run a joint, at one speed, and the model of them."""
    paths = sorted(DATA.glob("joint_*_trapez.parquet"))
    if not paths:
        pytest.skip(f"the recordings of a Kinova Gen3 are not in {DATA}")
    recipe = tmp_path_factory.mktemp("gen3") / "recipe.yaml"
    shutil.copy(shipped_recipes()["kinova_gen3"], recipe)
    recipe.write_text(recipe.read_text(encoding="utf-8") + LOG, encoding="utf-8")
    robot = pumaid.read_recipe(recipe)
    dataset = segment(LogReader(paths, robot), robot)
    return pumaid.compare(pumaid.identify(dataset, robot), dataset, robot)


def test_one_speed_leaves_friction_a_sum(comparison):
    """No joint's Coulomb and viscous friction have shares of their own, since each ran at one speed."""
    for score in comparison.joints:
        assert score.shares and not {"coulomb", "viscous"} & set(score.shares)


def test_weight_is_told_from_friction_over_a_long_way(comparison):
    """Joint 4 turned through more than two radians, so its weight has a share; not so joint 2's 0.9 rad."""
    assert {"gravity", "coulomb+viscous"} < set(comparison.joints[3].shares)
    assert set(comparison.joints[1].shares) == {"gravity+coulomb+viscous", UNEXPLAINED}
