"""One fault in a good experiment, bytes at random, streams that are closed or full: refused, flagged or as good."""

import json
from pathlib import Path

import pytest
from command import shell
from faulty import COLUMNS, RECIPE, contents, csv, good, invoke, outcome, parquet, slugs_of
from faulty_logs import all_logs
from faulty_recipes import all_recipes
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

FINE = ("refused", "flagged", "agrees")
SEEDED = settings(deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
#: Pieces of text that mean something to one of the readers.
MEANINGFUL = ["", "\n", "\r", "\0", "\t", "nan", "inf", "1e999", "&a ", "*a", "!!", ": ", "é", "\ufeff", *";,\"'#-.{["]
WORDS = st.sampled_from(MEANINGFUL)
#: Where, how many bytes are taken out, what is put there.
EDITS = st.lists(
    st.tuples(st.floats(0.0, 1.0), st.integers(0, 40), WORDS | st.text(max_size=8)), min_size=1, max_size=4
)


def edited(data: bytes, edits: list) -> bytes:
    """Bytes with some pieces replaced."""
    for share, taken, word in edits:
        at = int(share * len(data))
        data = data[:at] + word.encode("utf-8", "replace") + data[at + taken :]
    return data


def judged(arm: Path, path: str, data: bytes) -> str:
    """What comes of the good experiment with another content of one file; the file is put back."""
    place, before = arm / path, contents(arm / "results")
    kept = place.read_bytes()
    place.write_bytes(data)
    try:
        return outcome(invoke("identify", str(arm / "logs"), "--json"), arm, before)
    finally:
        place.write_bytes(kept)


@settings(SEEDED, max_examples=25)
@given(EDITS)
def test_edits_of_a_recipe(arm, edits):
    """Pieces of a recipe taken out and put in; what is left may be a good recipe, of an arm with other frames."""
    found = judged(arm, "recipe.yaml", edited(RECIPE.encode(), edits))
    assert found in FINE or found.startswith("silently wrong")


@settings(SEEDED, max_examples=15)
@given(EDITS)
def test_edits_of_a_csv_log(arm, edits):
    assert judged(arm, "logs/log_1.csv", edited(csv(good()[0]).encode(), edits)) in FINE


@settings(SEEDED, max_examples=20)
@given(st.lists(st.tuples(st.floats(0.0, 0.9999), st.integers(1, 255)), min_size=1, max_size=4))
def test_flipped_bits_of_a_parquet_log(arm, flips):
    """Bits of a Parquet log flipped, anywhere; the file carries checksums of its pages."""
    data = bytearray(parquet(good()[0], write_page_checksum=True))
    for share, mask in flips:
        data[int(share * len(data))] ^= mask
    (arm / "logs" / "log_1.csv").unlink(missing_ok=True)
    (arm / "logs" / "log_1.parquet").touch()
    assert judged(arm, "logs/log_1.parquet", bytes(data)) in FINE


@settings(SEEDED, max_examples=10)
@given(st.integers(0, 3662), st.integers(1, 200), st.sampled_from(COLUMNS), st.floats(allow_nan=True, width=32))
def test_cells_of_any_value(arm, row, count, column, value):
    """Any number, also none and infinity, in up to 200 bins of a column."""
    table = good()[0].copy()
    table.loc[table.index[row : row + count], column] = value
    assert judged(arm, "logs/log_1.csv", csv(table).encode()) in FINE


@settings(SEEDED, max_examples=20)
@given(st.binary(max_size=2000), st.sampled_from(["logs/log_1.csv", "recipe.yaml"]))
def test_any_bytes_at_all(arm, data, path):
    assert judged(arm, path, data) in FINE


def test_the_good_experiment_is_good(arm):
    """Without a fault nothing is said, and the parameters are those that the logs were made with."""
    found = invoke("identify", str(arm / "logs"), "--json")
    assert slugs_of(found.stderr) == set()
    assert outcome(found, arm, {}) == "agrees"


@pytest.mark.parametrize("fault", all_logs() + all_recipes(), ids=lambda fault: f"{fault.kind}: {fault.name}")
def test_a_fault_is_never_silent(arm, fault):
    """No traceback; old results whole and one message with a mend, or the good log's numbers, or a warning."""
    before = contents(arm / "results")
    fault.change(arm)
    found = invoke("identify", str(arm / "logs"), "--json")
    assert outcome(found, arm, before) in ("refused", "flagged", "agrees")


pytestmark = pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no /dev/full")


def test_what_nobody_hears_is_done_all_the_same(arm):
    done = shell("pumaid identify logs >&- 2>&- <&-", arm)
    assert done.returncode == 0 and "Traceback" not in done.stderr
    assert json.loads((arm / "results" / "model.json").read_text())["kind"] == "model"


@pytest.mark.parametrize(
    "words",
    ["identify - --recipe recipe.yaml", "compare - logs", "segment logs --recipe -", "init --urdf -", "report - logs"],
)
def test_a_closed_input_is_told(arm, words):
    done = shell(f"pumaid {words} <&-", arm)
    assert done.returncode == 3 and done.stderr.count("error[") == 1 and "Traceback" not in done.stderr


@pytest.mark.parametrize("words", ["--version", "plan --help", "segment logs"])
def test_a_full_output_is_one_message(arm, words):
    done = shell(f"pumaid {words} >/dev/full", arm)
    assert done.returncode == 3 and done.stderr.count("error[file-not-readable]") == 1
    assert "Exception" not in done.stderr and "Traceback" not in done.stderr
