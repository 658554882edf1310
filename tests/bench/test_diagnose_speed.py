"""How long a diagnosis of six joints takes after the pass over the logs: printed, not judged."""

from __future__ import annotations

import time

import numpy as np
import pytest
from searches import design

from pumaid.dataset import Dataset
from pumaid.diagnosis.diagnose import diagnose
from pumaid.estimation.estimate import identify
from pumaid.simulation import Bench, Hidden, table1

#: What hides -> the effects that may be named for it; nothing: none may.
HIDDEN = {
    "nothing": (),
    "ripple": (Hidden("ripple", 5, {"cos": 0.02, "sin": 0.01, "frequency": 31.0}),),
    "tilt": (Hidden("tilt", None, {"x": 0.01, "y": -0.005}),),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", HIDDEN)
def test_diagnosis_of_360_runs(name, capsys):
    """384 runs of the PUMA, 512 bins each, the whole catalogue: what hides is named, and the seconds are told."""
    truth = table1.puma560().hiding(HIDDEN[name])
    plan = design(truth.robot, postures=4, repeats=2)
    runs = Bench(truth, plan, rate=200.0, bins=512).runs(np.random.default_rng(7))
    begun = time.process_time()
    estimate = identify(Dataset(runs), truth.robot)
    fitted = time.process_time()
    found = diagnose(estimate, Dataset(runs), truth.robot)
    done = time.process_time()
    with capsys.disabled():
        print(
            f"\n{name}: {len(runs)} runs, fit {fitted - begun:.2f} s, diagnosis {done - fitted:.2f} s of processor time"
        )
    named = {effect for one in found.findings for effect in (one.effect, *one.rivals)}
    assert len(runs) >= 360
    assert (name in named) if HIDDEN[name] else not named
