"""The logs and models that the peers are given say of the arm what pumaid's own say."""

import csv

import numpy as np
import peers
import pytest


def test_every_tool_is_told_of_one_arm_and_one_log(tmp_path):
    """pumaid's log and the peers' hold the same; aurt's table, shifted by one joint, is the recipe's geometry.

    The score of the truth itself is zero, and that of no answer at all is one.
    """
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
    for factor in (1.0, 0.0):
        np.savez(folder / "answers.npz", gravity=factor * asked["gravity"], whole=factor * asked["whole"])
        assert list(peers.errors(folder).values()) == pytest.approx([1.0 - factor] * 2)
