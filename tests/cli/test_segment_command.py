"""``pumaid segment`` on files, as a user runs it."""

import shutil

import pytest
from command import answer, run
from motion_worlds import World, make

from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.io.write import write_log


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """A recipe of two joints and two logs of known motions."""
    folder = tmp_path_factory.mktemp("arm")
    shutil.copy(shipped_recipes()["pendulum2"], folder / "recipe.yaml")
    robot = read_recipe(folder / "recipe.yaml")
    for log in make(World(joints=2, motions=8, rate=200.0, files=2), 21).logs:
        write_log(folder / "logs" / log.origin, [log], robot)
    return folder / "logs"


@pytest.fixture(scope="module")
def document(logs):
    """The JSON of these logs."""
    return answer(f"segment {logs}")


def test_json_is_one_document_with_every_sample(document):
    """Kept and left-out samples add up to those read, and joints count from 1."""
    assert (document["kind"], document["format"]) == ("segments", 1)
    assert document["samples"] == sum(entry["samples"] for entry in document["runs"] + document["rejects"])
    assert document["samples"] == document["kept"] + sum(document["left_out"].values())
    assert {entry["joint"] for entry in document["runs"]} <= {1, 2}
    assert all(entry["posture"][entry["joint"] - 1] is None for entry in document["runs"])
    assert all(len(digest) == 64 for digest in document["logs"].values())


def test_table_tells_runs_and_reasons(logs, document, tmp_path):
    """The table names the joints and ends with what was left out, each stretch by its rows; a picture is as it ends."""
    result = run("segment", logs, "--units", "deg", "--rejects", "--picture", tmp_path / "runs.png")
    first = document["rejects"][0]
    words = [f"{len(document['runs'])} runs at constant speed", "speed (deg/s)", "Not used:", "ramp"]
    assert [word for word in [*words, f"{first['first_row']}–{first['last_row']}"] if word not in result.stdout] == []
    assert (tmp_path / "runs.png").read_bytes().startswith(b"\x89PNG")
