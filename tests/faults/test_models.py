"""Model files that are damaged, foreign or malicious: refused in one message, never run, never half believed."""

import shutil

import pytest
from faulty import contents, invoke, unclear

#: What a model file holds instead.
NONE = {
    "no byte": b"",
    "a list": b"[]",
    "no JSON": b"kind: model\n",
    "a log": b"t,q1,q2\n0,1,2\n",
    "binary": bytes(range(256)),
    "a pickle": b"\x80\x04\x95\x0f\0\0\0\0\0\0\0\x8c\x05posix\x8c\x06system\x93\x8c\x04true\x85R.",
    "nested 100 000 deep": b'{"a":' * 100_000,
    "a number of 10 000 digits": b'{"kind": "model", "format": ' + b"1" * 10_000 + b"}",
    "another kind": b'{"kind": "comparison", "format": 1}',
    "another format": b'{"kind": "model", "format": 99, "pumaid": "9"}',
}


@pytest.mark.parametrize("what", [*NONE, "half", "a word changed"])
def test_a_faulty_model_is_refused(arm, what):
    """Exit code 3, a message with a mend, nothing on standard output, nothing changed."""
    path = arm / "results" / "model.json"
    data = path.read_bytes()
    path.write_bytes(NONE.get(what, data[: len(data) // 2] if what == "half" else data.replace(b"joint", b"recursive")))
    before = contents(arm)
    found = invoke("compare", str(path), str(arm / "logs"), "--json")
    assert (found.exit_code, unclear(found.stderr), found.stdout) == (3, [], "")
    assert contents(arm) == before


def test_a_model_of_gigabytes_is_not_read(arm, monkeypatch):
    """A file beyond the limit is refused once the limit is passed, not when all is in memory."""
    monkeypatch.setattr("pumaid.results.documents.MOST_BYTES", 1000)
    found = invoke("compare", str(arm / "results" / "model.json"), str(arm / "logs"))
    assert found.exit_code == 3 and unclear(found.stderr) == [] and "more than" in found.stderr


def test_logs_that_a_model_never_saw_are_compared_and_not_diagnosed(arm):
    """What a model lacks is told on its own logs, and another is named; to compare others is what compare is for."""
    assert invoke("identify", str(arm / "logs" / "log_1.csv")).exit_code == 0
    found = invoke("diagnose", str(arm / "results" / "model.json"), str(arm / "logs"))
    assert found.exit_code == 3 and unclear(found.stderr) == [] and "log_2.csv" in found.stderr
    assert "model-other-logs" in found.stderr
    found = invoke("compare", str(arm / "results" / "model.json"), str(arm / "logs" / "log_2.csv"))
    assert found.exit_code == 0 and "compared-with-fitted" not in found.stderr


def test_the_recipe_that_does_not_fit_is_named(arm, tmp_path):
    """A model of another arm: the file that was found beside the logs, not the one that the model remembers."""
    other = tmp_path / "other"
    shutil.copytree(arm, other)
    text = (other / "recipe.yaml").read_text(encoding="utf-8")
    (other / "recipe.yaml").write_text(f"{text}# of another arm\n", encoding="utf-8")
    for command in ("compare", "diagnose"):
        found = invoke(command, str(arm / "results" / "model.json"), str(other / "logs"))
        assert found.exit_code == 3 and f"at: {other / 'recipe.yaml'}" in found.stderr
