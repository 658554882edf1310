"""Small models and ladders by hand, for tests of what keeps and shows them."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from pumaid.estimate import Estimate, JointFit, Value
from pumaid.results.history import Ladder, Rung, keep
from pumaid.robot import EffectChoice, Joint, Robot

ARM = Robot("arm", (Joint(1, "a", "revolute"), Joint(2, "b", "revolute")), origin="recipe.yaml", digest="aa" * 32)
STRIBECK, RIPPLE = EffectChoice("stribeck", 1, {"velocity": 0.1}), EffectChoice("ripple", 2, {"frequency": 50.0})


def model(*effects: EffectChoice, rmse: float = 0.03, samples: int = 300, **changes: object) -> Estimate:
    """A model of two joints, the second with a third of the first's samples and twice its error."""
    joints = (JointFit(1, 9, samples, rmse, 0.01), JointFit(2, 3, samples // 3, 2 * rmse, 0.01))
    empty = np.zeros((0, 0))
    value = Value("coulomb.j1.plus", "c1", 1, "A", rmse, 0.1, (0.0, 1.0))
    found = Estimate("arm", joints, (value,), (), np.zeros(0), empty, np.triu(np.ones((2, 2))), empty, effects)
    told = {
        "recipe_digest": ARM.digest,
        "geometry": ARM.geometry,
        "origin": "recipe.yaml",
        "logs": {"a.csv": "cd" * 32},
    } | changes
    return replace(found, **told)


def experiment(results: Path) -> Path:
    """Three kept models: the base, with Stribeck friction, with ripple as well. Returns the current model's file."""
    path = results / "model.json"
    keep(path, model())
    keep(path, model(STRIBECK, rmse=0.02))
    keep(path, model(STRIBECK, RIPPLE, rmse=0.011))
    return path


def ladder(n_models: int, n_joints: int, *, heldout: bool = True, floor: bool = True) -> Ladder:
    """Models whose errors halve with each effect above a floor of 0.01 A; held-out errors are a tenth larger."""
    rungs, effects = [], ()
    for number in range(1, n_models + 1):
        added = () if number == 1 else (EffectChoice("torque_constant_drift", 1 + number % n_joints),)
        effects += added
        rmse = 0.01 + 0.1 * 0.5**number
        judged = 1.1 * rmse if heldout else None
        fit = JointFit(1, 9, 300, rmse, 0.01 if floor else None, heldout_runs=2, heldout=judged)
        joints = tuple(replace(fit, joint=joint) for joint in range(1, n_joints + 1))
        estimate = model(*effects, joints=joints)
        rungs.append(Rung(number, Path(), f"{number}", estimate, parent=number - 1 or None, added=added))
    return Ladder("arm", "", {}, tuple(rungs))
