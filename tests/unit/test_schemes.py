"""The `log` block that is proposed for a foreign header."""

import pytest
from ruamel.yaml import YAML

from pumaid.io.columns import paste_block
from pumaid.robot import Joint, LogFormat, Robot


def arm(n_joints: int, names: tuple[str, ...] = ()) -> Robot:
    """Revolute joints, named or numbered."""
    return Robot("arm", tuple(Joint(k + 1, names[k] if names else f"j{k}", "revolute") for k in range(n_joints)))


def numbered(*templates: str, n_joints: int = 6, first: int = 0) -> list[str]:
    """Every template for every joint."""
    return [template.format(k + first) for template in templates for k in range(n_joints)]


#: Header, joints, expected block. UR's RTDE recorder, Kinova's, ROS topics flattened, LabVIEW-like, names of joints.
HEADERS = {
    "rtde": (
        [
            "timestamp",
            *numbered("target_q_{}", "actual_q_{}", "target_qd_{}", "actual_qd_{}", "target_current_{}"),
            *numbered("actual_current_{}", "joint_temperatures_{}"),
        ],
        {
            "time": "timestamp",
            "position": "actual_q_{joint0}",
            "velocity": "actual_qd_{joint0}",
            "current": "actual_current_{joint0}",
            "temperature": "joint_temperatures_{joint0}",
        },
    ),
    "kinova": (
        [
            "Time",
            *numbered("Position{}", "Velocity{}", "Torque{}", "TorqueCur{}", "Temp{}", "Cur{}", first=1),
            *numbered("PositionCmptd{}", "VelocityCmptd{}", first=1),
        ],
        {
            "time": "Time",
            "position": "Position{joint}",
            "velocity": "Velocity{joint}",
            "current": "Cur{joint}",
            "temperature": "Temp{joint}",
        },
    ),
    "ros": (
        ["time", *numbered("/joint_states/position[{}]", "/joint_states/velocity[{}]", "/motor/current[{}]")],
        {
            "time": "time",
            "position": "/joint_states/position[{joint0}]",
            "velocity": "/joint_states/velocity[{joint0}]",
            "current": "/motor/current[{joint0}]",
        },
    ),
    "units in names": (
        ["time_ms", *numbered("Axis {} angle (deg)", "Axis {} speed (deg/s)", "Axis {} current (mA)", first=1)],
        {
            "time": "time_ms",
            "position": "Axis {joint} angle (deg)",
            "velocity": "Axis {joint} speed (deg/s)",
            "current": "Axis {joint} current (mA)",
            "units": {"time": "ms", "position": "deg", "velocity": "deg/s", "current": "mA"},
        },
    ),
}


@pytest.mark.parametrize("kind", HEADERS)
def test_known_headers_are_recognised(kind: str) -> None:
    """Measured columns are chosen before wanted and computed ones, and the block is YAML."""
    header, expected = HEADERS[kind]
    block = paste_block(header, arm(6))
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
