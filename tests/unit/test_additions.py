"""What ``--apply`` does when a refit with what was found misses the fitted runs by more than before."""

from dataclasses import replace

import pytest
from searches import lever

from pumaid.cli.additions import added
from pumaid.dataset import Dataset
from pumaid.diagnosis.records import ADD, Diagnosis, Finding


def stretched(estimate, factor):
    """The same fit, every joint missed by `factor` times as much."""
    return replace(estimate, joints=tuple(replace(one, rmse=factor * one.rmse) for one in estimate.joints))


@pytest.mark.parametrize(("factor", "kept"), [(1.2, 0), (0.9, 1)])
def test_what_makes_the_fit_worse_is_left_out(monkeypatch, tmp_path, factor, kept):
    """The model on disk stays, the user is told both errors, and nothing more is added; a better fit is kept."""
    lab, told = lever(), []
    estimate = replace(lab.estimate, joints=tuple(replace(one, rmse=0.02) for one in lab.estimate.joints))
    monkeypatch.setattr("pumaid.estimation.estimate.identify", lambda *args, **more: stretched(estimate, factor))
    found = Finding("spring", 1, {}, ADD, "", 0.001, rivals=("counterbalance",))
    diagnosis = Diagnosis(lab.robot.name, (), (found,))
    more = {"model": tmp_path / "model.json", "tell": told.append}
    more["again"] = lambda model: replace(diagnosis, findings=())
    done, last = added(diagnosis, estimate, Dataset(lab.runs), robot=lab.robot, **more)
    assert len(done.applied) == kept
    assert last.joints[0].rmse == pytest.approx(0.02 * (factor if kept else 1.0))
    assert ("Not added" in told[0]) is (kept == 0) and len(told) == 1
    if kept:
        assert "Added spring at joint 1 (joint 1) (these data do not separate it from counterbalance)." in told[0]
    else:
        assert "from 0.0200 A to 0.0240 A" in told[0]
