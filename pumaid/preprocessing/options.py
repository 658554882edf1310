"""What counts as a run: every threshold of the segmentation, with its unit and its reason."""

from dataclasses import asdict, dataclass

from pumaid.dataset import BLOCK, CONSTANT, STROKE
from pumaid.errors import PumaidError, Where

#: Numbers beyond it (rad, m, A) are garbage of a logger, no measurements.
LARGEST = 1e6
#: Kinds of runs: at constant speed, from rest to rest, any motion; and the word of `SegmentOptions.kinds` for all.
BOTH = "both"


@dataclass(frozen=True, slots=True)
class SegmentOptions:
    """Thresholds of the segmentation.

    Speeds and lengths are in the joint's own unit: rad for a revolute joint, m for a prismatic one.
    """

    # ``"both"``: strokes where the constant part of a movement is too small a share of it, and blocks of other motion
    kinds: str = BOTH
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
    cell: float | None = None  # s that a cell of a block lasts; None: as the encoder needs
    max_bins: int = 512  # of a run; of more than two turns, half as many for each turn
    window: int = 131_072  # samples held in memory at a time; a longer movement is cut

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            is_share, wanted = name in ("speed_tolerance", "plateau_share", "held_share", "low_speed_share"), ""
            if name == "kinds":
                kinds = (CONSTANT, STROKE, BLOCK, BOTH)
                wanted = "" if value in kinds else f"one of {', '.join(kinds)}"
            elif value is not None and (not value > 0 or (is_share and value >= 1)):
                wanted = "a share, above 0 and below 1" if is_share else "above 0"
            elif name == "window" and value < MIN_WINDOW:
                wanted = f"at least {MIN_WINDOW} samples"
            if wanted:
                raise PumaidError("bad-option", f"{name} is {value!r}", Where(field=name), f"give {wanted}")


#: Samples; below it the overlap of two windows would be most of a window.
MIN_WINDOW = 2048

#: All defaults.
DEFAULTS = SegmentOptions()
