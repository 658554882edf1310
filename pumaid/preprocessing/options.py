"""What counts as a run: every threshold of the segmentation, with its unit and its reason."""

from __future__ import annotations

from dataclasses import dataclass, fields

from pumaid.errors import PumaidError, Where

#: Numbers beyond it (rad, m, A) are garbage of a logger, no measurements.
LARGEST = 1e6
#: Words for `SegmentOptions.kinds`.
CONSTANT, STROKE, BOTH = "constant", "stroke", "both"


@dataclass(frozen=True, slots=True)
class SegmentOptions:
    """Thresholds of the segmentation.

    Speeds and lengths are in the joint's own unit: rad for a revolute joint, m for a prismatic one.
    """

    kinds: str = BOTH  # ``"both"``: strokes where the constant part of a movement is too small a share of it
    min_duration: float = 0.2  # s at constant speed; noise of currents is correlated over tens of milliseconds
    min_travel: float = 0.02  # rad or m; over less, gravity's sine and cosine cannot be told from a constant
    min_samples: int = 12  # of a run
    # Largest departure of the smoothed speed from its level, as a share; a sinusoid's top within 0.03 is a third of its
    # way, below `plateau_share`, so a sinusoid is never taken for a constant speed.
    speed_tolerance: float = 0.03
    plateau_share: float = 0.4  # of a movement's way, below which its constant part does not represent it: a stroke
    held_share: float = 0.02  # speed of a held joint, as a share of the moving joint's, up to which it counts as held
    held_drift: float = 0.02  # rad or m of a held joint during a run; 0.02 rad change a gravity load by 2 % at most
    rest_speed: float = 0.003  # rad/s or m/s, below which a joint is at rest
    low_speed_share: float = 0.05  # of its peak speed, below which a stroke's friction is not yet sliding
    max_bins: int = 512  # of a run; of more than two turns, half as many for each turn
    reject_bins: int = 64  # of a stretch that is left out
    window: int = 131_072  # samples held in memory at a time; a longer movement is cut

    def __post_init__(self) -> None:
        if self.kinds not in (CONSTANT, STROKE, BOTH):
            self._refuse("kinds", f"one of {CONSTANT}, {STROKE}, {BOTH}")
        for name in (item.name for item in fields(self) if item.name != "kinds"):
            if not getattr(self, name) > 0:
                self._refuse(name, "above 0")
        for name in ("speed_tolerance", "plateau_share", "held_share", "low_speed_share"):
            if getattr(self, name) >= 1:
                self._refuse(name, "a share, below 1")
        if self.window < MIN_WINDOW:
            self._refuse("window", f"at least {MIN_WINDOW} samples")

    def _refuse(self, name: str, wanted: str) -> None:
        what = f"{name} is {getattr(self, name)!r}"
        raise PumaidError("bad-option", what, Where(field=name), f"give {wanted}")


#: Samples; below it the overlap of two windows would be most of a window.
MIN_WINDOW = 2048

#: All defaults.
DEFAULTS = SegmentOptions()
