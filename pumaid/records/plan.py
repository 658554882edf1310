"""An experiment: which joint moves, from where to where, how fast, with the others held where."""

from __future__ import annotations

from dataclasses import dataclass, field

from pumaid.errors import Note


@dataclass(frozen=True, slots=True)
class Motion:
    """One planned run.

    Attributes
    ----------
    joint
        Moving joint, from 1.
    hold
        (J,) positions of all joints, rad or m; the moving joint's own entry is ignored.
    start, end
        rad or m.
    velocity
        Speed, positive, rad/s or m/s; the direction follows from `start` and `end`.
    purpose
        ``"fit"`` or ``"heldout"``.
    """

    joint: int
    hold: tuple[float, ...]
    start: float
    end: float
    velocity: float
    purpose: str = "fit"


@dataclass(frozen=True, slots=True)
class Posture:
    """A set of held positions and why the plan wants it: `serves` names the parameters that it makes visible."""

    joint: int
    hold: tuple[float, ...]
    serves: tuple[str, ...]
    why: str


@dataclass(frozen=True, slots=True)
class Plan:
    """Motions in the order in which they are executed, with the reasons and the forecast.

    `expected` maps a parameter's name to its predicted standard error (SI), absent where the plan cannot show it;
    `unseen` maps a parameter's name to why no run of this plan shows it; `duration` is in s, moves between included.
    `efficiency` is the predicted error of the best conceivable experiment of as much time as a share of this plan's
    (0..1), none where nobody looked. `assumptions` are the sentences on which the forecast rests, `notes` what the user
    should know before running it.
    """

    robot: str
    motions: tuple[Motion, ...]
    postures: tuple[Posture, ...] = ()
    expected: dict[str, float] = field(default_factory=dict)
    unseen: dict[str, str] = field(default_factory=dict)
    duration: float = 0.0
    seed: int = 0
    efficiency: float | None = None
    assumptions: tuple[str, ...] = ()
    notes: tuple[Note, ...] = ()
