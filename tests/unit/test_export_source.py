"""Exported source code draws what the model predicts: C by gcc, Python alone with numpy, MATLAB, JSON by hand."""

import ast
import ctypes
import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from pumaid.estimation.estimate import identify
from pumaid.exports import export
from pumaid.robot import Conversion, EffectChoice, LogFormat
from tests.exported import EXACT, NOT_WRITTEN, every_effect, fitted, motions, off, predicted, robot_called
from tests.json_model import current
from tests.matlab_lines import as_python
from tests.worlds import PENDULUM, dataset, drawn, experiment, only

GCC = shutil.which("gcc")
FLAGS = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror", "-O2")
needs_gcc = pytest.mark.skipif(GCC is None, reason="there is no gcc here")
CASES = [("puma560", False), ("one", False), *((name, True) for name in ("puma560", "ur5e", "crane", "twelve"))]


@cache
def case(name: str, rich: bool):
    """An arm, a model of it (with every effect of the catalogue where `rich`) and motions with their currents."""
    robot = robot_called(name)
    estimate = fitted(robot, effects=every_effect(robot) if rich else ())
    position, velocity = motions(robot)
    return robot, estimate, position, velocity, predicted(robot, estimate, position, velocity=velocity)


def compiled(folder: Path, robot, estimate, **options):
    """The C form as a function of its parts' name, postures, velocities and wanted directions (or None)."""
    for suffix, text in export(estimate, robot, form="c", name="arm", **options).files.items():
        (folder / f"arm{suffix}").write_text(text, encoding="utf-8")
    line = [GCC, *FLAGS, "-shared", "-fPIC", str(folder / "arm.c"), "-o", str(folder / "arm_c.so"), "-lm"]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    library = ctypes.CDLL(str(folder / "arm_c.so"))
    vector = ctypes.c_double * robot.n_joints

    def call(part, *given):
        out = vector()
        getattr(library, f"arm_{part}")(*(None if one is None else vector(*one) for one in given), out)
        return np.array(out)

    return call


@needs_gcc
@pytest.mark.parametrize(("name", "rich"), CASES)
def test_c_draws_what_the_model_predicts(name, rich, tmp_path):
    """Compiled without a warning, the C form equals Model.predict, and is the sum of its two parts."""
    robot, estimate, position, velocity, wanted = case(name, rich)
    call = compiled(tmp_path, robot, estimate)
    found = [call("current", q, qd, None) for q, qd in zip(position, velocity, strict=True)]
    parts = [call("gravity", q) + call("friction", q, qd, None) for q, qd in zip(position, velocity, strict=True)]
    assert off(np.array(found), wanted) < EXACT and off(np.array(parts), wanted) < EXACT


@needs_gcc
def test_c_needs_nothing_but_the_mathematical_functions(tmp_path):
    """No allocation, no data that changes: the object file asks for functions of math.h and has no writable symbol."""
    robot, estimate, *_ = case("stanford", True)
    compiled(tmp_path, robot, estimate)
    subprocess.run([GCC, *FLAGS, "-c", "arm.c"], cwd=tmp_path, check=True)
    lines = subprocess.run(["nm", "arm.o"], cwd=tmp_path, capture_output=True, text=True, check=True).stdout.split("\n")
    asked = {line.split()[-1] for line in lines if " U " in line}
    allowed = "sin cos sincos tanh exp pow sqrt fabs fmax _GLOBAL_OFFSET_TABLE_ __stack_chk_fail"
    assert asked <= set(allowed.split())
    assert [line for line in lines if line[17:18] in ("d", "D", "b", "B", "C")] == []


@needs_gcc
def test_c_at_rest_and_toward(tmp_path):
    """At rest: the middle of both directions; toward 1 or -1: friction of that direction at no speed; beyond: as 1."""
    robot, _, position, *_ = case("panda", True)
    # Friction that gears pass on waits until its own joint moves.
    own = tuple(choice for choice in every_effect(robot) if choice.effect != "coupling")
    estimate = fitted(robot, effects=own)
    call, q, n = compiled(tmp_path, robot, estimate), position[0], robot.n_joints
    slow = np.full(n, 1e-300)
    ahead, back = call("friction", q, slow, None), call("friction", q, -slow, None)
    still = np.zeros(n)
    assert np.allclose(call("friction", q, still, still + 7.0), ahead, rtol=1e-14)
    assert np.allclose(call("friction", q, still, still - 1.0), back, rtol=1e-14)
    assert np.allclose(call("friction", q, still, None), 0.5 * (ahead + back), rtol=1e-14, atol=1e-16)
    mixed = call("friction", q, slow, still + 0.5)
    lost = call("current", q, [np.nan, *slow[1:]], None)
    assert np.isnan(lost[0]) and np.isfinite(lost[1:]).all()  # not taken for rest
    assert np.allclose(mixed, 0.75 * ahead + 0.25 * call("friction", q, still, still - 1.0), rtol=1e-12)


@needs_gcc
def test_c_with_ratios_that_are_not_known(tmp_path):
    """Unknown ratios count as nothing, as in the model; effects of loads that are not known too."""
    robot, estimate, position, velocity, _ = case("ur5e", True)
    scales = estimate.scales.copy()
    scales[:4, 4:] = np.nan
    cut = replace(estimate, scales=scales)
    wanted = predicted(robot, cut, position, velocity=velocity)
    call = compiled(tmp_path, robot, cut)
    found = [call("current", q, qd, None) for q, qd in zip(position, velocity, strict=True)]
    assert off(np.array(found), wanted) < EXACT


ALONE = """
import json, sys
class Only:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] not in {*sys.stdlib_module_names, "numpy", "arm"}:
            raise ImportError(name)
sys.meta_path.insert(0, Only())
sys.path.insert(0, sys.argv[1])
import arm
q, qd = json.load(sys.stdin)
print(json.dumps([arm.current(q, qd).tolist(), (arm.gravity(q[0]) + arm.friction(q[0], qd[0])).tolist()]))
"""


@pytest.mark.parametrize(("name", "rich"), CASES)
def test_python_draws_what_the_model_predicts(name, rich, tmp_path):
    """In a process that can import numpy and nothing else, many postures at once or one."""
    robot, estimate, position, velocity, wanted = case(name, rich)
    (tmp_path / "arm.py").write_text(export(estimate, robot, form="python").files[".py"], encoding="utf-8")
    given = json.dumps([position.tolist(), velocity.tolist()])
    done = subprocess.run(
        [sys.executable, "-I", "-c", ALONE, str(tmp_path)], input=given, capture_output=True, text=True, check=False
    )
    assert done.stderr == ""
    many, one = json.loads(done.stdout)
    assert off(np.array(many), wanted) < EXACT and np.allclose(one, wanted[0], rtol=1e-10, atol=1e-13)


@pytest.mark.parametrize(("name", "rich"), CASES)
def test_json_says_enough_to_draw_it(name, rich):
    """A small evaluator that follows the document's own words finds the currents, and the reference is right."""
    robot, estimate, position, velocity, wanted = case(name, rich)
    document = json.loads(export(estimate, robot, form="json").files[".json"])
    found = current(document, position[0], velocity[0])
    # Slopes are taken by differences there: 1e-9 is what a central difference of step 1e-5 leaves.
    assert np.allclose(found, wanted[0], atol=(1e-9 if rich else EXACT) * np.abs(wanted).max())
    for row in document["reference"]:
        q, qd = np.array([row["q"]]), np.array([row["qd"]])
        assert np.allclose(row["current"], predicted(robot, estimate, q, velocity=qd)[0], rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize(("name", "rich"), CASES)
def test_matlab_draws_what_the_model_predicts(name, rich):
    """Translated line by line into Python (tests/matlab_lines.py), since no interpreter is at hand everywhere."""
    robot, estimate, position, velocity, wanted = case(name, rich)
    run = as_python(export(estimate, robot, form="matlab", name="arm").files[".m"], "arm")
    found = np.array([run(q, qd)[0] for q, qd in zip(position[:4], velocity[:4], strict=True)])
    assert off(found, wanted[:4]) < 1e2 * EXACT  # relative to four postures' largest, not to forty's


@needs_gcc
def test_learned_curves_are_looked_up_in_a_table(tmp_path):
    """Each form of what a posture and velocities determine, beyond its range too; a curve of time is left out."""
    forms = [(0, 0, 0), (0, 1, 0), (0, 1, 1), (1, 1, 0), (1, 0, 0), (2, 1, 0)]
    ranges = {"low": -0.7, "high": 0.9, "spread": 0.1}
    shapes = [dict(zip(("of", "odd", "times"), map(float, form), strict=True)) | ranges for form in forms]
    estimate = fitted(PENDULUM, effects=tuple(EffectChoice("curve", 2, shape) for shape in shapes))
    position, velocity = motions(PENDULUM)
    wanted = predicted(PENDULUM, estimate, position, velocity=velocity)
    call, document = compiled(tmp_path, PENDULUM, estimate), export(estimate, PENDULUM, form="json").files[".json"]
    pairs = list(zip(position, velocity, strict=True))
    assert off(np.array([call("current", q, qd, None) for q, qd in pairs]), wanted) < EXACT
    assert off(np.array([current(json.loads(document), q, qd) for q, qd in pairs]), wanted) < EXACT
    aged = fitted(PENDULUM, effects=(EffectChoice("curve", 2, {"of": 4.0, "odd": 1.0, "times": 0.0} | ranges),))
    (lack,) = export(aged, PENDULUM, form="c").left_out
    assert lack.name == "curve@2" and "posture and velocities: t" in lack.reason


def test_what_is_not_written_is_said():
    """Every effect of the catalogue is in a file or told as left out; the file's head tells it too."""
    robot, estimate, *_ = case("stanford", True)
    found = export(estimate, robot, form="c")
    told = {lack.name.split("@")[0].split("_2")[0] for lack in found.left_out}
    written = {one.effect for one in estimate.effects} - told
    assert told == set(NOT_WRITTEN)
    assert all(f"/* {name}" in found.files[".c"] for name in written)
    assert all(f"{lack.name}:" in found.files[".h"] for lack in found.left_out)


def test_a_model_of_partial_logs_is_written_and_its_gaps_are_told():
    """Joint 2 of a pendulum alone was logged: joint 1 draws what the model says of it, and is told as unknown."""
    truth = drawn(PENDULUM)
    estimate = identify(dataset(truth, only(experiment(PENDULUM), lambda motion: motion.joint == 2)), PENDULUM)
    found = export(estimate, PENDULUM, form="json")
    q, qd = motions(PENDULUM, count=4)
    wanted = predicted(PENDULUM, estimate, q, velocity=qd)
    document = json.loads(found.files[".json"])
    assert np.allclose([current(document, *one) for one in zip(q, qd, strict=True)], wanted, atol=1e-12)
    told = {lack.name for lack in found.undetermined}
    assert {"coulomb.j1.plus", "viscous.j1.minus", "gravity.l1.x"} <= told
    assert not {"coulomb.j2.plus", "gravity.l2.x"} & told


def test_gears_that_couple_joints_drive_friction():
    """With `coupling` in the recipe friction follows the motor shafts' speeds, in the files as in the model."""
    robot = robot_called("puma560")
    geared = tuple(replace(joint, gear_ratio=50.0 + joint.number) for joint in robot.joints)
    robot = replace(robot, joints=geared, coupling={(5, 4): -0.2, (6, 4): 0.3, (6, 5): -0.4}, digest="")
    estimate, (q, qd) = fitted(robot, effects=every_effect(robot)), motions(robot)
    space: dict = {}
    exec(export(estimate, robot, form="python").files[".py"], space)
    wanted = predicted(robot, estimate, q, velocity=qd)
    assert off(space["current"](q, qd), wanted) < EXACT
    assert off(space["current"](q, qd), predicted(replace(robot, coupling={}), estimate, q, velocity=qd)) > 0.01


@needs_gcc
def test_any_names_are_written(tmp_path):
    """Names that end comments or strings, comments in comments, trigraphs, or that are no identifiers, do no harm."""
    robot = robot_called("crane")
    joints = tuple(replace(joint, name=f'*/ /* """ -- \\ {joint.number} ??/ é\n"') for joint in robot.joints)
    robot = replace(robot, name='3 */ int main(void){} /* """ \'quo\nte\' \\', joints=joints)
    python = export(fitted(robot), robot, form="python")
    assert python.name == "arm_3_int_main_void_quo_te"
    ast.parse(python.files[".py"])
    posture = np.linspace(0.3, -0.7, robot.n_joints)
    drawn = compiled(tmp_path, robot, fitted(robot))("gravity", posture)
    assert np.all(np.isfinite(drawn))
    (tmp_path / "plain").mkdir()
    plain = compiled(tmp_path / "plain", robot_called("crane"), fitted(robot_called("crane")))
    np.testing.assert_array_equal(drawn, plain("gravity", posture))


@needs_gcc
def test_the_example_of_a_loop_ends_at_the_models_current_by_limited_steps(tmp_path):
    """It compiles as strictly; where a reading is lost, currents stay."""
    robot, estimate, position, *_ = case("panda", True)
    for suffix, text in export(estimate, robot, form="c", name="arm").files.items():
        (tmp_path / f"arm{suffix}").write_text(text, encoding="utf-8")
    most = np.array(re.search(r"LIMIT\[N\] = {(.*)}", text)[1].split(", "), dtype=float)
    strict = [GCC, "-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror", "arm_example.c", "arm.c"]
    for more in (["-o", "arm"], ["-shared", "-fPIC", "-o", "loop.so"]):
        subprocess.run([*strict, *more, "-lm"], cwd=tmp_path, check=True)
    library, vector = ctypes.CDLL(str(tmp_path / "loop.so")), ctypes.c_double * robot.n_joints
    held, loop, still = vector(), vector(), vector()
    for q in position[:5]:
        ticks = [np.array(loop)]
        for _ in range(1000):
            assert library.arm_step(loop, vector(*q), still) == 1
            ticks.append(np.array(loop))
        library.arm_gravity(vector(*q), held)
        assert np.array_equal(ticks[-1], np.clip(held, -most, most))
        assert (np.abs(np.diff(ticks, axis=0)) <= most * 0.00501).all()
        assert library.arm_step(loop, vector(*q[:-1], np.nan), still) == 0 and np.array_equal(loop, ticks[-1])
    printed = subprocess.run([str(tmp_path / "arm")], capture_output=True, text=True, check=True).stdout
    assert len(printed.splitlines()) == robot.n_joints


def test_currents_by_name_are_in_the_numbers_of_the_logs():
    """Ticks in, raw currents out, in any order, as a servo bus has them; the same currents as by radians and ampere."""
    robot = robot_called("ur5e")
    ticks = (Conversion(1.0, 2048.0),) * 6
    log = LogFormat(
        position="{name}.pos",
        units={"position": "tick", "current": "mA"},
        signs={"position": (1, -1, 1, 1, 1, 1), "current": (1, 1, -1, 1, 1, 1)},
        names=tuple("abcdef"),
        conversions={"position": ticks, "current": (Conversion(2.69),) * 6},
    )
    scope: dict = {}
    exec(export(fitted(robot), replace(robot, log=log), form="python").files[".py"], scope)
    raw = dict(zip("fedcba", (2048, 1024, 3000, 2100, 1800, 2500), strict=True))
    angles = (np.array([raw[name] for name in "abcdef"]) - 2048) * 2.0 * np.pi / 4096 * [1, -1, 1, 1, 1, 1]
    wanted = scope["gravity"](angles) * [1, 1, -1, 1, 1, 1] / 0.00269
    found = scope["hold"](raw | {"gripper": 1.0})
    assert list(found) == list("abcdef") and np.allclose(list(found.values()), wanted)
    assert scope["hold"]({f"{name}.pos": value for name, value in raw.items()}) == found
    with pytest.raises(ValueError, match="not a number"):
        scope["hold"](raw | {"a": float("nan")})
    with pytest.raises(KeyError):
        scope["hold"]({"a": 1.0})
