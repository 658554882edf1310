"""Logs and recipes that do not mean what they say are told before any physics is called missing."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from faulty import OUTER, OWN, RATIO, csv, good, invoke, make

from pumaid.diagnosis.records import CAUSES as SLUGS


def fewer(table):
    """Positions and velocities a sixth too small."""
    return table.assign(**{name: table[name] / 1.2 for name in ("q1", "q2", "qd1", "qd2")})


UPSIDE = ("alpha: 90,", "alpha: 0,")
#: Slug and words of the note, what is done to a table (of a file number), and to the recipe.
CASES = {
    "joints changed places": ("order-wrong", "joints 2, 1 ",
        lambda table, number: table.rename(columns=lambda name: name.translate(str.maketrans("12", "21"))), None),
    "first axis vertical": ("gravity-wrong", "alpha and zero of the first joint", None, UPSIDE),
    "300 degrees to a turn": ("scale-wrong", "1.20 times", lambda table, number: fewer(table), None),
}  # fmt: skip


def spoilt(folder: Path, change, edit) -> Path:
    """The good experiment with its tables changed and a word of its recipe edited."""
    make(folder)
    for number, table in enumerate(good(), start=1):
        (folder / "logs" / f"log_{number}.csv").write_text(csv(change(table, number) if change else table))
    if edit:
        text = (folder / "recipe.yaml").read_text()
        (folder / "recipe.yaml").write_text(text.replace(*edit, 1))
    return folder


@pytest.mark.parametrize("name", CASES)
def test_the_likely_cause_comes_before_the_misses(tmp_path, name):
    """The first note of identify, and the first words of diagnose, name it with the error that it takes away."""
    slug, words, change, edit = CASES[name]
    arm = spoilt(tmp_path / "arm", change, edit)
    told = invoke("identify", str(arm / "logs"))
    assert told.exit_code == 0
    notes = [line for line in told.stderr.splitlines() if line.startswith("note[")]
    assert notes[0].startswith(f"note[{slug}]") and words in notes[0]
    before, after = map(float, re.search(r"falls from ([\d.]+) to ([\d.]+) A", notes[0]).groups())
    assert after < 0.3 * before
    found = invoke("diagnose", str(arm / "results" / "model.json"), str(arm / "logs"))
    assert "before any physics" in " ".join(found.stdout.split())[:200]


def test_currents_without_weight_are_told(tmp_path):
    """A controller's gravity that was subtracted leaves nothing that an arm could have."""

    def change(table, number):
        outer = OUTER * np.sin(table.q1 + table.q2 + 0.3)
        return table.assign(i1=table.i1 - OWN * np.sin(table.q1) - RATIO * outer, i2=table.i2 - outer)

    told = invoke("identify", str(spoilt(tmp_path / "arm", change, None) / "logs")).stderr
    assert "note[weight-missing]" in told and "model-misses" not in told


def test_sound_logs_are_accused_of_nothing(tmp_path):
    told = invoke("identify", str(make(tmp_path / "arm") / "logs")).stderr
    assert "note[" not in told


def test_positions_in_turns_are_refused_with_the_unit_that_reads_them(tmp_path):
    """No limit or velocity tells it, weight does; --trust takes them all the same."""
    turned = ("q1", "q2", "qd1", "qd2")  # as drives of direct motors tell them
    arm = spoilt(tmp_path / "arm", lambda table, _: table.assign(**{x: table[x] / (2.0 * np.pi) for x in turned}), None)
    refused = invoke("identify", str(arm / "logs"))
    assert refused.exit_code == 3 and "error[scale-wrong]" in refused.stderr and not refused.stdout
    trusted = invoke("identify", str(arm / "logs"), "--trust")
    assert trusted.exit_code == 0 and "note[scale-wrong]" in trusted.stderr
    (unit,) = re.findall(r"put (units: \{position: \w+\}) into", refused.stderr)
    recipe = arm / "recipe.yaml"
    recipe.write_text(f"{recipe.read_text()}\nlog: {{{unit}}}\n")
    sound = make(tmp_path / "sound")
    texts = [invoke("identify", str(folder / "logs"), "--json").stdout for folder in (arm, sound)]
    ours, theirs = (
        np.array([part["value"] or 0.0 for joint in json.loads(text)["joints"] for part in joint["parameters"]])
        for text in texts
    )
    assert np.allclose(ours, theirs, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize(
    "law", [lambda table: table.i2 + 2.0 * table.q2, lambda table: table.i2 + 0.8 * np.sin(2.0 * table.q2)]
)
def test_a_joint_that_bends_its_own_current_is_no_other_setup(tmp_path, law):
    """A strong spring and a second harmonic are physics: order, loads and gravity are not blamed."""
    told = invoke(
        "identify", str(spoilt(tmp_path / "arm", lambda table, _: table.assign(i2=law(table)), None) / "logs")
    )
    slugs = set(re.findall(r"note\[([a-z-]+)\]", told.stderr))
    assert "model-misses" in slugs and slugs.isdisjoint(SLUGS)


SCARA = """{name: scara, gravity: [0, 0, -9.81], joints: [{type: revolute, alpha: 0, a: 0, d: 0},
  {type: revolute, alpha: 0, a: 0.3, d: 0}, {type: prismatic, alpha: 0, a: 0.2, d: 0, theta: 0}]}"""


COUNTED = 'log: {position: {column: "q{joint}", scale: 1.0001}}'


def test_friction_that_weight_would_have_to_take_away_shows_another_unit(tmp_path):
    """A lever about the level that is counted in fifths, also where noise hides what the unit leaves."""
    q, speed, noise = to_and_fro(1, size=1.3)
    lever = "{name: lever, gravity: [0, -9.81, 0], joints: [{type: revolute, alpha: 0, a: 0, d: 0}]}"

    def drawn(times):
        return 3.5 * np.cos(q) + 0.3 * np.sign(speed) + 0.1 * speed + times * noise

    noisy = invoke("identify", str(written(tmp_path / "noisy", lever, q / 5.0, drawn(5.0))))
    assert noisy.exit_code == 0 and "note[offset-odd]: friction of joint 1 has a mean" in noisy.stderr
    refused = invoke("identify", str(written(tmp_path / "arm", lever, q / 5.0, drawn(0.1))))
    assert refused.exit_code == 3 and "error[scale-wrong]" in refused.stderr
    assert 4.8 < float(re.search(r"scale: ([0-9.]+)", refused.stderr)[1]) < 5.2
    turns = invoke("identify", str(written(tmp_path / "turns", lever, q / (2.0 * np.pi), drawn(1.0))))
    assert turns.exit_code == 3 and "units: {position: rev}" in turns.stderr
    assert invoke("identify", str(written(tmp_path / "right", lever, q, drawn(5.0)))).stderr.count("note[") == 0


def test_counts_that_no_current_tells_are_told(tmp_path):
    make(tmp_path / "arm")
    recipe = tmp_path / "arm" / "recipe.yaml"
    recipe.write_text(f"{recipe.read_text()}\n{COUNTED}\n")
    assert "note[" not in invoke("identify", str(tmp_path / "arm" / "logs")).stderr
    flat = upright(tmp_path / "flat")
    recipe = tmp_path / "flat" / "recipe.yaml"
    recipe.write_text(recipe.read_text().replace("name: scara", f"{COUNTED}, name: scara"))
    assert "what a count of position is" in invoke("identify", str(flat)).stderr


def to_and_fro(n_joints, *, size):
    """(N, J) positions, speeds and noise (A) of joints that move one after the other, the slow middle as in a run."""
    rng, place, path = np.random.default_rng(2), np.zeros(n_joints), []
    for number in range(20 * n_joints):
        joint, steps = number % n_joints, int(100 * rng.uniform(2.0, 6.0))
        ends = np.where(np.arange(n_joints) == joint, size * (-1) ** (number // n_joints), place)
        way = 0.5 - 0.5 * np.cos(np.pi * np.arange(steps) / steps)
        path += [place + way[:, None] * (ends - place), np.tile(ends, (60, 1))]
        place = ends
    q = np.concatenate(path)
    return q, np.round(np.gradient(q, 0.01, axis=0), 9), rng.normal(0.0, 0.02, q.shape)


def written(folder, recipe, q, current):
    """A folder of logs with a recipe above it."""
    (folder / "logs").mkdir(parents=True)
    (folder / "recipe.yaml").write_text(recipe)
    names = ",".join(["t", *(f"{letter}{k + 1}" for letter in "qi" for k in range(q.shape[1]))])
    table = np.column_stack([np.arange(len(q)) * 0.01, q, current])
    np.savetxt(folder / "logs" / "a.csv", table, delimiter=",", header=names, comments="")
    return folder / "logs"


def upright(folder):
    """Logs of a SCARA."""
    q, speed, noise = to_and_fro(3, size=np.array([1.0, 1.0, 0.1]))
    return written(folder, SCARA, q, 0.3 * np.sign(speed) + 0.1 * speed + [0.0, 0.0, 0.8] + noise)


def test_an_arm_whose_joints_cannot_bear_weight_is_not_asked_for_it(tmp_path):
    """Upright axes feel none in any posture, and a slide along gravity a constant one."""
    told = invoke("identify", str(upright(tmp_path)))
    assert told.exit_code == 0 and "weight-missing" not in told.stderr and "lies level" not in told.stdout


def test_results_say_the_unit_of_currents_that_are_torques(tmp_path):
    """No table, sentence or axis of the page says A; numbers are those of amperes."""
    arm = make(tmp_path / "arm")
    (arm / "recipe.yaml").write_text(f"{(arm / 'recipe.yaml').read_text()}\nlog: {{units: {{current: Nm}}}}\n")
    logs, model = str(arm / "logs"), str(arm / "results" / "model.json")
    texts = [
        invoke(*words).stdout
        for words in (("identify", logs), ("compare", model, logs), ("diagnose", model, logs), ("history", str(arm)))
    ]
    assert invoke("report", model, logs).exit_code == 0
    texts.append(re.sub(r"(?s)<(script|style).*?</\1>", "", (arm / "results" / "report.html").read_text()))
    for text in texts:
        assert "N m" in text and re.findall(r".*(?:\(A\b|\d A\b|\bA s/).*", text) == []
