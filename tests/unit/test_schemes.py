"""The `log` block that is proposed for a foreign header."""

import pytest
from ruamel.yaml import YAML

from pumaid.io.log_reader import paste_block
from pumaid.robot import Joint, LogFormat, Robot


def arm(n_joints: int, names: tuple[str, ...] = ()) -> Robot:
    """Revolute joints, named or numbered."""
    return Robot("arm", tuple(Joint(k + 1, names[k] if names else f"j{k}", "revolute") for k in range(n_joints)))


def numbered(*templates: str, n_joints: int = 6, first: int = 0) -> list[str]:
    """Every template for every joint."""
    return [template.format(k + first) for template in templates for k in range(n_joints)]


#: Header, and of the expected block time, position, velocity, current and temperature: UR's RTDE recorder, Kinova's,
#: ROS topics flattened, LabVIEW-like.
HEADERS = {
    "rtde": (
        numbered("target_q_{}", "actual_q_{}", "target_qd_{}", "actual_qd_{}", "target_current_{}")
        + numbered("actual_current_{}", "joint_temperatures_{}"),
        [
            "timestamp",
            "actual_q_{joint0}",
            "actual_qd_{joint0}",
            "actual_current_{joint0}",
            "joint_temperatures_{joint0}",
        ],
    ),
    "kinova": (
        numbered("Position{}", "Velocity{}", "Torque{}", "TorqueCur{}", "Temp{}", "Cur{}", first=1)
        + numbered("PositionCmptd{}", "VelocityCmptd{}", first=1),
        ["Time", "Position{joint}", "Velocity{joint}", "Cur{joint}", "Temp{joint}"],
    ),
    "ros": (
        numbered("/joint_states/position[{}]", "/joint_states/velocity[{}]", "/motor/current[{}]"),
        ["time", "/joint_states/position[{joint0}]", "/joint_states/velocity[{joint0}]", "/motor/current[{joint0}]"],
    ),
    "units in names": (
        numbered("Axis {} angle (deg)", "Axis {} speed (deg/s)", "Axis {} current (mA)", first=1),
        ["time_ms", "Axis {joint} angle (deg)", "Axis {joint} speed (deg/s)", "Axis {joint} current (mA)"],
    ),
}
UNITS = {"time": "ms", "position": "deg", "velocity": "deg/s", "current": "mA"}


@pytest.mark.parametrize("kind", HEADERS)
def test_known_headers_are_recognised(kind: str) -> None:
    """Measured columns are chosen before wanted and computed ones, and the block is YAML."""
    header, names = HEADERS[kind]
    expected = dict(zip(("time", "position", "velocity", "current", "temperature"), names, strict=False))
    expected |= {"units": UNITS} if kind == "units in names" else {}
    block = paste_block([names[0], *header], arm(6))
    assert block is not None and YAML(typ="safe").load(block) == {"log": expected}


def test_columns_by_joint_names() -> None:
    """Where columns carry the joints' names the block does too."""
    names = ("waist", "shoulder")
    header = ["t", *(f"{name}_{quantity}" for quantity in ("pos", "vel", "cur") for name in names)]
    block = paste_block(header, arm(2, names))
    assert block is not None
    form = LogFormat(**YAML(typ="safe").load(block)["log"], names=names)
    assert [form.column("position", k) for k in (1, 2)] == ["waist_pos", "shoulder_pos"]


@pytest.mark.parametrize("header", [["a", "b"], ["t", "q1", "q2", "x"], ["q1", "q2", "i1", "i2"]])
def test_what_is_not_recognised_is_not_guessed(header: list[str]) -> None:
    """Without time, positions and currents of all joints there is no block."""
    assert paste_block(header, arm(2)) is None
