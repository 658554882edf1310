"""Effects that data cannot tell apart are declared as each other's look-alikes, measured on a virtual campaign."""

from dataclasses import replace

import numpy as np
import pytest
import table1

from pumaid.effects import Effect, Extent, Samples, Scope, catalogue
from pumaid.model import Model, loads
from pumaid.rigid_body import of_body

ROBOT = table1.robot()
MODEL = Model(ROBOT)
SPEEDS = (0.1, 0.25, 0.5, 1.0)
#: Share of what the base model leaves of an effect that another must take away to be its look-alike.
ALIKE = 0.8
#: Less than this share of an effect left by the base model is nothing to compare.
UNSEEN = 0.01


def campaign(joint: int, *, bins: int = 40) -> Samples:
    """Runs of one joint in four postures, four speeds, both ways, twice, in random order, warming as they go."""
    rng, runs, clock = np.random.default_rng(joint), [], 0.0
    postures = rng.uniform(-1.3, 1.3, (4, ROBOT.n_joints))
    orders = [(p, v, s) for p in postures for v in SPEEDS for s in (1.0, -1.0)]
    share = (np.arange(bins) + 0.5) / bins
    for posture, v, s in [orders[k] for k in (*rng.permutation(len(orders)), *rng.permutation(len(orders)))]:
        position, velocity = np.tile(posture, (bins, 1)), np.zeros((bins, ROBOT.n_joints))
        position[:, joint - 1] = s * (2.4 * share - 1.2)
        late = 0.05 * np.exp(-share / 0.1)  # the speed settles
        velocity[:, joint - 1] = s * v * (1.0 + late)
        time = clock + share * 2.4 / v
        runs.append((position, velocity, -s * v * late * v / 0.24, np.full(bins, s), time, 2.4 * share))
        clock = time[-1] + 3.0
    position, velocity, acceleration, direction, time, travel = (
        np.concatenate(part) for part in zip(*runs, strict=True)
    )
    more = {"elapsed": time, "temperature": 25.0 + 20.0 * (1.0 - np.exp(-time / 400.0))}
    more["run"] = np.repeat(np.arange(len(runs)), bins)
    more["bodies"] = of_body(ROBOT, joint, (position.T, 0.0 * position.T, 0.0 * position.T))
    return Samples(joint, position, velocity, acceleration, direction, time=time, travel=travel, **more)


def solution() -> np.ndarray:
    """A PUMA's gravity and friction, A: heavy links inside, light ones outside."""
    rng, sizes = np.random.default_rng(0), {"coulomb": 0.4, "viscous": 0.2}
    heavy = [0.2 / max(column.owner - 1, 1) * rng.choice([-1.0, 1.0]) for column in MODEL.columns]
    sign = [-1.0 if column.effect == "coulomb" and column.name.endswith("minus") else 1.0 for column in MODEL.columns]
    return np.array([sizes.get(c.effect, h) * s for c, h, s in zip(MODEL.columns, heavy, sign, strict=True)])


def signals(joint: int) -> dict[str, list[np.ndarray]]:
    """For each effect at each start of its search: an orthonormal basis of what the base model leaves of it."""
    samples, scales = campaign(joint), np.triu(np.ones((6, 6)))
    samples = replace(samples, loads=loads(MODEL, samples, solution=solution(), scales=scales))
    base = MODEL.regressor(samples) * scales[joint - 1][MODEL.owners - 1]
    absorbed = np.linalg.qr(base[:, np.abs(base).max(axis=0) > 1e-9])[0]
    starts = [float(samples.time[samples.run == run].min()) for run in np.unique(samples.run)]
    drawn = float(np.abs(samples.loads.drawn).max())
    extent = Extent(joint, SPEEDS, (-1.2, 1.2), 0.4, 2.4, tuple(starts), float(samples.time.max()), drawn)
    found: dict[str, list[np.ndarray]] = {}
    for effect in (one for one in catalogue().values() if not (one.base or one.is_free)):
        for columns in tried(effect, samples, extent):
            left = columns - absorbed @ (absorbed.T @ columns)
            if np.linalg.norm(left) > UNSEEN * np.linalg.norm(columns):
                basis, size, _ = np.linalg.svd(left, full_matrices=False)
                found.setdefault(effect.name, []).append(basis[:, size > 1e-6 * size[0]])
    return found


def tried(effect: Effect, samples: Samples, extent: Extent):
    """Columns of an effect in this joint, over its owners and the starts of its search."""
    causes = {Scope.ARM: [0], Scope.CAUSE: range(1, 7)}
    for owner in causes.get(effect.scope, [samples.joint]):
        if effect.applies(ROBOT, owner) is None:
            for shape in effect.grid(ROBOT, replace(extent, joint=owner or None)):
                columns = effect.columns(ROBOT, samples, number=owner, shape=shape)
                if np.abs(columns).max() > 1e-9:
                    yield columns


@pytest.mark.parametrize("joint", [1, 2, 3, 5])
def test_what_cannot_be_told_apart_is_declared(joint):
    """Where another effect takes away four fifths of an effect in most of its shapes, the effect names it."""
    rng, undeclared, found = np.random.default_rng(1), [], signals(joint)
    for name, own in found.items():
        for other in set(found) - {name, *catalogue()[name].look_alikes}:
            shares = []
            for basis in own:
                signal = basis @ rng.normal(size=basis.shape[1])
                best = max(float(np.linalg.norm(rival.T @ signal)) for rival in found[other])
                shares.append((best / np.linalg.norm(signal)) ** 2)
            undeclared += [(name, other, np.median(shares))] if np.median(shares) > ALIKE else []
    assert undeclared == []
