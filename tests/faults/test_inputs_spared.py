"""Places that a user names for results by mistake: inputs are never written over, and what fails leaves no mixture."""

import pytest
from faulty import contents, invoke, unclear

from pumaid.cli.output import spare_inputs
from pumaid.errors import ResultError

LOG, RECIPE, MODEL = "logs/log_1.csv", "recipe.yaml", "results/model.json"
OVER = (
    ("identify logs -o", LOG),
    ("identify logs -o", RECIPE),
    (f"diagnose {MODEL} logs -o", MODEL),
    (f"diagnose {MODEL} logs --apply -o", MODEL),
    (f"diagnose {MODEL} logs -o", LOG),
    (f"diagnose {MODEL} logs --force --plan", RECIPE),
    (f"report {MODEL} logs -o", RECIPE),
    (f"report {MODEL} logs --format= -o", MODEL),
    (f"report {MODEL} -o", LOG),
    (f"export {MODEL} --format python --force -o", RECIPE),
    (f"export {MODEL} --format json --force -o", MODEL),
)


@pytest.mark.parametrize(("words", "place"), OVER, ids=[" ".join(one) for one in OVER])
def test_an_input_is_not_written_over(arm, monkeypatch, words, place):
    """A log, recipe or model named as the place of a result is refused, and everything stays as it was."""
    monkeypatch.chdir(arm)
    before = contents(arm)
    found = invoke(*words.split(), place)
    assert found.exit_code == 3 and "error[file-exists]" in found.stderr and unclear(found.stderr) == []
    assert contents(arm) == before and found.stdout == ""


@pytest.mark.parametrize("is_hard", [False, True])
def test_a_link_to_an_input_is_one(arm, is_hard):
    link, before = arm / "other.json", (arm / LOG).read_bytes()
    link.hardlink_to(arm / LOG) if is_hard else link.symlink_to(arm / LOG)
    found = invoke("identify", str(arm / "logs"), "-o", str(link))
    assert found.exit_code == 3 and "file-exists" in found.stderr and (arm / LOG).read_bytes() == before


def test_a_urdf_is_not_written_over(tmp_path):
    """A recipe made of a URDF takes not its place, whether there is one to read or not."""
    urdf = tmp_path / "arm.urdf"
    urdf.write_text("<robot/>", encoding="utf-8")
    found = invoke("init", "--urdf", str(urdf), "--force", "-o", str(urdf))
    assert found.exit_code == 3 and "file-exists" in found.stderr and urdf.read_text() == "<robot/>"


def test_what_is_no_input_may_be_written(arm, tmp_path):
    """The old model is no input of identify; nor is what is not there, or standard output, anybody's."""
    assert invoke("identify", str(arm / "logs"), "-o", str(arm / MODEL)).exit_code == 0
    spare_inputs([None, tmp_path / "new", tmp_path / "-"], [None, tmp_path / "old", arm / LOG])
    with pytest.raises(ResultError, match="input"):
        spare_inputs([tmp_path / "a" / ".." / "new"], [tmp_path / "new"])


@pytest.mark.parametrize("words", ["identify logs", f"diagnose {MODEL} logs"])
def test_a_refusal_prints_no_document(arm, monkeypatch, words):
    """Where the file cannot be written, ``--json`` prints nothing either."""
    monkeypatch.chdir(arm)
    found = invoke(*words.split(), "--json", "-o", "logs")
    assert found.exit_code == 3 and found.stdout == "" and "cannot-write" in found.stderr
