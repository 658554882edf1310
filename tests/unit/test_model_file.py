"""Model files: nothing is lost on the way to disk and back, and a damaged file says what is wrong with it."""

import json
from dataclasses import MISSING, fields, replace

import numpy as np
import pytest

from pumaid.errors import ModelError, Note, ResultError, Where
from pumaid.estimate import Combination, Estimate, JointFit, Value
from pumaid.results.documents import as_text, check_same_recipe, digest_of, read_model, write_model
from pumaid.robot import EffectChoice, Joint, Robot

AWKWARD = 0.1 + 0.2  # 0.30000000000000004: a float that a rounded text would change


def estimate() -> Estimate:
    """A model of two joints with one of everything that a model can hold."""
    return Estimate(
        robot="Ärmchen",
        joints=(
            JointFit(1, 3, 900, 0.01, None, "no replicates", 0.009, 2, 0.0125, 0.002, 2, {"constant": 3}),
            JointFit(2, 0, 0, None, None),
        ),
        values=(
            Value("gravity.l2.x", "k2x", 2, "A s2/m", AWKWARD, 1e-300, (-1e-17, 5e-324), 7.5),
            Value("gain_ratio.1.2", "eta1/eta2", 1, "1", state="not_identifiable", reason="light", next_run="move it"),
            Value("tilt.x", "tx", None, "1", 1.0, 0.0, (1.0, 1.0), state="given"),
            Value("coulomb.j1.plus", "lambda1+", 1, "A", -0.0, 0.1, (-0.2, 0.2)),
        ),
        names=("gravity.l2.x", "coulomb.j1.plus"),
        solution=np.array([AWKWARD, -0.0]),
        covariance=np.array([[1.0, AWKWARD], [AWKWARD, 2.0]]),
        scales=np.array([[1.0, np.nan], [0.0, 1.0]]),
        blind=np.zeros((2, 0)),
        effects=(EffectChoice("stribeck", 2, {"velocity": 0.12}), EffectChoice("cogging")),
        combinations=(Combination({"gravity.l2.x": 1.0, "coulomb.j1.plus": -2.0}, 0.5, 0.01, "A", "k2x - 2 lambda1+"),),
        method="recursive",
        recursive=(Value("gravity.l2.x", "k2x", 2, "A s2/m", 0.3, 0.1, (0.1, 0.5)),),
        recipe_digest="ab" * 32,
        geometry="bc" * 32,
        origin="recipe.yaml",
        logs={"a.csv": "cd" * 32},
        notes=(Note("few-runs", "joint 2 has 0 runs", Where(joint=2, file="a.csv")),),
        version="0.1.0",
        heldout=0.0125,
    )


@pytest.fixture
def model(tmp_path):
    """A model file on disk."""
    path = tmp_path / "results" / "model.json"
    write_model(path, estimate())
    return path


def broken(path, *steps, to=None, is_sealed=False):
    """The model file with the entry at `steps` taken out, or set to `to`; sealed as if pumaid had written it so."""
    document = json.loads(path.read_text(encoding="utf-8"))
    holder = document
    for step in steps[:-1]:
        holder = holder[step]
    if to is None:
        del holder[steps[-1]]
    else:
        holder[steps[-1]] = to
    if is_sealed:
        document["sha256"] = digest_of(document)
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def refusal(path) -> ResultError:
    """What reading `path` is refused with."""
    with pytest.raises(ResultError) as caught:
        read_model(path)
    return caught.value


def test_round_trip_loses_nothing(model):
    """Every field comes back equal, arrays bit for bit, order and NaN included; none is at its default here."""
    before, after = estimate(), read_model(model)
    for item in fields(Estimate):
        old, new = getattr(before, item.name), getattr(after, item.name)
        assert item.default is MISSING or old != item.default, item.name
        if isinstance(old, np.ndarray):
            assert (old.shape, old.tobytes()) == (new.shape, new.tobytes()), item.name
        else:
            assert old == new, item.name


def test_document_follows_interfaces(model):
    """The entries that other programs read stand where interfaces.md puts them."""
    document = json.loads(model.read_text(encoding="utf-8"))
    assert (document["kind"], document["format"], document["pumaid"]) == ("model", 1, "0.1.0")
    assert document["joints"][1]["parameters"][0]["name"] == "gravity.l2.x"
    assert document["joints"][0]["parameters"][0]["ci95"] == [-0.2, 0.2]
    assert document["effects"][0] == {"effect": "stribeck", "joint": 2, "shape": {"velocity": 0.12}}
    assert document["ratios"][0]["state"] == "not_identifiable"
    assert document["ratios"][0]["value"] is None


def test_rows_of_numbers_stand_on_a_line():
    """A matrix can be read by eye, while text in brackets is left alone."""
    text = as_text({"matrix": [[1.0, 2.5e-9], [float("nan"), 4.0]], "words": ["1,  2", "[ 3,  4]", "[\n3,  4]"]})
    assert "[1.0, 2.5e-09]" in text
    assert json.loads(text) == {"matrix": [[1.0, 2.5e-9], [None, 4.0]], "words": ["1,  2", "[ 3,  4]", "[\n3,  4]"]}


def test_paths_that_are_no_file(model):
    """A path that leads nowhere or to a folder is refused with the command that makes a model."""
    for path in (model.parent / "nothing.json", model.parent):
        refused = refusal(path)
        assert refused.slug == "file-not-readable" and path.name in refused.what and "pumaid identify" in refused.mend


@pytest.mark.parametrize(("entry", "value"), [("format", 2), ("format", "1"), ("format", True), ("kind", "comparison")])
def test_other_format(model, entry, value):
    """A format that this version does not know, or another document, is named."""
    found = refusal(broken(model, entry, to=value))
    assert found.slug == "file-damaged" and repr(value) in found.what


@pytest.mark.parametrize(
    ("steps", "to", "is_sealed"),
    [
        (("robot",), None, False),
        (("sha256",), None, False),
        (("joints", 0, "parameters", 0, "value"), 0.6, False),
        (("joints", 0, "runs"), 10**400, False),
        (("prediction", "covariance", 0, 1), float("nan"), False),
        (("robot",), "\ud800", False),
        (("prediction",), {}, True),
        (("joints",), 7, True),
        (("prediction", "covariance"), [[1.0], [2.0, 3.0]], True),
        (("robot",), None, True),
    ],
)
def test_a_model_that_was_edited_is_refused(model, steps, to, is_sealed):
    """A change by hand, however plausible, is seen by the file's digest; with a right digest, by its entries."""
    refused = refusal(broken(model, *steps, to=to, is_sealed=is_sealed))
    assert refused.slug == "file-damaged" and (is_sealed or refused.where.field == "sha256")


def test_names_of_logs_that_are_no_text(tmp_path):
    """A name whose bytes are no UTF-8 is written with escapes, and the model is read again."""
    name = b"\xff bad.csv".decode("utf-8", "surrogateescape")
    write_model(tmp_path / "model.json", replace(estimate(), logs={name: "cd" * 32}))
    assert read_model(tmp_path / "model.json").logs == {r"\udcff bad.csv": "cd" * 32}


def test_other_version_is_noted(model):
    """A file of another version is read, and the estimate says where it comes from."""
    found = read_model(broken(model, "pumaid", to="0.0.9", is_sealed=True))
    assert [note.slug for note in found.notes] == ["few-runs", "model-other-version"]


def arm(n_joints: int = 2, **changed: str) -> Robot:
    """The arm of the model."""
    joints = tuple(Joint(number, f"j{number}", "revolute") for number in range(1, n_joints + 1))
    return Robot(**{"name": "Ärmchen", "joints": joints, "origin": "recipe.yaml", "digest": "ab" * 32} | changed)


@pytest.mark.parametrize("other", [arm(digest="ef" * 32), arm(3), arm(digest="", name="another")])
def test_other_recipe_is_refused(other):
    """Another recipe, other joints or another name; of an arm made in memory, without a digest, the name decides."""
    with pytest.raises(ModelError) as caught:
        check_same_recipe(estimate(), other)
    assert caught.value.slug == "model-other-recipe"
    check_same_recipe(estimate(), arm())
    check_same_recipe(estimate(), arm(digest=""))
    check_same_recipe(replace(estimate(), recipe_digest=""), arm())
