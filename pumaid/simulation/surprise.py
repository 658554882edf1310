"""One hidden effect by chance, of a size that a plan's runs can show: for those who want to find out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import ModelError, Where
from pumaid.simulation.forecast import jacobian
from pumaid.simulation.heat import curve
from pumaid.simulation.hidden import LAWS, Hidden, Instants, delays, sized
from pumaid.simulation.hidden.law import Reach
from pumaid.simulation.timing import first_starts, stretches
from pumaid.simulation.truth import Truth
from pumaid.trajectory import Motion, Plan, cruise, duration

Floats = NDArray[np.float64]

#: What the paper's model leaves of an effect, as multiples of the joint's noise.
_SIZES = (1.0, 2.0)
#: What is left at least, whatever was tried, and how much larger than usual an effect may be made for it.
_LEAST, _LARGEST = 0.5, 2.0
#: Keys that are the size of an effect, not its form.
_AMPLITUDES = ("a", "b", "cos", "sin", "drive", "back", "mu", "x", "y", "delta", "mass", "c", "dt")
#: Points at which a run is looked at.
_POINTS = 24
#: A: noise that is taken of a robot that has none.
_LEAST_NOISE = 1e-3
#: Samples a second by which a session's clock is told.
_RATE = 100.0


def surprise(truth: Truth, plan: Plan, seed: int, *, effect: str | None = None) -> Hidden:
    """One hidden effect whose kind, joint and size follow from the seed; it shows, and does not rule the arm.

    Kinds and joints are tried in random order until one leaves something that the paper's model cannot take up: of an
    effect that passes for weight or friction there would be nothing to find.

    Parameters
    ----------
    truth
        The virtual robot, nothing hidden yet.
    plan
        What it will execute.
    seed
        Same seed, same effect.
    effect
        The kind, where it is not left to chance.

    Returns
    -------
    hidden
        With all its values.

    Raises
    ------
    ModelError [hide-wrong]
        There is no such effect, or at no joint would it show.
    """
    rng = np.random.default_rng([seed, 5])
    if effect is not None and effect not in LAWS:
        raise ModelError("hide-wrong", f"{effect!r} is no effect", Where(field=effect), f"known: {', '.join(LAWS)}")
    runs, lasting = _Runs(truth, plan), duration(truth.robot, plan)
    names = [str(name) for name in rng.permutation(list(LAWS))] if effect is None else [effect]
    for name in names:
        joints: list[int | None] = [None]
        if LAWS[name].reach is not Reach.ARM:
            joints = [int(number) for number in rng.permutation(np.arange(1, truth.robot.n_joints + 1))]
        size, share = float(rng.uniform(*_SIZES)), float(rng.uniform(0.3, 0.6))
        for joint in joints:
            found = _fitted(runs, Hidden(name, joint), size=size, instant=float(round(share * lasting)))
            if found is not None:
                return found
    what = f"{effect or 'no effect'} would show at {'no' if effect else 'any'} joint of {truth.robot.name}"
    raise ModelError("hide-wrong", what, Where(field=effect or ""), "take a longer plan, or another effect")


def _fitted(runs: _Runs, wanted: Hidden, *, size: float, instant: float) -> Hidden | None:
    """The effect so large that `size` x noise is left of it; None where that would be absurd."""
    try:
        (plain,) = sized([wanted], runs.truth)
    except ModelError:
        return None
    timed = {key: instant for key in ("time", "time_constant") if key in plain.values}
    plain = replace(plain, values={**plain.values, **timed})
    left = runs.left(plain)
    if not left > 0:
        return None
    amplitudes = [key for key in plain.values if key in _AMPLITUDES]
    grow = min(size / left, _LARGEST)
    larger = {key: float(f"{value * (grow if key in amplitudes else 1.0):.3g}") for key, value in plain.values.items()}
    found = replace(plain, values=larger)
    return found if runs.left(found) >= _LEAST else None


class _Runs:
    """The runs that a plan fits, at a few points each, and what the paper's model cannot take up of a current."""

    def __init__(self, truth: Truth, plan: Plan) -> None:
        self.truth = truth
        self._first = first_starts(truth.robot, plan, rate=_RATE)
        clock, parts = 0.0, [list[Instants]() for _ in truth.robot.joints]
        for stretch in stretches(truth.robot, plan):
            motion = stretch.motion
            if motion is not None and motion.purpose == "fit":
                parts[motion.joint - 1].append(self._points(motion, clock + stretch.lead))
            clock += stretch.duration
        self._own = [_joined(own) if own else None for own in parts]
        self._basis = [None if at is None else self._base(at, j) for j, at in enumerate(self._own)]
        self._plain = [None if at is None else truth.current(j + 1, at) for j, at in enumerate(self._own)]

    def left(self, hidden: Hidden) -> float:
        """RMS of what is left of the effect in the joint that shows it most, as a multiple of the joint's noise."""
        with_it = replace(self.truth, hidden=(hidden,))
        late = delays(with_it.hidden, self.truth.robot.n_joints)
        sizes = [0.0]
        for j, (at, basis, plain) in enumerate(zip(self._own, self._basis, self._plain, strict=True)):
            if at is None or basis is None or plain is None:
                continue
            change = with_it.current(j + 1, replace(at, position=at.position - late[j] * at.velocity)) - plain
            rest = change - basis @ (basis.T @ change)
            sizes.append(float(np.sqrt(np.mean(rest**2)) / max(self.truth.noise.std[j], _LEAST_NOISE)))
        return max(sizes)

    def _points(self, motion: Motion, start: float) -> Instants:
        robot, j = self.truth.robot, motion.joint - 1
        span, seconds = cruise(robot, motion)
        time = start + np.linspace(0.0, seconds, _POINTS)
        position = np.tile(np.array(motion.hold, dtype=float), (_POINTS, 1))
        velocity, travel = np.zeros_like(position), np.zeros_like(position)
        position[:, j] = np.linspace(*span, _POINTS)
        velocity[:, j], travel[:, j] = (
            np.sign(span[1] - span[0]) * motion.velocity,
            np.abs(position[:, j] - motion.start),
        )
        warm = np.tile(curve(time)[:, None], robot.n_joints)
        return Instants(time, self._first, position, velocity, np.zeros_like(position), travel, warm)

    def _base(self, at: Instants, j: int) -> Floats:
        """(N, k) orthonormal: what gravity, ratios and friction of the paper's model can make of joint j's runs."""
        slopes, v = jacobian(self.truth.robot, self.truth.constants, at.position)[:, j], at.velocity[:, j]
        friction = np.column_stack([v > 0, v < 0, np.where(v > 0, v, 0.0), np.where(v < 0, v, 0.0)]).astype(float)
        columns = np.hstack([slopes, friction])
        u, sizes, _ = np.linalg.svd(columns / (np.linalg.norm(columns, axis=0) + 1e-12), full_matrices=False)
        return np.asarray(u[:, sizes > 1e-8 * sizes[0]])


def _joined(parts: Sequence[Instants]) -> Instants:
    """Instants one after the other."""
    names = ("time", "position", "velocity", "acceleration", "travel", "temperature")
    return replace(parts[0], **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})
