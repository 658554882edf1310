"""Why a stretch is no run, in a sentence with its figures."""

from __future__ import annotations

from dataclasses import dataclass, replace

from pumaid.dataset import Means, Reject
from pumaid.preprocessing.options import SegmentOptions
from pumaid.preprocessing.reduce import coarser
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
    "gap": ("between gaps", "{samples} samples stand between gaps in time, too few in a row to tell a speed"),
}  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class Leftover:
    """A stretch that is no run, in figures: as `Reject`, with what its sentence needs, and the clock it is on."""

    origin: str
    last_origin: str
    first_row: int
    last_row: int
    start: float
    end: float
    samples: int
    joints: tuple[int, ...]
    reason: str
    figure: float
    clock: int
    bins: tuple[Means, ...] = ()

    def joined(self, other: Leftover, options: SegmentOptions) -> Leftover:
        """This stretch and the one right after it, of the same reason, as one."""
        parts = [*self.bins, *other.bins]
        joints = tuple(dict.fromkeys((*self.joints, *other.joints)))
        if sum(len(part) for part in parts) > 2 * options.reject_bins:
            parts = [coarser(parts, options.reject_bins)]
        return replace(
            self,
            last_origin=other.last_origin,
            last_row=other.last_row,
            end=other.end,
            samples=self.samples + other.samples,
            joints=joints,
            figure=max(self.figure, other.figure),
            bins=tuple(parts),
        )

    def reject(self, robot: Robot, options: SegmentOptions) -> Reject:
        """As the record that leaves the segmentation."""
        bins = coarser(list(self.bins), options.reject_bins) if self.bins else None
        return Reject(
            origin=self.origin,
            first_row=self.first_row,
            last_row=self.last_row,
            start=self.start,
            duration=self.end - self.start,
            joints=self.joints,
            reason=self.reason,
            text=self._sentence(robot, options),
            samples=self.samples,
            bins=bins,
            last_origin=self.last_origin if self.last_origin != self.origin else "",
            clock=self.clock,
        )

    def _sentence(self, robot: Robot, options: SegmentOptions) -> str:
        units = [robot.joint(joint).position_unit for joint in self.joints] or ["rad"]
        return REASONS[self.reason][1].format(
            joints=", ".join(str(joint) for joint in self.joints),
            first=self.joints[0] if self.joints else "",
            last=self.joints[-1] if self.joints else "",
            unit=units[0],
            last_unit=units[-1],
            figure=number(self.figure, 3),
            duration=number(self.end - self.start, 3),
            samples=self.samples,
            rest_speed=f"{options.rest_speed:g} rad/s or m/s",
            min_duration=f"{options.min_duration:g}",
            min_travel=f"{options.min_travel:g}",
            min_samples=options.min_samples,
            speed_tolerance=f"{100 * options.speed_tolerance:g} %",
            low_speed_share=f"{100 * options.low_speed_share:g} %",
            held_drift=f"{options.held_drift:g}",
        )
