"""Logs in their writers' columns and units: joined by name, ticks, counts, lost signs.

A refusal shows the block that mends it, and that block does.
"""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import pumaid
from pumaid.dataset import Log
from pumaid.errors import Faults, LogError, PumaidError
from pumaid.io import log_form
from pumaid.io.log_reader import LogReader
from pumaid.io.recipe import parsed_recipe
from pumaid.io.write import write_log
from pumaid.preprocessing.encodings import lost_sign, size_counts
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
    [
        (4096, 2 * np.pi, 2048),
        (4096, 2 * np.pi, 6144),
        (1023, np.radians(300), 512),
        (2**18, 2 * np.pi, 0),
        (2**14, 2 * np.pi, 2**13),
        (36000, 2 * np.pi, 0),
    ],
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


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("counts", [3600, 4096, 2000.0 * np.pi, 8192])
def test_gravity_tells_how_many_counts_make_a_turn(tmp_path: Path, counts: float, seed: int) -> None:
    """Its waves have the length of a turn, whatever fits the limits: tenths of a degree are no ticks of servos."""
    time, q, current = motion(seed)
    path = table(tmp_path / "log.csv", "t,q1,q2,i1,i2", time, np.round(q * counts / 2 / np.pi).astype(int), current)
    error = refused(path, robot())
    assert "gravity fits so, and not 360 degrees in" in error.mend
    assert np.abs(read(path, pasted(error)).position - q).max() <= 0.501 * 2 * np.pi / counts


@pytest.mark.parametrize("seed", range(4))
def test_friction_that_grows_with_the_load_passes_for_no_other_count(tmp_path: Path, seed: int) -> None:
    """Its square bends the waves of gravity; ticks of a servo stay ticks."""
    time, q, current = motion(seed)
    current += 3.0 * np.sign(np.gradient(q, axis=0)) * (0.3 * np.sin(q)) ** 2
    ticks = np.round(q * 4096 / 2 / np.pi).astype(int)
    path = table(tmp_path / "log.csv", "t,q1,q2,i1,i2", time, ticks, current)
    assert "if 360 degrees are 4096 counts" in refused(path, robot()).mend


def test_where_no_weight_tells_the_count_all_that_fit_are_named(tmp_path: Path) -> None:
    """Friction alone shows no turn: the block is of the usual servo, and says what else it may be."""
    time, q, current = motion()
    path = table(tmp_path / "log.csv", "t,q1,q2,i1,i2", time, np.round(573 * q).astype(int), current - 0.3 * np.sin(q))
    mend = refused(path, robot()).mend
    assert "if 360 degrees are 4096 counts" in mend
    assert "ratios are others with what fits too: 360 degrees in 3600" in mend


def test_hundredths_of_a_calibrated_range_are_no_angles(tmp_path: Path) -> None:
    """Refused in whatever unit they are read; the block puts their ends at the joints' limits."""
    time, q, current = motion()
    shares = np.round(200 * (q - q.min(axis=0)) / np.ptp(q, axis=0) - [100, 0], 3) / [1, 2]
    path = table(tmp_path / "log.csv", "t,q1,q2,i1,i2", time, shares, current)
    for unit in ("deg", "rad"):
        error = refused(path, robot(f"log: {{units: {{position: {unit}}}}}"))
        log = read(path, pasted(error))
        np.testing.assert_allclose(np.ptp(log.position, axis=0), np.radians([320, 320]), rtol=1e-6)
        np.testing.assert_allclose(log.position.max(axis=0), np.radians([160, 160]), rtol=1e-6)


def test_degrees_from_0_to_360_begin_anew_at_a_turn(tmp_path: Path) -> None:
    time, q, current = motion()
    speed = np.degrees(np.gradient(q, time, axis=0))
    path = table(tmp_path / "log.csv", "t,q1,q2,qd1,qd2,i1,i2", time, np.degrees(q) % 360.0, speed, current)
    error = refused(path, robot())
    assert "units: {position: deg}" in error.mend
    assert np.abs(read(path, pasted(error)).position - q).max() < 1e-6


@pytest.mark.parametrize("counts", [4096, 16384])
def test_encoders_that_begin_anew_are_taken_as_continuous(tmp_path: Path, counts: int) -> None:
    """A range from 0 to the last count of a turn is one, not a sign that was lost."""
    time, q, current = motion()
    ticks = np.round(q * counts / 2 / np.pi).astype(int) % counts
    path = table(tmp_path / "log.csv", "t,q1,q2,i1,i2", time, ticks, current)
    log = read(path, pasted(refused(path, robot())))
    assert np.abs(log.position - q).max() <= 0.501 * 2 * np.pi / counts


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


@pytest.mark.parametrize(
    ("true", "wrong", "ampere"), [("feetech-sts", "dynamixel-x", 0.0065), ("dynamixel-x", "feetech-sts", 0.00269)]
)
def test_the_preset_of_servos_is_that_whose_sign_the_currents_show(
    tmp_path: Path, true: str, wrong: str, ampere: float
) -> None:
    """Both makers' columns are alike: the block offered reads their currents, and the other maker's is refused."""
    time, q, current = motion()
    q = q * min(1.0, 2.2 / np.abs(q).max())
    counts = np.round(3.0 * current / ampere).astype(np.int16)
    raw = np.abs(counts.astype(int)) + 32768 * (counts < 0) if true == "feetech-sts" else counts.view(np.uint16)
    ticks = np.round(q * 4096 / 2 / np.pi).astype(int) + 2048
    names = "timestamp,present_position_1,present_position_2,present_current_1,present_current_2"
    path = table(tmp_path / "log.csv", names, time, ticks, raw)
    columns = "log: {time: timestamp, position: 'present_position_{joint}', current: 'present_current_{joint}'}"
    for error in (refused(path, robot(columns)), refused(path, robot(f"log: {{preset: {wrong}}}"))):
        assert f"preset: {true}" in error.mend
        np.testing.assert_allclose(read(path, pasted(error)).current, ampere * counts, atol=1e-9)
    assert error.slug == "sign-lost"


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
        "log:\n  time: [sec, nsec]\n  position: {column: 'p_{name}', scale: [0.5, -2], zero: [100, 3]}\n"
        "  current: {column: 'c{joint}', scale: 2.69, zero: 5}\n  units: {current: mA}\n"
    )
    numbers = np.array([[102.0, 2.0], [101.0, 4.0]]), np.array([[6.0, 5.0], [5.0, 4.0]])
    path = table(tmp_path / "log.csv", "sec,nsec,p_hip,p_knee,c1,c2", np.array([[3, 0], [3, 10**8]]), *numbers)
    (log,) = LogReader(path, arm)
    np.testing.assert_allclose(log.position, [[1.0, 2.0], [0.5, -2.0]])
    np.testing.assert_allclose(log.current, [[0.00269, 0.0], [0.0, -0.00269]])
    write_log(tmp_path / "again.csv", [log], arm)
    (again,) = LogReader(tmp_path / "again.csv", arm)
    for name in ("time", "position", "current"):
        np.testing.assert_allclose(getattr(again, name), getattr(log, name))


@pytest.mark.parametrize(
    ("column", "words"),
    [
        ("scale: [1, 2, 3]", "3 values of scale for 2 joints"),
        ("scale: 0", "a scale is zero"),
        ("encoding: magnitude", "sizes without sign"),
        ("zeros: 3", "did you mean zero"),
    ],
)
def test_what_no_column_can_mean_is_refused(column: str, words: str) -> None:
    with pytest.raises(PumaidError, match=re.escape(words)) as caught:
        robot(f"log: {{position: {{column: 'p{{joint}}', {column}}}}}\n")
    assert "log.position" in str(caught.value)


def test_sizes_of_one_joint_whose_friction_outweighs_its_weight_are_told(tmp_path: Path) -> None:
    """They stay clear of zero, but weight turns round with the direction; with an offset of a sensor it does not."""
    way = np.concatenate([np.linspace(*ends, 250) for ends in 4 * ((0.0, 1.2), (1.2, 0.0))])
    q = np.vstack([np.column_stack([way, 0.0 * way]), np.column_stack([0.0 * way, way])])
    noise = np.random.default_rng(4).normal(scale=0.01, size=q.shape)
    current = 0.1 * np.sin(q) + 0.3 * np.sign(np.gradient(q, axis=0)) + noise
    time, sizes = np.arange(len(q)) * 0.01, np.column_stack([current[:, 0], np.abs(current[:, 1])])
    error = refused(table(tmp_path / "log.csv", "t,q1,q2,i1,i2", time, q, sizes), robot())
    assert (error.slug, error.where.joint) == ("sign-lost", 2) and "with its sign" in error.mend
    ingest([table(tmp_path / "log.csv", "t,q1,q2,i1,i2", time, q, current + np.array([0.0, 0.6]))], robot())


@pytest.mark.parametrize(("bottom", "is_lost"), [(0.0, True), (1.01, False), (1.02, False)])
def test_a_current_that_nearly_reaches_zero_has_its_sign(bottom: float, is_lost: bool) -> None:
    """A folded sine goes down to zero; one that turns half a hundredth of its size above it was refused, too."""
    assert bool(lost_sign(size_counts(np.abs(bottom + np.sin(np.linspace(0.1, 40.0, 9001)))), 1e-4)[0]) is is_lost


def test_currents_in_counts_are_refused_until_a_recipe_says_so(tmp_path: Path) -> None:
    """Whole amperes are counts: with a scale they are A, and with the block of the refusal results say counts."""
    time, q, current = motion()
    path = table(tmp_path / "log.csv", "t,q1,q2,i1,i2", time, q, np.round(200 * current).astype(int))
    error = refused(path, robot())
    assert error.slug == "units-disagree" and "whole numbers" in error.what
    assert "units: {current: raw}" in error.mend
    (note,) = ingest([path], robot("log: {units: {current: raw}}\n")).notes
    assert "currents are in counts" in note.text
    assert not ingest([path], robot("log: {current: {column: 'i{joint}', scale: 0.005}}\n")).notes


def frame(path: Path, columns: dict[str, object]) -> Path:
    """A CSV or Parquet file as pandas writes it."""
    data = pd.DataFrame(columns)
    data.to_csv(path, index=False) if path.suffix == ".csv" else data.to_parquet(path, index=False)
    return path


def by_name(array: np.ndarray, pattern: str) -> dict[str, object]:
    """Columns of the joints in alphabetical order, which is not theirs: the knee's numbers stand first."""
    return {pattern.format(name): array[:, k] for k, name in ((1, "a_knee"), (0, "b_hip"))}


#: The two joints under names in whose alphabetical order the second comes first.
NAMED = JOINTS.replace("name: hip", "name: b_hip").replace("name: knee", "name: a_knee")
NAMES = ["a_knee_joint", "b_hip_joint"]


def flipped(array: np.ndarray, pattern: str) -> dict[str, object]:
    """Columns by number, in the order of `NAMES`."""
    return {pattern.format(k): array[:, 1 - k] for k in (0, 1)}


def bag_table(path: Path) -> Path:
    """As bagpy writes joint states: numbered columns, and the names of joints as a list in each row."""
    time, q, current = motion()
    names = {"Time": time + 1.7e9, "name": [str(NAMES)] * len(time)}
    return frame(path, names | flipped(q, "position_{}") | flipped(current, "effort_{}"))


def plotted(path: Path) -> Path:
    """As PlotJuggler writes two topics: a row a message, empty where it is of the other topic."""
    time, q, current = motion()
    table = pd.DataFrame(
        {"__time": time}
        | by_name(q, "/joint_states/{}_joint/position")
        | by_name(current, "/joint_states/{}_joint/effort")
    )
    force = pd.DataFrame({"__time": time + 0.003, "/wrench/force/x": 1.0})
    pd.concat([table, force]).sort_values("__time").to_csv(path, index=False)
    return path


def echoed(path: Path) -> Path:
    """As `rostopic echo -p` prints joint states: nanoseconds, and the names of joints in columns of their own."""
    time, q, current = motion()
    stamps = {"%time": (np.round(time * 1e9) + 1.7e18).astype(np.int64)}
    names = {f"field.name{k}": [name] * len(time) for k, name in enumerate(NAMES)}
    return frame(path, stamps | names | flipped(q, "field.position{}") | flipped(current, "field.effort{}"))


def headless(path: Path) -> Path:
    """As `ros2 topic echo --csv` prints joint states: no header, no velocity's name, one row a message."""
    time, q, current = motion()
    rows = zip(np.round(time * 1e9).astype(int), np.hstack([q[:, ::-1], 0 * q, current[:, ::-1]]).tolist(), strict=True)
    lines = [f"{1700000000 + ns // 10**9},{ns % 10**9},,{','.join([*NAMES, *map(repr, row)])}" for ns, row in rows]
    path.write_text("\n".join(lines) + "\n")
    return path


def lists(path: Path) -> Path:
    """Messages whose arrays stand in cells, with other joints' messages between them."""
    time, q, current = motion()
    hand = {"stamp": 1.7e9 + time + 0.005, "name": [["finger"]] * len(time), "position": [[9.0]] * len(time)}
    arm = {"stamp": 1.7e9 + time, "name": [NAMES] * len(time), "position": q[:, ::-1].tolist()}
    arm |= {"effort": current[:, ::-1].tolist()}
    table = pd.concat([pd.DataFrame(arm), pd.DataFrame(hand)]).sort_values("stamp")
    table["effort"] = [cell if isinstance(cell, list) else [] for cell in table["effort"]]
    return frame(path, {name: table[name].tolist() for name in table})


def tidy(path: Path) -> Path:
    """A row for each joint, which are polled one after the other."""
    time, q, current = motion()
    order = [(1, NAMES[0], 0.0), (0, NAMES[1], 0.002)]
    parts = [
        pd.DataFrame({"time": time + late, "joint_name": name, "position": q[:, k], "effort": current[:, k]})
        for k, name, late in order
    ]
    pd.concat(parts).sort_values("time").to_csv(path, index=False)
    return path


@pytest.mark.parametrize("written", [bag_table, plotted, echoed, headless, lists, tidy, "parquet"])
def test_joints_are_joined_by_name(tmp_path: Path, written: Callable[[Path], Path] | str) -> None:
    """Whatever their order in messages or columns; rows of other topics and joints are passed over.

    The block that is printed reads the same when it is pasted.
    """
    _, q, current = motion()
    path = lists(tmp_path / "log.parquet") if isinstance(written, str) else written(tmp_path / "log.csv")
    arm = parsed_recipe(NAMED.encode(), "recipe.yaml")
    dataset = ingest([path], arm)
    (text,) = [note.text for note in dataset.notes if note.slug == "columns-named" and "log:" in note.text]
    for recipe in (arm, parsed_recipe(f"{NAMED}{text[text.index('log:') :]}".encode(), "recipe.yaml")):
        log = Log.joined(list(LogReader(path, recipe)))
        np.testing.assert_allclose(log.position, q)
        np.testing.assert_allclose(log.current, current)
        np.testing.assert_allclose(np.diff(log.time), 0.01, atol=1e-6)


def test_a_recording_of_some_of_a_preset_s_columns_is_read_by_those(tmp_path: Path) -> None:
    """Without speeds and temperatures the block that is printed has none, and nothing is told absent."""
    t, q, current = motion()
    values = {f"actual_q_{k}": q[:, k] for k in range(q.shape[1])}
    values |= {f"actual_current_{k}": current[:, k] for k in range(q.shape[1])}
    pd.DataFrame({"timestamp": t} | values).to_csv(tmp_path / "log.csv", index=False)
    notes = ingest([tmp_path / "log.csv"], parsed_recipe(NAMED.encode(), "recipe.yaml")).notes
    (text,) = [note.text for note in notes if note.slug == "columns-named"]
    assert "actual_current_{joint0}" in text and "actual_qd" not in text and "temperatures" not in text
    assert not any(note.slug == "column-absent" for note in notes)


def test_columns_by_number_that_are_another_joint_s_are_refused(tmp_path: Path) -> None:
    """The log's own names contradict the recipe's count; the block reads by name."""
    path = bag_table(tmp_path / "log.csv")
    block = "log:\n  time: Time\n  position: 'position_{joint0}'\n  current: 'effort_{joint0}'\n"
    error = refused(path, parsed_recipe(f"{NAMED}{block}".encode(), "recipe.yaml"))
    assert error.slug == "joints-swapped"
    mended = parsed_recipe(f"{NAMED}{error.mend[error.mend.index('log:') :]}".encode(), "recipe.yaml")
    np.testing.assert_allclose(Log.joined(list(LogReader(path, mended))).position, motion()[1])


@pytest.mark.parametrize(
    ("header", "encoding"),
    [
        ("Zeit [ms],Gelenkwinkel 1 (°),Gelenkwinkel 2 (°),Motorstrom 1 (mA),Motorstrom 2 (mA)", "utf-8"),
        ("temps_ms,position_1_deg,position_2_deg,courant_1_mA,courant_2_mA", "utf-8"),
        ("Tiempo (ms),Posición 1 (deg),Posición 2 (deg),Corriente 1 (mA),Corriente 2 (mA)", "latin-1"),
        ("时间ms,关节1角度(度),关节2角度(度),关节1电流(mA),关节2电流(mA)", "gb18030"),
        ("時間(ms),位置1[deg],位置2[deg],電流1[mA],電流2[mA]", "utf-16"),
        ("時間(ms),位置1[deg],位置2[deg],電流1[mA],電流2[mA]", "shift_jis"),
        ("time_ms,angle_01_deg,angle_02_deg,cur_01_mA,cur_02_mA", "utf-8"),
        # KUKA's trace, sensor interface and variables, ABB, FANUC; ODrive comes last.
        ("Zeit,Istposition_A1,Istposition_A2,Iststrom_A1,Iststrom_A2,Sollposition_A1,Sollposition_A2", "utf-8"),
        ("Time,AIPos.A1,AIPos.A2,MACur.A1,MACur.A2", "utf-8"),
        ("t,$AXIS_ACT_A1,$AXIS_ACT_A2,$CURR_ACT_1,$CURR_ACT_2,$VEL_AXIS_ACT_1,$VEL_AXIS_ACT_2", "utf-8"),
        ("time,J1,J2,motor_current_1,motor_current_2", "utf-8"),
        ("Time,J1 Angle,J2 Angle,J1 Current,J2 Current", "utf-8"),
        ("Time,Hip_Position,Knee_Position,Hip_Current,Knee_Current", "utf-8"),
        ("TIME,HIP.POS,KNEE.POS,HIP.CURRENT,KNEE.CURRENT", "utf-8"),
        ("시간,위치1,위치2,전류1,전류2", "utf-8"),
        ("tempo,posizione_1,posizione_2,corrente_1,corrente_2", "utf-8"),
        (
            "t,[ID:001] Present Position,[ID:002] Present Position,[ID:001] Present Current,[ID:002] Present Current",
            "ascii",
        ),
        ("time,axis0.pos_estimate,axis1.pos_estimate,axis0.motor.foc.Iq_measured,axis1.motor.foc.Iq_measured", "utf-8"),
    ],
)
def test_columns_are_known_as_controllers_and_people_name_them(tmp_path: Path, header: str, encoding: str) -> None:
    """In seven languages and their programs' letters; the measured ones, capitals apart, ODrive's in turns."""
    time, q, current = motion()
    more, size = np.zeros((len(time), header.count(",") - 4)), 1e-3 if "mA" in header else 1.0
    unit = 2.0 * np.pi if "pos_estimate" in header else np.pi / 180.0 if "mA" in header else 1.0
    path = table(tmp_path / "log.csv", header, time / size, q / unit, current / size, more)
    path.write_bytes(path.read_text().encode(encoding))
    (log,) = LogReader(path, robot())
    np.testing.assert_allclose(log.position, q)
    np.testing.assert_allclose(log.current, current)
    np.testing.assert_allclose(log.time, time, atol=1e-9)


def test_thousandths_that_names_tell(tmp_path: Path) -> None:
    """Of a radian and of a newton metre; CiA 402's torques are thousandths of the rated one."""
    time, q, current = motion()
    for torque, shown in (("tau{}_mNm", "N m"), ("torque_actual_value_{}", "rated torque")):
        names = ",".join(["t,q1_mrad,q2_mrad,qd1_mrad,qd2_mrad", torque.format(1), torque.format(2)])
        speed = 1e3 * np.gradient(q, time, axis=0)
        path = table(tmp_path / "log.csv", names, time, 1e3 * q, speed, np.round(1e3 * current))
        log = read(path, robot())
        assert log.velocity is not None and np.abs(log.velocity - 1e-3 * speed).max() < 1e-9
        assert np.abs(log.position - q).max() < 1e-9 and np.abs(log.current - current).max() <= 0.501e-3
        assert any(f"in {shown};" in note.text for note in ingest([path], robot()).notes)


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_episodes_of_a_file_are_recordings_of_their_own(tmp_path: Path, ending: str) -> None:
    """As LeRobot writes several into one file: time begins anew, and no run reaches from one into the next."""
    time, q, current = motion()
    half = len(time) // 2
    episode = np.repeat([3, 4], [half, len(time) - half])
    columns = {"episode_index": episode, "t": np.where(episode > 3, time - time[half], time)}
    columns |= {f"{name}{k + 1}": part[:, k] for name, part in (("q", q), ("i", current)) for k in (0, 1)}
    dataset = ingest([frame(tmp_path / f"log.{ending}", columns)], robot())
    apart = [frame(tmp_path / f"{n}.csv", {k: v[episode == n] for k, v in columns.items()}) for n in (3, 4)]
    runs = ingest(apart, robot()).runs
    assert [(run.clock, run.start, run.samples) for run in dataset.runs] == [
        (run.clock, run.start, run.samples) for run in runs
    ]
    assert {run.clock for run in runs} == {0, 1}


def test_a_topic_is_that_of_the_joint_states_to_read(tmp_path: Path) -> None:
    """Two arms in one recording: the one that is named; and what was commanded may be named beside it."""
    time, q, current = motion()
    columns: dict[str, object] = {"t": time}
    for topic, sign in (("/left/joint_states", 1), ("/right/joint_states", -1)):
        for what, part in (("position", q), ("effort", current)):
            columns |= {f"{topic}/{name}/{what}": sign * part[:, k] for k, name in enumerate(("hip", "knee"))}
    path = frame(tmp_path / "log.csv", columns)
    error = refused(path, robot())
    assert "/left/joint_states, /right/joint_states" in error.mend
    np.testing.assert_allclose(read(path, pasted(error)).position, q)
    arm = robot("log: {topic: right/joint_states, commanded: '/right/command/{name}/position'}\n")
    np.testing.assert_allclose(read(path, arm).position, -q)


def test_units_and_stamps_that_a_file_states(tmp_path: Path) -> None:
    """A line of units below the names is followed, and so are dates with times."""
    time, q, current = motion()
    path = table(tmp_path / "log.csv", "t,q1,q2,i1,i2", time, np.degrees(q), 1e3 * current)
    lines = path.read_text().splitlines()
    dates = pd.to_datetime(np.round(1e3 * time).astype(int), unit="ms", origin="2024-05-01").strftime(
        "%Y-%m-%d %H:%M:%S.%f"
    )
    for zone in ("", "+02:00"):
        rows = [f"{date}{zone},{line.partition(',')[2]}" for date, line in zip(dates, lines[1:], strict=True)]
        path.write_text("\n".join(["Logged by hand", lines[0], "[s],[deg],[deg],[mA],[mA]", *rows]) + "\n")
        (log,) = LogReader(path, robot())
        np.testing.assert_allclose(log.position, q)
        np.testing.assert_allclose(log.current, current)
        np.testing.assert_allclose(log.time - log.time[0], time, atol=1e-6)
        assert log.rows[0] == 4


@pytest.mark.parametrize(
    "header",
    [
        "t,q_1,q_2,angle_1,angle_2,i_1,i_2",  # two positions
        "t,q_0,q_1,q_2,i_0,i_1,i_2",  # three joints, or counted from 1
        "t_a stamp,t_b stamp,q_1,q_2,i_1,i_2",  # two clocks
    ],
)
def test_columns_in_doubt_are_offered_not_used(tmp_path: Path, header: str) -> None:
    """Another joint's or clock's numbers would be fitted without a word."""
    path = table(tmp_path / "log.csv", header, np.zeros((3, header.count(",") + 1)))
    assert refused(path, robot()).slug == "column-missing"


def servo(columns: str, q: np.ndarray, current: np.ndarray) -> dict[str, np.ndarray]:
    """Registers of two servos as their manuals say: counts of positions and currents in C's integers."""
    position, effort = columns.split()
    ticks = np.rint(q / (2 * np.pi / 4096)).astype(np.int32) + 2048
    counts = np.rint(current).astype(np.int16)
    return {f"{name}_{k + 1}": part[:, k] for k in (0, 1) for name, part in ((position, ticks), (effort, counts))}


def with_bit(numbers: np.ndarray, bit: int) -> np.ndarray:
    """Sizes with the sign in a bit."""
    return np.abs(numbers) | ((numbers < 0).astype(np.int32) << bit)


#: Of each preset: the columns that its device writes for time (s), positions (rad) and currents (A).
DEVICES: dict[str, Callable[..., dict[str, object]]] = {
    "ur-rtde": (
        lambda t, q, i: (
            {"timestamp": t + 5e4}
            | {f"actual_q_{k}": q[:, k] for k in (0, 1)}
            | {f"target_q_{k}": 0 * t for k in (0, 1)}
            | {f"{name}_{k}": i[:, k] for name in ("actual_current", "actual_current_window") for k in (0, 1)}
        )
    ),
    "joint_state": (
        lambda t, q, i: (
            {"t": t}
            | {
                f"/joint_states/{n}/{w}": a[:, k]
                for w, a in (("effort", i), ("position", q))
                for k, n in enumerate(("hip", "knee"))
            }
        )
    ),
    "dynamixel-x": (lambda t, q, i: {"timestamp": t} | servo("present_position present_current", q, i * 1e3 / 2.69)),
    "dynamixel-xl330": (lambda t, q, i: {"timestamp": t} | servo("present_position present_current", q, i * 1e3)),
    "dynamixel-xl430": (lambda t, q, i: {"timestamp": t} | servo("present_position present_load", q, i * 1e3)),
    "feetech-sts": (
        lambda t, q, i: (
            {"timestamp": t}
            | {
                name: with_bit(part, 15) if "current" in name else part
                for name, part in servo("present_position present_current", q, i * 1e3 / 6.5).items()
            }
        )
    ),
    "feetech-scs": (
        lambda t, q, i: (
            {"timestamp": t}
            | {f"present_position_{k + 1}": np.rint(np.degrees(q[:, k]) / 300 * 1023).astype(int) + 512 for k in (0, 1)}
            | {f"present_load_{k + 1}": with_bit(np.rint(1e3 * i[:, k]).astype(int), 10) for k in (0, 1)}
        )
    ),
    "franka": (
        lambda t, q, i: (
            {"time": np.rint(1e3 * t), " success_rate": 0 * t + 1}
            | {f" state.{name}[{k}]": part[:, k] for name, part in (("q", q), ("tau_J", i)) for k in (0, 1)}
        )
    ),
    "lerobot": (
        lambda t, q, i: (
            {"timestamp": t}
            | {f"{n}.pos": np.degrees(q[:, k]) for k, n in enumerate(("hip", "knee"))}
            | {f"{n}.load": with_bit(np.rint(1e3 * i[:, k]).astype(int), 10) for k, n in enumerate(("hip", "knee"))}
        )
    ),
}


@pytest.mark.parametrize("preset", DEVICES)
def test_presets_read_what_their_devices_write(tmp_path: Path, preset: str) -> None:
    time, q, current = motion()
    q = 0.8 * q
    path = frame(tmp_path / "log.csv", DEVICES[preset](time, q, current))
    log = read(path, robot(f"log: {{preset: {preset}}}\n"))
    assert np.abs(log.position - q).max() <= 0.00256
    assert np.abs(log.current - current).max() <= 0.00326
    np.testing.assert_allclose(np.diff(log.time), 0.01, atol=1e-9)


def test_every_preset_is_a_log_block_and_tells_its_source() -> None:
    """One file each; those with counts that only the user knows are refused until a scale is stated."""
    for path in (Path(log_form.__file__).parent / "presets").glob("*.yaml"):
        assert path.read_text().startswith("source: ")
        assert robot(f"log: {{preset: {path.stem}}}\n").log.position


def test_a_preset_is_offered_for_its_columns_and_overridden(tmp_path: Path) -> None:
    """Of a log without a block; a part of a quantity that is stated goes over the preset's, the rest stays."""
    time, q, current = motion()
    current += 0.3 * (np.sin(0.8 * q) - np.sin(q))  # gravity of these positions
    path = frame(tmp_path / "log.csv", DEVICES["dynamixel-x"](time, 0.8 * q, current))
    error = refused(path, robot())
    assert "preset: dynamixel-x  # dynamixel-xl330 has 0.372 times its currents" in error.mend
    assert np.abs(read(path, pasted(error)).position - 0.8 * q).max() < 1e-3
    log = robot("log: {preset: dynamixel_x, position: {zero: 0}, current: 'i{joint}', units: {current: A}}\n").log
    assert (log.conversion("position", 1).zero, log.conversion("position", 1).scale) == (0.0, np.pi / 2048)
    assert (log.column("current", 2), log.conversion("current", 2).scale) == ("i2", 2.69)
    with pytest.raises(PumaidError, match="did you mean ur-rtde"):
        robot("log: {preset: ur-rtd}\n")


@pytest.mark.parametrize("form", ["Present_{}_{}", "{1}/present_{0}", "[ID:00{1}] Present {0}"])
def test_a_preset_is_offered_for_columns_written_otherwise(tmp_path: Path, form: str) -> None:
    """In other capitals or another order of words, each quantity with its column; a sign in a bit is Feetech's."""
    time, q, current = motion()
    names = [form.format(word, k) for word in ("Position", "Current") for k in (1, 2)]
    ticks = np.round(q * 4096 / 2 / np.pi).astype(int) + 2048
    for step, name in ((2.69, "dynamixel-x"), (6.5, "feetech-sts")):
        counts = np.round(1e3 * current / step).astype(int)
        counts = with_bit(counts, 15) if step == 6.5 else counts
        path = table(tmp_path / f"{name}.csv", ",".join(["timestamp", *names]), time, ticks, counts)
        error = refused(path, robot())
        assert f"preset: {name}" in error.mend
        log = read(path, pasted(error))
        assert np.abs(log.position - q).max() < 1e-3 and np.abs(log.current - current).max() < 0.004


def test_efforts_without_a_unit_are_told_as_what_they_are_taken(tmp_path: Path) -> None:
    """ROS says N m and many drivers write A; a word in the recipe ends the doubt."""
    time, q, current = motion()
    path = table(tmp_path / "log.csv", "t,q1,q2,effort_1,effort_2", time, q, current)
    block = "log: {current: 'effort_{joint}'"
    assert any("is read as A" in note.text for note in ingest([path], robot(f"{block}}}\n")).notes)
    for unit in ("effort: current", "units: {current: A}"):
        assert not ingest([path], robot(f"{block}, {unit}}}\n")).notes
    (note,) = ingest([path], robot(f"{block}, effort: torque}}\n")).notes
    assert "in N m" in note.text


def test_a_note_on_loads_shows_the_lines_that_state_them(tmp_path: Path) -> None:
    """A rod of 0.9 N m/A with three masses 0.14 m out, a file each: pasted with that length, K comes out."""
    one = "".join(line for line in JOINTS.splitlines(True) if "knee" not in line)
    (tmp_path / "recipe.yaml").write_text(one)
    rng = np.random.default_rng(11)
    for mass, name in ((0.0, "0g"), (0.1, "100g"), (0.2, "0.2kg")):
        time = np.arange(0.0, 60.0, 0.01)
        q, speed, pull = 1.5 * np.sin(0.7 * time), np.cos(0.7 * time), -1.5 * 0.49 * np.sin(0.7 * time)
        torque = (0.01 + 0.14 * mass) * 9.80665 * np.sin(q) + 0.14**2 * mass * pull + 0.03 * np.sign(speed)
        current = torque / 0.9 + rng.normal(scale=0.003, size=len(q))
        frame(tmp_path / f"rod_{name}.csv", {"t": time, "q1": q, "i1": current})
    (text,) = [note.text for note in pumaid.identify(tmp_path).notes if note.slug == "loads-differ"]
    block = text[text.index("\nfiles:") :].replace("[X, Y, Z]", "[0.14, 0, 0]")
    (tmp_path / "recipe.yaml").write_text(f"{one}{block}\n")
    constant = next(item for item in pumaid.identify(tmp_path).values if item.name == "torque_constant.j1")
    assert abs(constant.value - 0.9) < 4.0 * constant.std_error < 0.02


def test_an_arm_whose_joints_all_slide_is_read_by_names(tmp_path: Path) -> None:
    rails = [f"  - {{name: {name}, type: prismatic, theta: 0, alpha: 1.5, a: 0}}" for name in "xyz"]
    gantry = parsed_recipe("\n".join(["name: gantry", "gravity: [0, 0, -9.8]", "joints:", *rails]).encode(), "recipe")
    time, q, current = (np.arange(50) * 0.01, *np.random.default_rng(1).normal(0.0, 0.1, (2, 50, 3)))
    names = ",".join(["time", *(f"{what}_{name}" for what in ("pos", "current") for name in "xyz")])
    log = read(table(tmp_path / "log.csv", names, time, q, current), gantry)
    assert np.array_equal(log.position, q) and np.array_equal(log.current, current)


def test_a_line_of_units_as_kuka_writes_it(tmp_path: Path) -> None:
    """Speeds of motors, a hundred times those of joints, are no wrong clock."""
    time, q, current = motion()
    speed = np.gradient(q, time, axis=0) / (2.0 * np.pi) * 60.0
    names = ",".join(["ZEIT", *(f"{word}_A{k}" for word in ("Istposition", "Istdrehzahl", "Iststrom") for k in (1, 2))])
    path = table(tmp_path / "log.csv", names, time, np.degrees(q), speed, 100.0 * current)
    first, *rows = path.read_text().splitlines()
    path.write_text("\n".join([first, "s,°,°,U/min,U/min,%,%", *rows]) + "\n", encoding="utf-8")
    log = read(path, robot())
    assert log.velocity is not None
    for ours, wanted in ((log.position, q), (log.velocity, np.gradient(q, time, axis=0)), (log.current, current)):
        np.testing.assert_allclose(ours, wanted, atol=1e-9)
    assert any(note.text.startswith("currents are in rated torque") for note in ingest([path], robot()).notes)
    path = table(path, names, time, q, 100.0 * np.gradient(q, time, axis=0), current)
    notes = [note.text for note in ingest([path], robot()).notes if note.slug == "velocity-unrelated"]
    assert len(notes) == 2 and all("is it the motor's, before the gear?" in text for text in notes)


def test_counts_of_fine_encoders_are_refused_as_counts(tmp_path: Path) -> None:
    time, q, current = motion()
    path = table(tmp_path / "log.csv", "t,q1,q2,i1,i2", time, np.round(2e6 * q).astype(int), current)
    assert refused(path, robot()).mend.startswith("of counts of an encoder say what one is (position: {column:")


def test_columns_of_what_was_wanted_are_offered_as_that(tmp_path: Path) -> None:
    names = "timestamp,target_q_0,target_q_1,target_current_0,target_current_1"
    mend = refused(table(tmp_path / "log.csv", names, np.zeros((3, 5))), robot()).mend
    assert "the controller's, not the arm's" in mend and "target_q_{joint0}" in mend
