"""Diagnosis files: the entries that interfaces fix, nothing lost on the way to disk and back, damage told."""

import hashlib
import json
from dataclasses import replace

import diagnoses
import numpy as np
import pytest
from test_dataset import same

from pumaid.diagnosis.records import diagnosis_document, read_diagnosis, stale, write_diagnosis
from pumaid.errors import ResultError
from pumaid.results.documents import digest_of, model_digest, write_model


@pytest.mark.parametrize("told", [diagnoses.rich(), diagnoses.clean()], ids=["rich", "clean"])
def test_nothing_is_lost(tmp_path, told):
    """What is read equals what was written, records and arrays, bit for bit."""
    write_diagnosis(tmp_path / "results" / "diagnosis.json", told)
    assert same(read_diagnosis(tmp_path / "results" / "diagnosis.json"), told)


def test_document_has_the_fixed_entries():
    """Kind, format, joints with candidates, findings with the next run as rows of a plan, limits as ``unseen``."""
    document = json.loads(json.dumps(diagnosis_document(diagnoses.rich())))
    assert (document["kind"], document["format"]) == ("diagnosis", 1)
    joint = document["joints"][2]
    assert {"joint", "verdict", "rmse", "noise_floor", "budget", "candidates", "unexplained", "unseen"} <= set(joint)
    wanted = "effect joint shape rmse_after rmse_heldout_before rmse_heldout_after p_value rivals verdict command"
    assert set(wanted.split()) <= set(joint["candidates"][0])
    assert document["joints"][4]["unexplained"]["form"] == "s f(q)"
    finding = document["findings"][0]
    assert (finding["effect"], finding["joint"], finding["rivals"]) == ("stribeck", 3, ["viscous_power"])
    assert finding["next_run"]["text"] and document["findings"][1]["joint"] is None
    row = finding["next_run"]["runs"][0]
    assert (row["joint"], row["from"], row["to"], row["velocity"], len(row["hold"])) == (3, -1.2, 1.2, 0.05, 6)


def test_digest_of_a_model_is_that_of_its_file(context, tmp_path):
    """The digest in a diagnosis is what ``sha256sum results/model.json`` prints."""
    write_model(tmp_path / "model.json", context.estimate)
    assert model_digest(context.estimate) == hashlib.sha256((tmp_path / "model.json").read_bytes()).hexdigest()


@pytest.mark.parametrize(
    ("entries", "field"), [({"format": 2}, "format"), ({"kind": "model"}, "kind"), ({"joints": []}, "sha256")]
)
def test_another_or_an_edited_document_is_refused(tmp_path, entries, field):
    document = diagnosis_document(diagnoses.rich()) | entries
    (tmp_path / "d.json").write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(ResultError) as refused:
        read_diagnosis(tmp_path / "d.json")
    assert refused.value.slug == "file-damaged" and refused.value.where.field == field


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"\xff\xfe", b"[" * 100_000])
def test_what_is_no_diagnosis_is_refused(tmp_path, content):
    """Empty, broken, binary or endless files are refused with a mend."""
    (tmp_path / "d.json").write_bytes(content)
    with pytest.raises(ResultError, match="file-damaged"):
        read_diagnosis(tmp_path / "d.json")


def test_entries_of_a_later_version_are_passed_over(tmp_path):
    document = diagnosis_document(diagnoses.rich())
    document["joints"][0]["mood"] = document["mood"] = {"of": "tomorrow"}
    document["sha256"] = digest_of(document)
    (tmp_path / "d.json").write_text(json.dumps(document), encoding="utf-8")
    assert same(read_diagnosis(tmp_path / "d.json"), diagnoses.rich())


def test_a_number_that_json_lacks_is_not_damage(tmp_path):
    """An evidence that overflowed is null in the file, and read as not a number."""
    told = diagnoses.rich()
    odd = replace(told.joints[2], candidates=(replace(told.joints[2].candidates[0], evidence=float("inf")),))
    write_diagnosis(tmp_path / "d.json", replace(told, joints=(odd,)))
    assert np.isnan(read_diagnosis(tmp_path / "d.json").joints[0].candidates[0].evidence)


def test_a_diagnosis_knows_whether_it_is_stale(context):
    """It is told of another model and of other logs, each for itself; of its own there is nothing to tell."""
    estimate, logs = context.estimate, {"a.csv": "cd" * 32}
    own = replace(diagnoses.rich(), model={"sha256": model_digest(estimate)}, logs=logs)
    assert stale(own, estimate, {"renamed.csv": "cd" * 32}) == ()
    assert "other logs" in stale(own, estimate, {})[0] and len(stale(own, estimate, {})) == 2
    assert "another model" in stale(replace(own, model={"sha256": "ab"}), estimate, logs)[0]
