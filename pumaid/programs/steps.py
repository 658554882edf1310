"""Runs in words, for the remarks of programs."""

from __future__ import annotations

from pumaid.records import Motion
from pumaid.robot import Robot
from pumaid.units import factor


def told(motion: Motion, robot: Robot) -> str:
    """A run in a remark: ``joint 3 (elbow) from -125 to 125 deg at 30 deg/s, fit``."""
    joint = robot.joint(motion.joint)
    scale, unit = (factor("deg"), "deg") if joint.is_revolute else (1.0, "m")
    start, end, speed = (value / scale + 0.0 for value in (motion.start, motion.end, motion.velocity))
    way = f"from {start:.6g} to {end:.6g} {unit} at {speed:.6g} {unit}/s"
    return f"joint {joint.number} ({joint.name}) {way}, {motion.purpose}"
