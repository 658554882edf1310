"""``pumaid identify`` on a small experiment: what it prints and writes."""

import json
from pathlib import Path

import pytest
from command import answer, run

import pumaid

LOG = "logs/session_01.csv"


def test_prints_the_table_and_writes_the_model(arm):
    """The table is on standard output, the library's model beside the recipe, where it went on standard error.

    With the next command, which works as it stands.
    """
    done = run("identify", "logs", "--units", "deg")
    assert "two-link pendulum" in done.stdout and "±" in done.stdout and "A s/deg" in done.stdout
    written, _, following = done.stderr.splitlines()[-1].partition("; next: pumaid ")
    assert written == "model written to results/model.json"
    assert "adequate" in run(*following.split(), "--json").stdout
    model = pumaid.read_model(Path("results/model.json"))
    assert model.values == pumaid.load(arm).identify().values
    assert "A s/rad" in {value.unit for value in model.values}
    assert answer("identify logs") == json.loads(Path("results/model.json").read_text())


def test_standard_input_and_output(arm):
    """A log from a pipe becomes a model in a pipe, without a file; the recipe may come from there instead, once."""
    before = sorted(arm.rglob("*"))
    assert json.loads(run("identify", "-", "-o", "-", input=Path(LOG).read_text()).stdout)["kind"] == "model"
    assert sorted(arm.rglob("*")) == before
    recipe, model = Path("recipe.yaml").read_bytes(), json.loads(Path("results/model.json").read_text())
    told = answer("identify logs --recipe -", input=recipe)
    assert told["recipe"]["sha256"] == model["recipe"]["sha256"] and told["joints"] == model["joints"]
    assert run("identify", "-", "--recipe", "-", input=recipe, code=3).stderr.count("error[") == 1


@pytest.mark.parametrize(("options", "path"), [("-o first.json", "first.json"), ("--results out", "out/model.json")])
def test_model_goes_where_it_is_told(arm, options, path):
    """``-o`` names the file, ``--results`` the folder, in which all are kept."""
    before = set(arm.rglob("*.json"))
    run("identify", "logs", *options.split())
    archived = {arm / "out" / "models" / "001-base.json"} if path.startswith("out") else set()
    assert set(arm.rglob("*.json")) - before == {arm / path, *archived}


def test_recursive_stops_before_the_refinement(arm):
    """``--recursive`` keeps the recursion's values, and the file says so."""
    document = answer("identify logs --recursive")
    assert document["method"] == "recursive"
    values = {entry["name"]: entry["value"] for fit in document["joints"] for entry in fit["parameters"]}
    before = {entry["name"]: entry["value"] for entry in document["recursive"]}
    assert {name: before[name] for name in values} == values


def test_held_out_runs_are_not_fitted(arm):
    """Runs that plan.yaml or --heldout keeps for judging are left out of the fit; standard error says how many."""
    lines = Path(LOG).read_text().splitlines(keepends=True)
    Path(LOG).write_text("".join(lines[:9000]))
    Path("logs/session_02.csv").write_text("".join([lines[0], *lines[9000:]]))
    counts = [[joint["runs"] for joint in answer("identify logs")["joints"]]]
    Path("plan.yaml").unlink()
    counts.append([joint["runs"] for joint in answer("identify logs")["joints"]])
    assert all(fewer < more for fewer, more in zip(*counts, strict=True))
    done = run("identify", "logs", "--heldout", "session_02.csv", "--json")
    assert " of them as was asked; " in next(line for line in done.stderr.splitlines() if "note[held-out]" in line)
    assert sum(joint["runs"] for joint in json.loads(done.stdout)["joints"]) < sum(counts[1])


def test_suspicious_logs_are_refused_unless_trusted(arm):
    """Angles in degrees under a recipe of radians are refused; ``--trust`` turns that into a note."""
    import pandas as pd

    log = pd.read_csv(LOG)
    angles = [column for column in log if column.startswith("q")]
    log[angles] = log[angles] * 57.29578
    log.to_csv(LOG, index=False)
    assert "error[units-disagree]" in run("identify", "logs", code=3).stderr
    assert "note[units-disagree]" in run("identify", "logs", "--trust").stderr


@pytest.mark.parametrize("options", [[], ["--recursive"]])
def test_an_effect_of_several_joints_can_be_read_back(arm, options):
    """The recursion cannot solve what acts on several joints: the model says so, and other commands can read it."""
    run("identify", "logs", "--add", "flexibility@2", *options)
    model = pumaid.read_model(Path("results/model.json"))
    alone = next(value for value in model.recursive if value.name == "flexibility.j2.c")
    assert alone.value is None and "without --recursive" in alone.reason
    assert (model.value("flexibility.j2.c").value is None) == bool(options)


def test_add_fits_an_effect_with_all_the_rest(arm):
    """``--add`` prints the effect's rows and writes its parameters and shape; the next command predicts with it."""
    document = answer("identify logs --add stribeck@knee:exponent=1")
    (effect,) = document["effects"]
    assert (effect["effect"], effect["joint"], effect["shape"]["exponent"]) == ("stribeck", 2, 1.0)
    assert 1e-4 <= effect["shape"]["velocity"] <= 20.0
    states = {value["name"]: value["state"] for value in document["joints"][1]["parameters"]}
    assert states["stribeck.j2.exponent"] == "given" and {"stribeck.j2.a", "stribeck.j2.velocity"} <= set(states)
    rmse = [joint["rmse"] for joint in answer("compare results/model.json logs")["joints"]]
    # identify knows the shape's own change by its slope at the end of the search, compare at its value.
    assert rmse == pytest.approx([joint["rmse"] for joint in document["joints"]], rel=1e-5)


def test_a_second_command_does_not_read_the_logs(arm, monkeypatch):
    """The same model is made of the dataset that the first command wrote; without that file the logs are read."""
    Path("results/dataset.npz").unlink()
    assert "dataset written to results/dataset.npz" in run("identify", "logs", "-o", "first.json").stderr

    def refuse(self):
        raise OSError("read again")
        yield

    monkeypatch.setattr("pumaid.io.log_reader.LogReader.__iter__", refuse)
    assert "dataset.npz" not in run("identify", "logs", "-o", "second.json").stderr
    assert Path("second.json").read_bytes() == Path("first.json").read_bytes()
    Path("results/dataset.npz").unlink()
    run("identify", "logs", code=3)
