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

    Attributes
    ----------
    kinds
        ``"constant"``: only stretches at constant speed; ``"stroke"``: only movements from rest to rest;
        ``"both"``: strokes where the constant part of a movement is too small a share of it.
    min_duration
        Shortest stretch at constant speed (s); the noise of currents is correlated over tens of milliseconds.
    min_travel
        Shortest way of a run (rad or m); over less, gravity's sine and cosine cannot be told from a constant.
    min_samples
        Fewest samples of a run.
    speed_tolerance
        Largest departure of the smoothed speed from its level, as a share of the level; the top of a sinusoid within
        0.03 is a third of its way, below `plateau_share`, so a sinusoid is never taken for a constant speed.
    plateau_share
        Share of a movement's way below which its constant part does not represent it: it becomes a stroke.
    held_share
        Speed of a held joint, as a share of the moving joint's, up to which it counts as held.
    held_drift
        Largest way of a held joint during one run (rad or m); 0.02 rad change a gravity load by 2 % at most.
    rest_speed
        Speed below which a joint is at rest (rad/s or m/s).
    low_speed_share
        A stroke starts and ends where the speed passes this share of its peak: below, friction is not yet sliding.
    max_bins, reject_bins
        Most bins of a run (of more than two turns, half as many for each turn), and of a stretch that is left out.
    window
        Samples held in memory at a time; a longer movement is cut.
    """

    kinds: str = BOTH
    min_duration: float = 0.2
    min_travel: float = 0.02
    min_samples: int = 12
    speed_tolerance: float = 0.03
    plateau_share: float = 0.4
    held_share: float = 0.02
    held_drift: float = 0.02
    rest_speed: float = 0.003
    low_speed_share: float = 0.05
    max_bins: int = 512
    reject_bins: int = 64
    window: int = 131_072

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
