"""What must not matter in log files: the size of a current, units, order of files, cuts, single precision, names."""

import json
import shutil
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from faulty import COLUMNS, RECIPE, csv, fitted, good, intervals, invoke, parquet
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

FEW = settings(
    max_examples=4, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
#: Share of a standard error.
ROUNDING = 1e-3
#: The same where rounding of times may move the edge of a stretch by a sample (seen: 0.41).
EDGE = 0.5
DEG = 180 / np.pi
#: Entries of a joint that say how well it is known.
FLOORS = ("rmse", "noise_floor", "run_level")


def model(folder: Path, tables, *, recipe: str = RECIPE, names=("a.csv", "b.csv"), order=None) -> dict:
    """The model document of some logs in an empty folder."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    (folder / "recipe.yaml").write_text(recipe, encoding="utf-8")
    for name, table in zip(names, tables, strict=True):
        data = parquet(table) if name.endswith("parquet") else csv(table).encode()
        (folder / name).write_bytes(data)
    found = invoke("identify", *(str(folder / name) for name in order or names), "--json")
    assert found.exit_code == 0, found.stderr
    return json.loads(found.stdout)


def assert_scaled(found: dict, *, factor: float = 1.0, share: float = ROUNDING, without: str = "none") -> None:
    """Parameters, but for ratios, are `factor` times those of the good logs, to a share of their errors."""
    # Names that start with `without` are not compared.
    new, old = intervals(found), intervals(fitted())
    assert new.keys() == old.keys()
    for name, (value, low, high) in old.items():
        if name.startswith(without):
            continue
        times = 1.0 if name.startswith("gain_ratio") else factor
        error = share * times * (high - low) / 4
        assert new[name] == pytest.approx((times * value, times * low, times * high), abs=error), name


def test_currents_beyond_any_recorder_are_refused(tmp_path):
    """A million times as large they are beyond 1e6 A, and taken for garbage of the recorder."""
    (tmp_path / "recipe.yaml").write_text(RECIPE, encoding="utf-8")
    (tmp_path / "a.csv").write_text(csv(good()[0].assign(i1=1e6 * good()[0].i1)), encoding="utf-8")
    found = invoke("identify", str(tmp_path / "a.csv"))
    assert found.exit_code == 3 and "bad-samples" in found.stderr


UNITS = {
    "current: mA": {"i1": 1e3, "i2": 1e3},
    "time: ms": {"t": 1e3},
    "time: us": {"t": 1e6},
    "position: deg, velocity: deg/s": {"q1": DEG, "q2": DEG, "qd1": DEG, "qd2": DEG},
    "position: deg, velocity: rad/s": {"q1": DEG, "q2": DEG},
}


def _signs(names: str) -> dict[str, float]:
    return dict.fromkeys(names.split(), -1.0)


#: What a recipe's log block says, and by what each column is multiplied.
SAME = {
    **{f"units: {{{units}}}": factors for units, factors in UNITS.items()},
    "signs: {current: [-1, -1]}": _signs("i1 i2"),
    "signs: {position: [-1, -1]}": _signs("q1 q2 qd1 qd2"),
}


@pytest.mark.parametrize("words", SAME)
def test_units_and_signs_change_nothing(tmp_path, words):
    """The same logs in other units, or with columns that count the other way, said in the recipe, are the same logs."""
    tables = [table.assign(**{name: f * table[name] for name, f in SAME[words].items()}) for table in good()]
    found = model(tmp_path / "arm", tables, recipe=f"{RECIPE}log: {{{words}}}\n")
    assert_scaled(found, share=EDGE if "time" in words else ROUNDING)


def test_order_of_files_changes_nothing(tmp_path):
    """Logs may be named in any order; where times do not follow, each has a clock of its own."""
    found = model(tmp_path / "arm", good(), order=("b.csv", "a.csv"))
    assert_scaled(found)
    for new, old in zip(found["joints"], fitted()["joints"], strict=True):
        assert [new[key] for key in FLOORS] == pytest.approx([old[key] for key in FLOORS], rel=1e-6)


@FEW
@given(st.lists(st.integers(1, 3600), min_size=1, max_size=5, unique=True))
def test_where_files_are_cut_changes_nothing(tmp_path, cuts):
    """A recording in pieces, even in the middle of runs, is one recording."""
    # A run ends where its file ends, so a cut inside one gives two shorter runs: a standard error is allowed for it.
    # Inertia is not compared: it comes from the few accelerations, one of which a cut may take away.
    first, second = good()
    edges = [0, *sorted(cuts), len(first)]
    parts = [first[a:b] for a, b in pairwise(edges)]
    assert_scaled(
        model(tmp_path / "arm", [*parts, second], names=[f"{k}.csv" for k in range(len(parts) + 1)]),
        share=1.0,
        without="inertia",
    )


def test_form_and_precision_change_nothing(tmp_path):
    """Columns in another order; Parquet beside CSV; all but the time in single precision."""
    rng = np.random.default_rng(3)
    tables = [table[list(rng.permutation(COLUMNS))].astype(dict.fromkeys(COLUMNS[1:], "float32")) for table in good()]
    assert_scaled(model(tmp_path / "arm", tables, names=("a.parquet", "b.csv")))


def test_names_of_joints_change_nothing(tmp_path):
    """Joints of other names, and columns named by them."""
    recipe = RECIPE.replace("name: hip", "name: Schulter ä").replace("name: knee", "name: <b>k</b>")
    recipe += 'log: {position: "p {name}", velocity: "v {name}", current: "c {name}"}\n'
    names = {"1": "Schulter ä", "2": "<b>k</b>"}
    words = {"q": "p", "qd": "v", "i": "c"}
    tables = [table.rename(columns=lambda c: c if c == "t" else f"{words[c[:-1]]} {names[c[-1]]}") for table in good()]
    assert_scaled(model(tmp_path / "arm", tables, recipe=recipe))


def test_time_of_any_origin_changes_nothing(tmp_path):
    """Seconds since 1970 are as good as seconds since the start."""
    # Such times have digits to a quarter microsecond only: a sample between two ticks of 20 ms may fall to the other
    # one, and one at the end of a run in or out of it, which at 40 Hz is a share of its standard error.
    assert_scaled(model(tmp_path / "arm", [table.assign(t=table.t + 1.7e9) for table in good()]), share=0.5)
