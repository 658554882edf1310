"""Notes on models that do not fit: which joint, which file, and silence where they do."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import worlds
from faulty import csv, good, invoke, make

from pumaid.dataset import Dataset, Log
from pumaid.errors import ModelError
from pumaid.estimate import Value
from pumaid.estimation.estimate import identify, of_signs
from pumaid.estimation.nonlinear import check_better
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.preprocessing.segment import segment
from pumaid.robot import EffectChoice
from pumaid.simulation.hidden_effects import parse


def notes(folder: Path, tables, *, is_refused: bool = False) -> str:
    """What identifying logs with these tables says on standard error."""
    arm = make(folder / "arm")
    for number, table in enumerate(tables, start=1):
        (arm / "logs" / f"log_{number}.csv").write_text(csv(table), encoding="utf-8")
    found = invoke("identify", str(arm / "logs"))
    assert is_refused or found.exit_code == 0, found.stderr
    return found.stderr


@pytest.mark.parametrize(("place", "share"), [(1, 1.0), (0, 0.33), (2, 0.33)], ids=["a load", "first", "last"])
def test_the_log_that_disagrees_is_named(tmp_path, place, share):
    """Another load, or another sign in a short log: joint 1 is missed, and no log that is sound is named."""
    tables = list(good(passes=3))
    odd = tables[place].iloc[: int(share * len(tables[place]))]
    tables[place] = odd.assign(i1=odd.i1 + 3.5 * np.sin(odd.q1) if share == 1.0 else -odd.i1)
    lines = [line for line in notes(tmp_path, tables).splitlines() if line.startswith("note[logs-disagree]")]
    assert lines and all(f"log_{place + 1}.csv is inconsistent with the other logs" in line for line in lines)
    assert "joint 1" in lines[0] and (share < 1.0 or len(lines) == 1)


def test_a_joint_without_any_load_has_no_misfit(tmp_path):
    """Torque behind the gears of an upright axis is noise alone: nothing is missed."""
    rng = np.random.default_rng(3)
    told = notes(tmp_path, [table.assign(i1=rng.normal(0.0, 0.3, len(table))) for table in good(passes=3)])
    assert "model-misses" not in told


#: Slugs, one of which tells -> what is wrong with a column.
SIGNALS = {
    "current-unmeasured": lambda table: table.assign(i2=table.i1),
    "clock-jitter": lambda table: table.assign(t=table.t + 0.01 * (table.index % 2)),
    "model-misses logs-disagree": lambda table: table.assign(i1=table.i1.abs()),
    # One sample in a hundred is far off: noise floor and misfit grow alike, and still it is said.
    "current-spikes run-stands-out": lambda table: table.assign(
        i2=table.i2 - 3.0 * (np.random.default_rng(5).random(len(table)) < 0.01)
    ),
}


@pytest.mark.parametrize("slugs", SIGNALS)
def test_each_doubt_on_a_signal_has_its_note(tmp_path, slugs):
    """What is wrong with a column is told by name, or refused."""
    told = notes(tmp_path, [SIGNALS[slugs](table) for table in good()], is_refused=True)
    assert any(f"[{slug}]" in told for slug in slugs.split())


def test_a_run_that_is_not_like_the_others_is_named(tmp_path):
    """Something leaned on the arm within one run: the run is told with its joint, file and row."""
    first, *others = good(passes=3)
    speed = np.gradient(first.q1, first.t)
    begin = float(first.t[np.flatnonzero(speed > 0.3)[0]])
    touched = (first.t >= begin + 0.8) & (first.t < begin + 2.0)
    found = notes(tmp_path, [first.assign(i1=first.i1 + 1.0 * touched), *others])
    (line,) = [line for line in found.splitlines() if line.startswith("note[run-stands-out]")]
    assert "1 of " in line and "log_1.csv, row" in line and "joint 1" in line


def value(name: str, size: float, error: float) -> Value:
    """An identified parameter."""
    ends = (size - 2.0 * error, size + 2.0 * error)
    return Value(name, name, int(name.split(".")[1].lstrip("j")), "A", size, error, ends, 20.0)


@pytest.mark.parametrize(
    ("name", "ways", "size", "is_odd"),
    [
        ("gain_ratio.1.2", (1, 1), 0.5, False),
        ("gain_ratio.1.2", (1, 1), -0.5, True),
        ("gain_ratio.1.2", (1, -1), 0.5, True),
        ("gain_ratio.1.2", (1, -1), -0.5, False),
        ("inertia.j1.J", (1, 1), 0.3, False),
        ("inertia.j1.J", (1, 1), -0.3, True),
        ("inertia.j1.J", (-1, 1), -0.3, False),
        ("inertia.j1.J", (-1, 1), 0.3, True),
    ],
)
def test_what_has_the_other_sign_than_friction_is_told(name, ways, size, is_odd):
    """Friction opposes motion, so it tells how a motor counts; what may be zero has no sign."""
    sides = (("plus", 1.0), ("minus", -0.8))
    friction = [value(f"coulomb.j{j}.{side}", way * k, 0.02) for j, way in enumerate(ways, 1) for side, k in sides]
    assert [note.slug for note in of_signs([*friction, value(name, size, 0.01)])] == ["sign-odd"] * is_odd
    assert list(of_signs([*friction, value(name, size, 0.2)])) == []
    assert list(of_signs([value(name, size, 0.01)])) == []


def test_a_fit_with_more_effects_that_is_worse_is_refused():
    """As good as without them, or a third worse, passes; twice as bad went astray, and the message says where."""
    runs = worlds.dataset(worlds.drawn(worlds.PENDULUM), worlds.experiment(worlds.PENDULUM)).runs
    fitted = worlds.fit_runs(worlds.PENDULUM, runs)
    sizes = {joint: row.rmse for joint, row in fitted.by_bin.items()}
    check_better(sizes, fitted, ["payload"])
    check_better({joint: size / 1.3 for joint, size in sizes.items()}, fitted, ["payload"])
    with pytest.raises(ModelError, match="the fit with payload misses joint 2") as refused:
        check_better(sizes | {2: sizes[2] / 2.0}, fitted, ["payload"])
    assert refused.value.slug == "effects-astray" and refused.value.where.joint == 2


def test_a_missing_spring_accuses_no_run():
    """Where the model lacks a spring no run stands out; with it in the model, one that met something does."""
    robot, spring = worlds.PENDULUM, [EffectChoice("spring", 2)]
    truth = worlds.drawn(robot).hiding((parse("spring@2", robot),))
    runs = worlds.dataset(truth, worlds.experiment(robot, speeds=(0.2, 0.5, 1.0), repeats=2)).runs
    told = [note.slug for note in identify(Dataset(runs), robot).notes]
    assert "model-misses" in told and "run-stands-out" not in told
    assert identify(Dataset(runs), robot, effects=spring).notes == ()
    last, size = runs[-1], len(runs[-1].bins) // 3
    met = np.where(np.arange(len(last.bins)) < size, 20.0 * truth.noise.std[1], 0.0)
    touched = replace(last, bins=replace(last.bins, current=last.bins.current + met))
    (note,) = identify(Dataset((*runs[:-1], touched)), robot, effects=spring).notes
    assert note.slug == "run-stands-out" and note.where.joint == last.joint


PENDULUM = read_recipe(shipped_recipes()["pendulum2"])


def noted(tables: tuple[pd.DataFrame, ...]) -> list[tuple[str, str]]:
    """Slug and text of the notes on logs with these tables, one file each."""
    logs = []
    for number, table in enumerate(tables, start=1):
        q, i = table[["q1", "q2"]].to_numpy(), table[["i1", "i2"]].to_numpy()
        rows, time = np.arange(2, 2 + len(table)), table.t.to_numpy()
        logs.append(Log(f"log_{number}.csv", rows, time, q, None, i, starts_clock=number == 1))
    return [(note.slug, note.text) for note in identify(segment(logs, PENDULUM), PENDULUM).notes]


def told(tables: tuple[pd.DataFrame, ...]) -> list[str]:
    """The notes on repeats."""
    return [text for slug, text in noted(tables) if slug == "repeats-differ"]


def test_good_logs_are_passed_in_silence():
    """Ten sessions of two joints, with noise of samples and of runs, on seeds that no threshold was chosen on."""
    assert [noted(good(seed)) for seed in range(500, 510)] == [[]] * 10


@pytest.mark.parametrize("share", [0.0, 1e-9, 3e-4])
def test_what_no_noise_hides_need_not_matter(share):
    """Where currents are without noise, rounding or a gain that is a few parts in ten thousand off is no change."""
    first, second = (exact(table) for table in good(0))
    assert told((first, second.assign(i1=(1.0 + share) * second.i1, i2=second.i2 + share))) == []


def exact(table: pd.DataFrame) -> pd.DataFrame:
    """The log with currents that are a function of position and speed alone."""
    moves = [np.sign(table[name]) * (table[name].abs() > 0.05) for name in ("qd1", "qd2")]
    i1 = 0.8 * np.cos(table.q1) + 0.3 * np.cos(table.q1 + table.q2) + 0.4 * moves[0] + 0.2 * table.qd1
    return table.assign(i1=i1, i2=0.3 * np.cos(table.q1 + table.q2) + 0.3 * moves[1] + 0.1 * table.qd2)


@pytest.mark.parametrize(
    ("change", "where", "size"),
    [
        (lambda table: table.assign(i1=table.i1 + 0.05), "A more whichever way it moves", 0.05),
        (
            lambda table: table.assign(i1=table.i1 - 0.06 * np.sign(table.qd1) * (table.qd1.abs() > 0.05)),
            "A less in the direction of motion",
            0.06,
        ),
        (lambda table: table.assign(i1=1.04 * table.i1), "% more in proportion to it", 4.0),
    ],
    ids=["zero", "friction", "gain"],
)
def test_a_change_is_told_with_its_size(change, where, size):
    """A sensor's zero, friction and a gain that are others in the second pass, by three times the noise at most."""
    first, second = good(600)
    (text,) = told((first, change(second)))
    assert where in text and text.startswith("joint 1 draws ")
    number, error = (float(part) for part in text.removeprefix("joint 1 draws ").split()[:3:2])
    assert abs(number - size) < 5.0 * error


def test_what_is_no_change_is_not_told():
    """What moves no number by more than its error, and one pass of runs, which has nothing to be compared with."""
    first, second = good(7)
    assert told((first, second.assign(i1=second.i1 + 0.005))) == [] == told((first,))
