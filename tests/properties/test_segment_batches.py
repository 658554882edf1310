"""How logs are cut into batches, windows and files changes nothing; every sample is accounted for."""

from dataclasses import replace

import numpy as np
import pytest
from motion_worlds import World, make, robot, score

from pumaid.dataset import Log
from pumaid.preprocessing.binning import SegmentOptions
from pumaid.preprocessing.segment import segment


def batches(logs, size):
    """The same samples in batches of `size`."""
    for log in logs:
        for low in range(0, len(log), size):
            yield replace(log.part(slice(low, low + size)), starts_clock=log.starts_clock and low == 0)


def outline(dataset):
    """All that must agree."""
    runs = [(r.kind, r.joint, r.origin, r.first_row, r.last_row) for r in dataset.runs]
    return runs, [(r.reason, r.origin, r.first_row, r.last_row, r.samples, r.text) for r in dataset.rejects]


@pytest.mark.parametrize("size", [7, 1000, 30_000])
@pytest.mark.parametrize(
    "more", [{"files": 3, "rate": 100.0}, {"strokes": True, "rate": 50.0}], ids=["runs", "strokes"]
)
def test_batch_size_changes_nothing(size, more):
    world = World(**more)
    logs = make(world, 11).logs
    whole, parts = segment(logs, robot(world)), segment(batches(logs, size), robot(world))
    assert outline(parts) == outline(whole)
    for one, other in zip(parts.runs, whole.runs, strict=True):
        np.testing.assert_allclose(one.bins.current, other.bins.current, rtol=1e-9)
        np.testing.assert_allclose(one.bins.velocity, other.bins.velocity, rtol=1e-9)


@pytest.mark.parametrize("window", [2048, 5000, 16_384])
def test_a_run_longer_than_the_window_is_cut_in_few(window):
    """Runs that span several windows are found as precisely, in about as many pieces as there are windows."""
    world = World(plateau=(4.0, 9.0), motions=6)
    truth = make(world, 12)
    found = score(truth, segment(truth.logs, robot(world), options=SegmentOptions(window=window)))
    assert found.runs <= 6 + 2 * len(truth.joint) / window
    assert found.right > 0.97 * found.true and found.bias < 0.5


def test_strokes_without_rest_are_found_across_windows():
    """Where a joint swings to and fro for ever, windows are cut where it turns."""
    time = np.arange(40_000) / 200.0
    position = np.column_stack([np.cos(time), np.zeros_like(time)])
    log = Log("swing.csv", np.arange(40_000) + 2, time, position, None, np.ones((40_000, 2)), None, True)
    runs = segment([log], robot(World(joints=2)), options=SegmentOptions(window=4096)).runs
    assert len(runs) >= 0.95 * time[-1] / np.pi and {run.kind for run in runs[1:-1]} == {"stroke"}


@pytest.mark.parametrize("seed", range(3))
def test_every_sample_is_kept_or_rejected_once(seed):
    """Rows of runs and rejects cover the log without overlap, whatever is wrong with it."""
    rng = np.random.default_rng(seed)
    world = World(motions=6, twitch=seed % 2 == 0, gap=True, files=2, rate=200.0)
    logs = []
    for log in make(world, seed).logs:
        position, current = log.position.copy(), log.current.copy()
        position[rng.integers(0, len(log), 5), 0] = [np.nan, np.inf, 1e298, -1e300, np.nan]
        current[rng.integers(0, len(log), 40)] = np.nan
        logs.append(replace(log, position=position, current=current))
    dataset = segment(logs, robot(world), options=SegmentOptions(window=2048 if seed % 3 else 10**6))
    kept = sum(run.samples for run in dataset.runs)
    assert kept + sum(reject.samples for reject in dataset.rejects) == sum(len(log) for log in logs)
