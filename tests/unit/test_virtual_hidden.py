"""Hidden effects: laws written out by hand, where they act, and how they are named."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from pumaid.errors import ModelError
from pumaid.records import Motion, Plan
from pumaid.virtual import Bench, Hidden, Session, record, table1
from pumaid.virtual.hidden import LAWS, parse

PUMA = table1.puma560().with_noise(0.0)
#: Joint 2's motor counts along its motion, joint 3's against it.
PLAN = Plan(
    "PUMA 560",
    (
        Motion(2, (0.0, 0.0, 1.0, 0.0, 0.0, 0.0), -1.0, 1.0, 0.5),
        Motion(3, (0.0, -0.5, 0.0, 0.3, 0.0, 0.0), 1.0, -1.0, 0.8),
    ),
)


def session(truth) -> dict[str, np.ndarray]:
    """A whole session's arrays."""
    logs = list(Session(truth, PLAN, np.random.default_rng(1), rate=100.0).logs())
    return {
        name: np.concatenate([getattr(log, name) for log in logs])
        for name in ("time", "position", "velocity", "current")
    }


def difference(effect: str, joint: int | None = None, **values: float) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """The session with an effect, and (N, J) what the effect added to it."""
    found = session(replace(PUMA, hidden=(Hidden(effect, joint, values),)))
    return found, found["current"] - session(PUMA)["current"]


CASES = {
    "stribeck": ({"a": 0.2, "v_s": 0.3, "d": 2.0}, lambda s, v, q, tau, t: s * 0.2 * np.exp(-((v / 0.3) ** 2))),
    "viscous_power": ({"b": 0.2, "p": 0.5}, lambda s, v, q, tau, t: s * 0.2 * np.sqrt(np.abs(v))),
    "position_friction": (
        {"a": 0.1, "b": 0.2, "k": 2.0},
        lambda s, v, q, tau, t: s * (0.1 * np.cos(2 * q) + 0.2 * np.sin(2 * q)),
    ),
    "spring": ({"a": 0.3, "b": 0.1}, lambda s, v, q, tau, t: 0.3 * q + 0.1),
    "ripple": ({"a": 0.1, "b": 0.2, "f": 20.0}, lambda s, v, q, tau, t: 0.1 * np.cos(20 * q) + 0.2 * np.sin(20 * q)),
    "warmup": ({"a": 0.2, "T": 5.0}, lambda s, v, q, tau, t: s * 0.2 * np.exp(-t / 5.0)),
    "friction_step": ({"a": 0.2, "t_0": 2.0}, lambda s, v, q, tau, t: s * np.where(t > 2.0, 0.2, 0.0)),
    "load_friction": (
        {"drive": 0.3, "back": 0.1},
        lambda s, v, q, tau, t: s * np.abs(tau) * np.where(tau * s > 0, 0.3, 0.1),
    ),
}


def test_every_law_has_a_case():
    """No effect can be hidden that is not tested here."""
    assert set(CASES) == set(LAWS)


@pytest.mark.parametrize("effect", CASES)
@pytest.mark.parametrize(("joint", "side"), [(2, 1.0), (3, -1.0)])
def test_law_is_what_it_says(effect, joint, side):
    """The current added to the joint is the law written out by hand, with the motor's own sign."""
    values, law = CASES[effect]
    found, added = difference(effect, joint, **values)
    q, v = found["position"][:, joint - 1], found["velocity"][:, joint - 1]
    load = PUMA.gravity_current(found["position"])[:, joint - 1]
    assert added[:, joint - 1] == pytest.approx(law(side * np.sign(v), v, q, load, found["time"]), abs=1e-12)
    assert np.max(np.abs(added[:, joint - 1])) > 0.01


def test_other_joints_are_left_alone():
    """An effect at one joint changes no other; without a joint it acts at all that move."""
    _, added = difference("stribeck", 2)
    assert np.all(np.delete(added, 1, axis=1) == 0.0)
    _, everywhere = difference("stribeck")
    assert np.all(np.max(np.abs(everywhere[:, 1:4]), axis=0) > 0.01)


def test_bench_hides_the_same():
    """Runs without logs carry the same hidden current as logs."""
    truth = replace(PUMA, hidden=(Hidden("ripple", 2, {"a": 0.1, "b": 0.0, "f": 8.0}),))
    (plain, *_), (hidden, *_) = (Bench(one, PLAN).runs(np.random.default_rng(0)) for one in (PUMA, truth))
    wanted = 0.1 * np.cos(8.0 * plain.cells.position[:, 1])
    # A cell's mean of a ripple of 8 a rad over 0.03 rad differs from its middle by a few thousandths.
    assert hidden.cells.current[:, 1] - plain.cells.current[:, 1] == pytest.approx(wanted, abs=0.002)


def test_truth_remembers():
    """A truth's document brings its hidden effects back."""
    truth = replace(PUMA, hidden=(Hidden("spring", None, {"a": 0.1, "b": 0.0}),))
    again = record.from_json(json.loads(json.dumps(record.as_json(truth))), PUMA.robot)
    assert again.hidden == truth.hidden
    assert np.array_equal(session(again)["current"], session(truth)["current"])


@pytest.mark.parametrize(
    ("text", "joint", "values"),
    [
        ("stribeck", None, {"a": 0.12, "v_s": 0.15, "d": 1.0}),
        ("stribeck@all:a=0.3", None, {"a": 0.3, "v_s": 0.15, "d": 1.0}),
        ("spring@3:a=-1e-2,b=2", 3, {"a": -0.01, "b": 2.0}),
        ("spring@shoulder", 2, {"a": 0.1, "b": 0.0}),
    ],
)
def test_effects_are_named_as_on_the_command_line(text, joint, values):
    """Effect, joint by number or name, values."""
    assert parse(text, PUMA.robot) == Hidden(text.split("@")[0].split(":")[0], joint, values)


@pytest.mark.parametrize(
    ("text", "mend"),
    [
        ("stribek", "did you mean stribeck?"),
        ("stribeck@7", "known: waist"),
        ("stribeck@elbo", "did you mean elbow?"),
        ("stribeck:vs=1", "did you mean v_s?"),
        ("stribeck:a=big", "known: a, v_s, d"),
        ("", "known: stribeck"),
    ],
)
def test_wrong_names_are_told(text, mend):
    """What is not known is told with what is."""
    with pytest.raises(ModelError) as caught:
        parse(text, PUMA.robot)
    assert caught.value.slug == "hide-wrong"
    assert mend in caught.value.mend
