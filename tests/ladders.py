"""Small models by hand, for tests of what keeps and shows them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from pumaid.files.archive import keep
from pumaid.records import EffectChoice, Estimate, Joint, JointFit, Robot, Value

ARM = Robot("arm", (Joint(1, "a", "revolute"), Joint(2, "b", "revolute")), origin="recipe.yaml", digest="aa" * 32)
STRIBECK, RIPPLE = EffectChoice("stribeck", 1, {"velocity": 0.1}), EffectChoice("ripple", 2, {"frequency": 50.0})


def model(*effects: EffectChoice, rmse: float = 0.03, samples: int = 300, **changes: object) -> Estimate:
    """A model of two joints, the second with a third of the first's samples and twice its error."""
    joints = (JointFit(1, 9, samples, rmse, 0.01), JointFit(2, 3, samples // 3, 2 * rmse, 0.01))
    empty = np.zeros((0, 0))
    value = Value("coulomb.j1.plus", "c1", 1, "A", rmse, 0.1, (0.0, 1.0))
    found = Estimate("arm", joints, (value,), (), np.zeros(0), empty, np.ones((2, 2)), empty, effects)
    told = {"recipe_digest": ARM.digest, "origin": "recipe.yaml", "logs": {"a.csv": "cd" * 32}} | changes
    return replace(found, **told)


def experiment(results: Path) -> Path:
    """Three kept models: the base, with Stribeck friction, with ripple as well. Returns the current model's file."""
    path = results / "model.json"
    keep(path, model(), ARM)
    keep(path, model(STRIBECK, rmse=0.02), ARM)
    keep(path, model(STRIBECK, RIPPLE, rmse=0.011), ARM)
    return path
