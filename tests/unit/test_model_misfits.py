"""Models that are well formed and contradict themselves: refused with the place, before anything is computed."""

from __future__ import annotations

import copy
import json
from typing import Any

import numpy as np
import pytest

from pumaid.errors import Faults, PumaidError
from pumaid.records import Combination, Estimate, JointFit, Value
from pumaid.results.documents import Unfit, as_text, record_from
from pumaid.results.model_file import ModelDocument, contradictions, model_document, read_model, write_model
from pumaid.robot import EffectChoice

NAMES = ("coulomb.j1.plus", "coulomb.j2.plus", "stribeck.j2.velocity_2")
OPEN = Value("gain_ratio.2.3", "eta2/eta3", 2, "", state="not_identifiable", reason="light")
ESTIMATE = Estimate(
    robot="arm",
    joints=tuple(JointFit(joint, 3, 900, 0.01, 0.01) for joint in (1, 2, 3)),
    values=(
        Value(NAMES[0], "c1", 1, "A", 0.5, 0.1, (0.3, 0.7), 9.0),
        Value(NAMES[1], "c2", 2, "A", state="not_identifiable", reason="joint 2 never moves"),
        Value(NAMES[2], "v", 2, "rad/s", 0.12, 0.01, (0.1, 0.14), 9.0),
        Value("gain_ratio.1.2", "eta1/eta2", 1, "", -0.07, 0.01, (-0.09, -0.05), 9.0),
        OPEN,
    ),
    names=NAMES,
    solution=np.array([0.5, 0.2, 0.0]),
    covariance=np.array([[0.01, 1e-4, 0.0], [1e-4, 0.04, 0.0], [0.0, 0.0, 1e-4]]),
    scales=np.array([[1.0, -0.07, -0.14], [0.0, 1.0, 2.0], [0.0, 0.0, 1.0]]),
    blind=np.zeros((3, 0)),
    effects=(EffectChoice("stribeck", 2, {"velocity": 0.1}), EffectChoice("stribeck", 2, {"velocity": 0.12})),
    combinations=(Combination({NAMES[0]: 1.0}, 0.5, 0.1, "A", "c1"),),
    stroke_postures=((1, (0.0, 0.5, 1.0)),),
    recursive=(Value(NAMES[0], "c1", 1, "A", 0.4, 0.1, (0.2, 0.6), 9.0),),
    logs={"a.csv": "cd" * 32},
    version="0.1.0",
)
GOOD = json.loads(as_text(model_document(ESTIMATE)))
VALUE = ("joints", 0, "parameters", 0)

FAULTS = {
    "an effect of another arm": (("effects", 0, "joint"), 99, "effects[0].joint"),
    "a posture of another arm": (
        ("prediction", "stroke_postures", 0, "joint"),
        9,
        "prediction.stroke_postures[0].joint",
    ),
    "a posture without numbers": (
        ("prediction", "stroke_postures", 0, "hold"),
        [None] * 3,
        "prediction.stroke_postures[0].hold",
    ),
    "a posture too short": (("prediction", "stroke_postures", 0, "hold"), [0.0], "prediction.stroke_postures[0].hold"),
    "numbers beyond all": (("prediction", "solution"), [1e300] * 3, "prediction.solution"),
    "an error beyond all": (("joints", 0, "rmse"), 1e200, "joints[0].rmse"),
    "an error below zero": (("joints", 0, "rmse"), -1.0, "joints[0].rmse"),
    "runs beyond all": (("joints", 0, "runs"), 10**400, "joints[0].runs"),
    "scales of zero": (("prediction", "scales"), [[0.0] * 3] * 3, "prediction.scales[0][0]"),
    "a scale turned round": (("prediction", "scales", 0, 1), 0.07, "prediction.scales[0][1]"),
    "a scale left out": (("prediction", "scales", 0, 1), None, "prediction.scales[0][1]"),
    "a scale that does not follow": (("prediction", "scales", 0, 2), 0.14, "prediction.scales[0][2]"),
    "a scale of an inner link": (("prediction", "scales", 2, 0), 1.0, "prediction.scales[2][0]"),
    "names turned round": (("prediction", "names"), [*NAMES[1::-1], NAMES[2]], "prediction.solution[1]"),
    "one name for all": (("prediction", "names"), [NAMES[0]] * 3, "prediction.names"),
    "a strange name": (("prediction", "names", 1), "odd", "prediction.names"),
    "a negative variance": (("prediction", "covariance", 1, 1), -0.04, "prediction.covariance[1][1]"),
    "a lopsided covariance": (("prediction", "covariance", 0, 1), 2e-4, "prediction.covariance[0][1]"),
    "no covariance": (("prediction", "covariance", 0, 1), None, "prediction.covariance"),
    "a negative error": ((*VALUE, "std_error"), -1.0, "joints[0].parameters[0].std_error"),
    "an interval backwards": ((*VALUE, "ci95"), [5.0, -5.0], "joints[0].parameters[0].ci95"),
    "identified without value": ((*VALUE, "value"), None, "joints[0].parameters[0].value"),
    "unknown with value": ((*VALUE, "state"), "not_identifiable", "joints[0].parameters[0].value"),
    "another value": ((*VALUE, "value"), 0.6, "prediction.solution[0]"),
    "a strange term": (("combinations", 0, "terms"), {"odd": 1.0}, "combinations[0].terms"),
    "a joint of the recursion": (("recursive", 0, "joint"), 99, "recursive[0].joint"),
}


def checked(document: dict[str, Any]) -> dict[str, str]:
    """Path -> fault of a document."""
    try:
        return dict(contradictions(record_from(ModelDocument, document)))
    except Unfit as unfit:
        return dict(unfit.faults)


def faults(change: Any = None) -> dict[str, str]:
    """Place -> fault of the model after a change."""
    document = copy.deepcopy(GOOD)
    if change is not None:
        steps, to = change
        place = document
        for step in steps[:-1]:
            place = place[step]
        place[steps[-1]] = to
    return checked(document)


def test_the_model_is_good():
    """Negative ratios, unknown parameters and shapes, whose column holds no shape, are what models have."""
    assert faults() == {}


@pytest.mark.parametrize("name", FAULTS)
def test_what_does_not_fit_is_told(name):
    """Each with its path in the JSON."""
    steps, to, at = FAULTS[name]
    assert at in faults((steps, to))


@pytest.mark.parametrize("name", ["gain_ratio.9.x", "gain_ratio.2.1", "gain_ratio.1.4", "gain_ratio"])
def test_ratios_name_two_joints(name):
    """The inner one first, both of the arm."""
    document = json.loads(json.dumps(GOOD).replace("gain_ratio.1.2", name))
    assert "ratios[0].name" in checked(document)


def test_ratios_by_way_of_an_inner_joint():
    """Loads that only a third joint sees together have a ratio and no scale."""
    document = copy.deepcopy(GOOD)
    document["prediction"]["scales"] = [[1.0, 3.0, 6.0], [0.0, 1.0, None], [0.0, 0.0, 1.0]]
    document["ratios"][0] |= {"value": 3.0}
    document["ratios"][1] |= {"value": 2.0, "state": "identified"}
    assert checked(document) == {}


def refused(path, text: str) -> PumaidError:
    """The refusal of a model file."""
    path.write_text(text, encoding="utf-8")
    with pytest.raises(PumaidError) as caught:
        read_model(path)
    return caught.value.faults[0] if isinstance(caught.value, Faults) else caught.value


def test_entries_that_stand_twice(tmp_path):
    """Programs differ in which of them they take."""
    found = refused(tmp_path / "model.json", json.dumps(GOOD).replace('"rmse":', '"rmse": 1.0, "rmse":', 1))
    assert (found.slug, found.where.field) == ("model-damaged", "rmse")


@pytest.mark.parametrize(("old", "new"), [('"arm"', r'"\ud800"'), ('"light"', r'"a\udcffb"'), ('"a.csv"', r'"\udfff"')])
def test_half_letters(tmp_path, old, new):
    """What no encoding can write is refused."""
    found = refused(tmp_path / "model.json", json.dumps(GOOD).replace(f"{old}", new, 2))
    assert found.slug == "model-damaged"


def test_letters_in_two_escapes_are_letters(tmp_path):
    """Other programs escape what lies beyond 16 bits so."""
    path = tmp_path / "model.json"
    path.write_text(json.dumps(GOOD).replace('"robot": "arm"', r'"robot": "\ud83e\udd16"'), encoding="utf-8")
    assert read_model(path).robot == "\N{ROBOT FACE}"


def test_names_of_logs_that_are_no_text(tmp_path):
    """A name whose bytes are no UTF-8 is written with escapes, and the model is read again."""
    name = b"\xff bad.csv".decode("utf-8", "surrogateescape")
    model = Estimate(**{item: getattr(ESTIMATE, item) for item in ESTIMATE.__slots__} | {"logs": {name: "cd" * 32}})
    write_model(tmp_path / "model.json", model)
    assert read_model(tmp_path / "model.json").logs == {r"\udcff bad.csv": "cd" * 32}
