"""The logs and models that the peers are given say of the arm what pumaid's own say."""

import csv

import numpy as np
import peers
import pytest
from engines import by_mujoco

from pumaid.simulation.mujoco_engine import specification


def test_every_tool_is_told_of_one_arm_and_one_log(tmp_path, monkeypatch):
    """pumaid's log and the peers' hold the same; aurt's table, shifted by one joint, is the recipe's geometry.

    The score of the truth itself is zero, and that of no answer at all is one; of other motion it is the noise's, also
    for whom the torque constants are wrong.
    """
    monkeypatch.setattr(peers, "OTHER", 20.0)
    folder = tmp_path / "log"
    truth = peers.prepare(folder, 3, peers.together, 100)
    log, asked = np.load(folder / "log.npz"), dict(np.load(folder / "questions.npz"))
    written = np.genfromtxt(folder / "pumaid" / "log.csv", delimiter=",", names=True)
    table = list(csv.DictReader((folder / "arm.csv").read_text().splitlines()))
    angles = {"0": 0.0, "pi/2": np.pi / 2, "-pi/2": -np.pi / 2}
    for j, joint in enumerate(truth.robot.joints):
        assert written[f"q{j + 1}"] == pytest.approx(log["position"][:, j], abs=1e-8)
        assert written[f"i{j + 1}"] / truth.gain[j] == pytest.approx(log["torque"][:, j], rel=1e-6, abs=1e-6)
        assert float(table[j]["d"]) == joint.d
        if j:
            before = table[j - 1]
            assert [float(before["a"]), angles[before["alpha"]]] == pytest.approx([joint.a, joint.alpha], abs=1e-12)
    other = dict(np.load(folder / "other.npz"))
    motion = [other[name] for name in ("position", "velocity", "acceleration")]
    whole = by_mujoco(specification(truth).compile(), motion) + truth.friction.currents(motion[1]) / truth.gain
    wrong = peers.mistaken(folder, 0.1, 0.2)
    share = np.load(wrong / "log.npz")["torque"][0] / log["torque"][0]
    assert np.all((np.abs(share - 1.0) >= 0.1) & (np.abs(share - 1.0) <= 0.2))
    for factor in (1.0, 0.0):
        for place, of_joint in ((folder, 1.0), (wrong, share)):
            answers = {name: factor * asked[name] for name in ("gravity", "whole")}
            np.savez(place / "answers.npz", **answers, other=factor * of_joint * whole)
            shares = peers.errors(place)
            noise = shares.pop("its noise")
            assert 0.005 < noise < 0.05
            expected = 0.0 if factor else 1.0
            assert [shares["gravity off"], shares["friction off"]] == pytest.approx([expected] * 2)

            assert shares["other motion off"] == pytest.approx(1.0 if not factor else noise, rel=0.25)
