"""The segmentation's picture and tables, from evidence alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from motion_worlds import World, make, robot

from pumaid.dataset import Dataset
from pumaid.reporting.runs import by_reason, left_grid, run_grid, shortened
from pumaid.reporting.segments import draw
from pumaid.verbs.segment import segment


def dataset_of(**more):
    """Evidence of a small world."""
    world = World(motions=4, rate=200.0, **more)
    return segment(make(world, 3).logs, robot(world)), robot(world)


def test_axes_carry_the_units():
    """Velocity above position, in the unit asked for, time in seconds below."""
    figure = draw(*dataset_of(), units="deg")
    above, below = figure.axes
    assert (above.get_ylabel(), below.get_ylabel()) == ("velocity (deg/s)", "position (deg)")
    assert below.get_xlabel() == "time (s)"


def test_legend_names_joints_and_reasons():
    """Each joint with runs and each reason has its entry, with its share."""
    dataset, arm = dataset_of()
    (legend,) = draw(dataset, arm).legends
    words = " ".join(text.get_text() for text in legend.get_texts())
    assert "1 j1: 2 runs" in words
    assert all(reason in words for reason in by_reason(dataset.rejects))


def test_speeds_are_drawn_in_the_unit():
    """The highest drawn speed is the fastest run's, in degrees per second."""
    dataset, arm = dataset_of(speeds=(0.5, 0.5001))
    above = draw(dataset, arm, units="deg").axes[0]
    tops = [path.vertices[:, 1].max() for item in above.collections for path in item.get_paths() if len(path.vertices)]
    assert np.isclose(max(tops), np.degrees(0.5), rtol=0.03)


def test_many_runs_go_over_strips():
    """A long campaign is split into strips that share the time evenly."""
    dataset, arm = dataset_of()
    many = Dataset(dataset.runs * 25, dataset.rejects)
    axes = draw(many, arm).axes
    assert len(axes) == 2 * 3
    widths = [np.ptp(axis.get_xlim()) for axis in axes]
    np.testing.assert_allclose(widths, widths[0])


def test_nothing_can_be_drawn_and_told():
    """No evidence gives an empty picture and empty tables, not an error."""
    arm = robot(World())
    assert len(draw(Dataset(()), arm).axes) == 2
    assert run_grid(Dataset(()), arm).rows == ()
    assert left_grid(Dataset(())).rows == ()


def test_names_lose_shared_folders_only():
    """File names stay different and as short as that allows."""
    assert shortened(["a/b/c.csv", "a/x.csv"]) == {"a/b/c.csv": "b/c.csv", "a/x.csv": "x.csv"}
    assert shortened(["/a/b.csv", "x.csv"]) == {"/a/b.csv": "/a/b.csv", "x.csv": "x.csv"}
    assert shortened(["-"]) == {"-": "-"}


def test_the_table_shows_short_names_and_units():
    """Files without their shared folders, times to a hundredth, speeds in the unit of the header."""
    dataset, arm = dataset_of(speeds=(0.5, 0.5001))
    moved = replace(dataset, runs=tuple(replace(run, origin=f"logs/day/{run.origin}") for run in dataset.runs))
    shown = run_grid(moved, arm, units="deg")
    row = {head.text: cell.text for head, cell in zip(shown.header, shown.rows[0], strict=True)}
    assert row["file"] == "log_0.csv"
    assert row["start s"] == f"{dataset.runs[0].start:.2f}"
    assert np.isclose(float(row["speed °/s"]), np.degrees(0.5), rtol=0.01)
