"""The JSON form of an export evaluated by what its ``meaning`` says, in as plain a way as can be."""

from functools import partial

import numpy as np

STEP = 1e-5


def current(document: dict, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """(J,) A at positions q and velocities qd."""
    load, across, tilts = loads(document, q)
    v = np.array(document["shaft"]) @ qd
    out = np.empty(len(q))
    for i in range(len(q)):
        way = 0 if v[i] > 0 else 1
        base = document["coulomb"][i][way] + document["viscous"][i][way] * v[i]
        names = {"q": q[i], "v": v[i], "s": np.sign(v[i]), "load": load[i], "drawn": load[i] + base}
        names |= {"across": across[i], "tilt_x": tilts[i][0], "tilt_y": tilts[i][1]}
        names |= {f"load_{m + 1}": load[m] for m in range(len(q))}
        names |= {f"shaft_{m + 1}": v[m] for m in range(len(q))}
        terms = [one for one in document["terms"] if one["joint"] == i + 1]
        asked = [m for m in range(len(q)) if any(f"slope_{m + 1}" in one["formula"] for one in terms)]
        for m, step in ((m, np.eye(len(q))[m] * STEP) for m in asked):
            ends = [loads(document, q + sign * step)[0][i] for sign in (1, -1)]
            names[f"slope_{m + 1}"] = (ends[0] - ends[1]) / (2 * STEP)
        functions = {
            "curve": partial(curve, np.array(document.get("curves", []))),
            "sin": np.sin,
            "cos": np.cos,
            "tanh": np.tanh,
            "exp": np.exp,
            "sqrt": np.sqrt,
            "abs": abs,
            "sign": np.sign,
            "max": max,
        }
        out[i] = load[i] + base + sum(eval(one["formula"], functions | names) for one in terms)
    return out


def curve(rows: np.ndarray, row: int, x: float) -> float:
    """A learned curve, held at the ends of its range."""
    low, high, *a = rows[int(row)].tolist()
    u = 32.0 * min(max((x - low) / (high - low), 0.0), 1.0)
    i = min(int(u), 31)
    t, s = u - i, 1.0 - u + i
    parts = (s**3, 3 * t**3 - 6 * t**2 + 4, 3 * s**3 - 6 * s**2 + 4, t**3)
    return sum(part * a[i + k] for k, part in enumerate(parts)) / 6.0


def loads(document: dict, q: np.ndarray) -> tuple[list[float], list[float], list[list[float]]]:
    """Gravity's current, its moment across the axis, and its derivative by a turn of the base, of each joint."""
    g, frame, z, h = np.array(document["gravity"]), np.eye(3), [], []
    for one, (first, second), at in zip(document["joints"], document["moments"], q, strict=True):
        turns = one["type"] == "revolute"
        theta, d = (one["theta"] + at, one["d"]) if turns else (one["theta"], one["d"] + at)
        placed = np.array(one["placement"])[:3, :3] if one["placement"] else about(0, one["alpha"])
        frame = frame @ placed @ about(2, theta)
        z.append(frame[:, 2])
        h.append(first * frame[:, 0] + second * frame[:, 1] if turns else first * d * frame[:, 2])
    load, across, tilts = [], [], []
    for i, one in enumerate(document["joints"]):
        H, F = (sum(document[name][i][j] * h[j] for j in range(i, len(h))) for name in ("ratios", "felt"))
        ways = [np.cross(g, axis) for axis in np.eye(3)[:2]]
        if one["type"] == "revolute":
            moment = np.cross(g, F)
            load.append(np.cross(z[i], g) @ H)
            across.append(np.linalg.norm(moment - z[i] * (z[i] @ moment)))
            tilts.append([np.cross(z[i], way) @ F for way in ways])
        else:
            load.append(-(g @ z[i]) * document["moments"][i][0])
            across.append(0.0)
            tilts.append([-(z[i] @ way) * document["moments"][i][0] for way in ways])
    return load, across, tilts


def about(axis: int, angle: float) -> np.ndarray:
    """Rotation about x (0) or z (2)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]] if axis == 0 else [[c, -s, 0], [s, c, 0], [0, 0, 1]])
