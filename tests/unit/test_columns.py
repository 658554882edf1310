"""Columns in other units: ticks, counts, lost signs. A refusal shows the block that mends it, and that block does."""

import re
from pathlib import Path

import numpy as np
import pytest

from pumaid.dataset import Log
from pumaid.errors import Faults, LogError, PumaidError
from pumaid.io.log_reader import LogReader
from pumaid.io.recipe import parsed_recipe
from pumaid.io.write import write_log
from pumaid.preprocessing.ingest import ingest
from pumaid.robot import Robot

JOINTS = """name: two joints
gravity: [0, 0, -9.80665]
units: {angle: deg}
joints:
  - {name: hip, type: revolute, theta: -90, alpha: 90, a: 0, d: 0, limits: [-160, 160], max_velocity: 180}
  - {name: knee, type: revolute, theta: 0, alpha: 0, a: 0.3, d: 0, limits: [-160, 160], max_velocity: 180}
"""


def robot(block: str = "") -> Robot:
    """Two joints, and a `log` block."""
    return parsed_recipe(f"{JOINTS}{block}".encode(), "recipe.yaml")


def motion(seed: int = 3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, (N, 2) positions of strokes to and fro at several speeds, and currents with gravity, friction and noise."""
    rng = np.random.default_rng(seed)
    place, path = np.zeros(2), []
    for count in range(16):
        target = np.where(np.arange(2) == count % 2, rng.uniform(0.5, 2.3) * (-1) ** (count // 2), place)
        steps = int(np.abs(target - place).max() / rng.uniform(0.3, 1.2) * 100)
        path.append(place + np.linspace(0, 1, steps)[:, None] * (target - place))
        path.append(np.repeat(target[None], 40, axis=0))
        place = target
    q = np.concatenate(path)
    way = np.sign(np.gradient(q, axis=0))
    current = 0.3 * np.sin(q) + 0.1 * way + rng.normal(scale=0.01, size=q.shape)
    return np.arange(len(q)) * 0.01, q, current


def table(path: Path, names: str, *columns: np.ndarray) -> Path:
    """A CSV of these columns as plain Python writes them."""
    rows = zip(*(column.T.tolist() if column.ndim == 1 else column.tolist() for column in columns), strict=True)
    cells = ([cell for part in row for cell in (part if isinstance(part, list) else [part])] for row in rows)
    path.write_text("\n".join([names, *(",".join(map(repr, row)) for row in cells)]) + "\n")
    return path


def refused(path: Path, arm: Robot) -> PumaidError:
    """The first refusal of a log."""
    with pytest.raises((LogError, Faults)) as caught:
        ingest([path], arm)
    return caught.value.faults[0] if isinstance(caught.value, Faults) else caught.value


def pasted(error: PumaidError) -> Robot:
    """The recipe with the block that a refusal shows."""
    return robot(error.mend[error.mend.index("log:\n") :])


def read(path: Path, arm: Robot) -> Log:
    """The samples of a log that is not refused."""
    ingest([path], arm)
    return Log.joined(list(LogReader(path, arm)))


@pytest.mark.parametrize(
    ("counts", "angle", "zero"),
    [(4096, 2 * np.pi, 2048), (1023, np.radians(300), 511), (2**18, 2 * np.pi, 0), (2**14, 2 * np.pi, 2**13)],
)
def test_counts_of_encoders_are_refused_with_the_block_that_reads_them(
    tmp_path: Path, counts: int, angle: float, zero: int
) -> None:
    """Ticks are no radians; the block gives positions to half a tick, and speeds are not those of the drive."""
    time, q, current = motion()
    q = q * min(1.0, 2.2 / np.abs(q).max())
    ticks = np.round(q * counts / angle).astype(int) + zero
    speed = np.round(np.gradient(q, time, axis=0) / 0.02398).astype(int)
    path = table(tmp_path / "log.csv", "t,q1,q2,qd1,qd2,i1,i2", time, ticks, speed, current)
    error = refused(path, robot())
    assert error.slug == "units-disagree" and f"{counts} counts" in error.mend
    log = read(path, pasted(error))
    assert np.abs(log.position - q).max() <= 0.501 * angle / counts and log.velocity is None


@pytest.mark.parametrize("step", [1.0, 2.69])
@pytest.mark.parametrize("form", ["two's complement", "sign bit"])
def test_lost_signs_are_mended_by_the_block_of_their_refusal(tmp_path: Path, form: str, step: float) -> None:
    """Sixteen bits that NumPy reads as unsigned, and a magnitude below bit 10 as servos write their load."""
    time, q, current = motion()
    counts = np.round(2000.0 * current).astype(np.int16)
    unsigned = counts.view(np.uint16) if form == "two's complement" else np.abs(counts) + 1024 * (counts < 0)
    path = table(tmp_path / "log.csv", "t,q1,q2,i1,i2", time, q, np.round(step * unsigned.astype(float), 6))
    error = refused(path, robot("log: {units: {current: mA}}"))
    assert error.slug == "sign-lost"
    np.testing.assert_allclose(read(path, pasted(error)).current, 1e-3 * step * counts, atol=1e-9)


def test_position_whose_sign_is_two_s_complement(tmp_path: Path) -> None:
    """Ticks below zero that stand as 65,535 and less are refused, and read with their encoding."""
    time, q, current = motion()
    q = q * min(1.0, 2.0 / np.abs(q).max()) - 0.4
    ticks = np.round(q * 4096 / 2 / np.pi).astype(np.int16)
    path = table(tmp_path / "log.csv", "t,q1,q2,i1,i2", time, ticks.view(np.uint16).astype(int), current)
    error = refused(path, robot("log: {position: {column: 'q{joint}', scale: 0.00153398}}"))
    assert "uint16-two-complement" in error.mend
    assert np.abs(read(path, pasted(error)).position - q).max() < 1e-3


def test_scale_and_zero_of_each_joint(tmp_path: Path) -> None:
    """(number - zero) * scale, one for all or one a joint; what is written in such columns is read again."""
    arm = robot(
        "log:\n  position: {column: 'p_{name}', scale: [0.5, -2], zero: [100, 3]}\n"
        "  current: {column: 'c{joint}', scale: 2.69, zero: 5}\n  units: {current: mA}\n"
    )
    numbers = np.array([[102.0, 2.0], [101.0, 4.0]]), np.array([[6.0, 5.0], [5.0, 4.0]])
    path = table(tmp_path / "log.csv", "t,p_hip,p_knee,c1,c2", np.array([0.0, 0.1]), *numbers)
    (log,) = LogReader(path, arm)
    np.testing.assert_allclose(log.position, [[1.0, 2.0], [0.5, -2.0]])
    np.testing.assert_allclose(log.current, [[0.00269, 0.0], [0.0, -0.00269]])
    write_log(tmp_path / "again.csv", [log], arm)
    (again,) = LogReader(tmp_path / "again.csv", arm)
    np.testing.assert_allclose(again.position, log.position)
    np.testing.assert_allclose(again.current, log.current)


@pytest.mark.parametrize(
    ("column", "words"),
    [
        ("scale: [1, 2, 3]", "3 values of scale for 2 joints"),
        ("scale: 0", "a scale is not zero"),
        ("encoding: magnitude", "sizes without sign"),
        ("zeros: 3", "did you mean zero"),
    ],
)
def test_what_no_column_can_mean_is_refused(column: str, words: str) -> None:
    """With its place, and how to write it."""
    with pytest.raises(PumaidError, match=re.escape(words)) as caught:
        robot(f"log: {{position: {{column: 'p{{joint}}', {column}}}}}\n")
    assert "log.position" in str(caught.value)


def test_currents_in_counts_are_noted(tmp_path: Path) -> None:
    """Whole amperes are counts; once they have a scale nothing is said."""
    time, q, current = motion()
    path = table(tmp_path / "log.csv", "t,q1,q2,i1,i2", time, q, np.round(200 * current).astype(int))
    texts = [note.text for note in ingest([path], robot()).notes]
    assert any("whole numbers" in text for text in texts)
    scaled = robot("log: {current: {column: 'i{joint}', scale: 0.005}}\n")
    assert not any("whole numbers" in note.text for note in ingest([path], scaled).notes)
