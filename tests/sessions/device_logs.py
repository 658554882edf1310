"""Recordings as three devices' own programs write them."""

from pathlib import Path

import numpy as np
from arms_at_work import Recording
from rosbags import rosbag2, typesys


def rtde(path: Path, told: Recording, current: np.ndarray, every: int = 4) -> None:
    """What record.py of Universal Robots' RTDE client writes: blanks between columns, every `every`-th sample."""
    columns = {
        "target_q": told.position,
        "target_qd": told.velocity,
        "actual_q": told.position,
        "actual_qd": told.velocity,
        "actual_current": current,
        "joint_temperatures": np.full_like(current, 31.5),
        "actual_TCP_pose": np.zeros((len(current), 6)),
    }
    names = ["timestamp", *(f"{name}_{k}" for name in columns for k in range(6)), "robot_mode", "safety_mode"]
    modes = np.tile([7.0, 1.0], (len(current), 1))
    table = np.column_stack([4321.5 + told.time, *columns.values(), modes])[::every]
    np.savetxt(path, table, fmt="%.9g", header=" ".join(names), comments="")


def joint_states(folder: Path, told: Recording, effort: np.ndarray, names: list[str], every: int = 5) -> None:
    """What `ros2 bag record -a` keeps: joints by the alphabet with a gripper among them, beside another topic."""
    types = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    time, header, state, text = (
        types.types[name]
        for name in (
            "builtin_interfaces/msg/Time",
            "std_msgs/msg/Header",
            "sensor_msgs/msg/JointState",
            "std_msgs/msg/String",
        )
    )
    jaw = np.zeros((len(effort), 1))
    order = np.argsort([*names, "drive_joint"])
    arrays = [np.ascontiguousarray(np.hstack([part, jaw])[:, order]) for part in (told.position, told.velocity, effort)]
    shown = [[*names, "drive_joint"][k] for k in order]
    with rosbag2.Writer(folder, version=9, storage_plugin=rosbag2.StoragePlugin.MCAP) as writer:
        joints = writer.add_connection("/joint_states", state.__msgtype__, typestore=types)
        log = writer.add_connection("/robot_description", text.__msgtype__, typestore=types)
        writer.write(log, 1_700_000_000 * 10**9, types.serialize_cdr(text(data="<robot/>"), text.__msgtype__))
        for k in range(0, len(effort), every):
            ns = 1_700_000_000 * 10**9 + round(told.time[k] * 1e9)
            stamp = time(ns // 10**9, ns % 10**9)
            message = state(header(stamp, ""), shown, *(array[k] for array in arrays))
            writer.write(joints, ns + 200_000, types.serialize_cdr(message, state.__msgtype__))


def feetech(path: Path, told: Recording, current: np.ndarray, every: int = 10) -> None:
    """A loop over Feetech STS3215 servos: ticks of 4096 a turn, currents of 6.5 mA with their sign in bit 15."""
    ticks = 2048 + np.round(told.position * 4096 / (2 * np.pi)).astype(int)
    counts = np.round(current / 0.0065).astype(int)
    raw = np.abs(counts) + np.where(counts < 0, 32768, 0)
    joints = range(1, current.shape[1] + 1)
    names = ["time", *(f"present_position_{k}" for k in joints), *(f"present_current_{k}" for k in joints)]
    lines = [
        ",".join([f"{t:.3f}", *map(str, q), *map(str, i)])
        for t, q, i in zip(1_764_000_000.0 + told.time[::every], ticks[::every], raw[::every], strict=True)
    ]
    path.write_text("\n".join([",".join(names), *lines]) + "\n", encoding="utf-8")
