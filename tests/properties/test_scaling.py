"""What must not matter in log files: the size of a current, units, order of files, cuts, single precision, names."""

import json
import shutil
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from faulty import COLUMNS, RECIPE, csv, fitted, good, intervals, invoke, parquet
from faulty_logs import named, plus, times_by
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


def assert_same(found: dict, *, share: float = ROUNDING, without: str = "none") -> None:
    """Parameters are those of the good logs, to a share of their errors."""
    # Names that start with `without` are not compared.
    new, old = intervals(found), intervals(fitted())
    assert new.keys() == old.keys()
    for name, (value, low, high) in old.items():
        if name.startswith(without):
            continue
        assert new[name] == pytest.approx((value, low, high), abs=share * (high - low) / 4), name


NAMES = {"1": "Schulter ä", "2": "<b>k</b>"}
OTHER = RECIPE.replace("name: hip", f"name: {NAMES['1']}").replace("name: knee", f"name: {NAMES['2']}")
#: What a recipe's log block says, and what becomes of its logs; joints have other names, too.
SAME = {
    "units: {current: mA}": times_by(i1=1e3, i2=1e3),
    "units: {time: ms}": times_by(t=1e3),
    "units: {time: us}": times_by(t=1e6),
    "units: {position: deg, velocity: deg/s}": times_by(q1=DEG, q2=DEG, qd1=DEG, qd2=DEG),
    "units: {position: deg, velocity: rad/s}": times_by(q1=DEG, q2=DEG),
    "signs: {current: [-1, -1]}": times_by(i1=-1.0, i2=-1.0),
    "signs: {position: [-1, -1]}": times_by(q1=-1.0, q2=-1.0, qd1=-1.0, qd2=-1.0),
    'position: "p {name}", velocity: "v {name}", current: "i {name}"': named(
        {
            f"{word}{k}": f"{word.replace('q', 'p').replace('pd', 'v')} {NAMES[k]}"
            for word in ("q", "qd", "i")
            for k in "12"
        }
    ),
    # Such times have digits to a quarter microsecond only: a sample between two ticks of 20 ms may fall to the other
    # one, and one at the end of a run in or out of it, which at 40 Hz is a share of its standard error.
    "time: t": plus(t=lambda table: table.t + 1.7e9),
}


@pytest.mark.parametrize("words", SAME)
def test_units_signs_names_and_the_clocks_origin_change_nothing(tmp_path, words):
    """The same logs in other units, with columns that count the other way or have other names, or since 1970."""
    document = model(tmp_path / "arm", map(SAME[words], good()), recipe=f"{OTHER}log: {{{words}}}\n")
    assert_same(document, share=EDGE if "time" in words else ROUNDING)


def test_order_form_and_precision_change_nothing(tmp_path):
    """Files and columns in any order, Parquet beside CSV, all but the time in single precision."""
    rng = np.random.default_rng(3)
    tables = [table[list(rng.permutation(COLUMNS))].astype(dict.fromkeys(COLUMNS[1:], "float32")) for table in good()]
    document = model(tmp_path / "arm", tables, names=("a.parquet", "b.csv"), order=("b.csv", "a.parquet"))
    assert_same(document)
    for new, old in zip(document["joints"], fitted()["joints"], strict=True):
        assert [new[key] for key in FLOORS] == pytest.approx([old[key] for key in FLOORS], rel=1e-4)


@FEW
@given(st.lists(st.integers(1, 3600), min_size=1, max_size=5, unique=True))
def test_where_files_are_cut_changes_nothing(tmp_path, cuts):
    """A recording in pieces, even in the middle of runs, is one recording."""
    # A run ends where its file ends, so a cut inside one gives two shorter runs: a standard error is allowed for it.
    # Inertia is not compared: it comes from the few accelerations, one of which a cut may take away.
    first, second = good()
    edges = [0, *sorted(cuts), len(first)]
    parts = [first[a:b] for a, b in pairwise(edges)]
    assert_same(
        model(tmp_path / "arm", [*parts, second], names=[f"{k}.csv" for k in range(len(parts) + 1)]),
        share=1.0,
        without="inertia",
    )
