"""Why a stretch is no run, in a sentence with its figures."""

from __future__ import annotations

from pumaid.dataset import Log
from pumaid.preprocessing.options import SegmentOptions
from pumaid.preprocessing.stretches import Piece
from pumaid.robot import Robot
from pumaid.units import number

#: Reason -> (what a legend says, the sentence); the figures in braces are filled in from the stretch.
REASONS: dict[str, tuple[str, str]] = {
    "rest": ("at rest", "no joint is faster than {rest_speed} for {duration} s"),
    "ramp": ("speeding up or slowing down", "joint {joints} changes its speed for {duration} s around its runs"),
    "several-joints": ("several joints move", "joints {joints} move at the same time for {duration} s"),
    "between-several": ("alone by chance", "joint {joints} moves alone for only {duration} s between motions of "
                        "several joints"),
    "too-short": ("too short", "joint {joints} moves {figure} {unit} in {duration} s, too little of it at one speed; a "
                  "run needs {min_duration} s, {min_travel} {unit} and {min_samples} samples"),
    "speed-not-constant": ("speed not constant", "joint {joints} moves {figure} {unit} in {duration} s, never within "
                           "{speed_tolerance} of one speed for {min_duration} s"),
    "low-speed": ("too slow for sliding friction", "joint {joints} is below {low_speed_share} of its peak speed "
                  "{figure} {unit}/s where its stroke begins or ends, for {duration} s"),
    "drift-of-held-joint": ("a held joint drifts", "while joint {first} moves, joint {last} drifts {figure} "
                            "{last_unit}; {held_drift} are allowed"),
    "no-current": ("no current measured", "the current of joint {joints} is missing, or 0 throughout (motor off), in "
                   "{samples} samples"),
    "not-a-number": ("garbage", "a position or the time is no number, or beyond 1e6, in {samples} samples"),
    "gap": ("between gaps", "{samples} samples stand between gaps in time, too few in a row for a speed"),
}  # fmt: skip


def reason_text(piece: Piece, log: Log, robot: Robot, *, options: SegmentOptions) -> str:
    """Why a piece is no run, in a sentence with its figures; `log` holds its samples."""
    units = [robot.joint(joint).position_unit for joint in piece.joints] or ["rad"]
    return REASONS[piece.reason][1].format(
        joints=", ".join(str(joint) for joint in piece.joints),
        first=piece.joints[0] if piece.joints else "",
        last=piece.joints[-1] if piece.joints else "",
        unit=units[0],
        last_unit=units[-1],
        figure=number(piece.figure, 3),
        duration=number(float(log.time[-1] - log.time[0]), 3),
        samples=len(log),
        rest_speed=f"{options.rest_speed:g} rad/s or m/s",
        min_duration=f"{options.min_duration:g}",
        min_travel=f"{options.min_travel:g}",
        min_samples=options.min_samples,
        speed_tolerance=f"{100 * options.speed_tolerance:g} %",
        low_speed_share=f"{100 * options.low_speed_share:g} %",
        held_drift=f"{options.held_drift:g}",
    )
