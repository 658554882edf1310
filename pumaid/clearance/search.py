"""Where on a path a contact is nearest: halving of the way, with bounds on what lies between the postures looked at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.clearance.contacts import Contacts
from pumaid.clearance.paths import Route

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

#: Pieces into which every path is cut at first.
_PIECES = 4
#: Postures looked at in one go, so that memory stays small.
_AT_ONCE = 2048


@dataclass(frozen=True, eq=False, slots=True)
class Nearest:
    """(K,) for each path: least distance found, m, at which share of the way, and of which contact."""

    distance: Floats
    share: Floats
    contact: Ints


def nearest(
    contacts: Contacts, path: Route, *, count: int, tolerance: float, threshold: float | None = None
) -> Nearest:
    """Least distance of all contacts along each of `count` paths.

    A piece of a path is given up once bounds show that nothing in it comes nearer than what was found on that path;
    every other piece is halved. So nothing between the postures looked at is missed.

    Parameters
    ----------
    contacts, path, count
        What is held apart, and the paths, numbered from 0.
    tolerance
        m by which the answer may be above the true least distance.
    threshold
        m. Where it is given, only this is found out: a path whose answer is at or above `threshold` + `tolerance` stays
        above `threshold`. That takes much less time.
    """
    best = Nearest(np.full(count, np.inf), np.zeros(count), np.zeros(count, dtype=np.intp))
    hunt = _Hunt(contacts, path, best, tolerance, threshold)
    which, low, width = (
        np.repeat(np.arange(count), _PIECES),
        np.tile(np.arange(_PIECES) / _PIECES, count),
        1.0 / _PIECES,
    )
    while len(which):
        parts = range(0, len(which), _AT_ONCE)
        kept = np.concatenate([hunt.look(which[n : n + _AT_ONCE], low[n : n + _AT_ONCE], width) for n in parts])
        kept &= ~hunt.settled(which)
        width /= 2.0
        which, low = np.repeat(which[kept], 2), np.repeat(low[kept], 2)
        low[1::2] += width
    return best


@dataclass(frozen=True, eq=False, slots=True)
class _Hunt:
    contacts: Contacts
    path: Route
    best: Nearest
    tolerance: float
    threshold: float | None

    def settled(self, which: Ints) -> NDArray[np.bool_]:
        """(N,) whether nothing is left to be found out about the paths of some pieces."""
        if self.threshold is None:
            return np.zeros(len(which), dtype=bool)
        return np.asarray(self.best.distance[which] < self.threshold + self.tolerance)

    def look(self, which: Ints, low: Floats, width: float) -> NDArray[np.bool_]:
        """Look at the middle of (N,) pieces; (N,) whether a piece may hold something nearer than is known."""
        wanted = np.flatnonzero(~self.settled(which))
        out = np.zeros(len(which), dtype=bool)
        if not len(wanted):
            return out
        which, low = which[wanted], low[wanted]
        middle = self.path(which, low + 0.5 * width)
        room = np.maximum(np.abs(self.path(which, low) - middle), np.abs(self.path(which, low + width) - middle))
        view = self.contacts.view(middle, room)
        self._note(which, low + 0.5 * width, view.distance)
        known = self.threshold if self.threshold is not None else self.best.distance[which] - self.tolerance
        floor = np.broadcast_to(known, which.shape)
        rows, pairs = np.nonzero(view.distance - view.spread < floor[:, None])
        least = view.distance[rows, pairs] - view.finer(rows, pairs, self.contacts)
        out[wanted[rows[least < floor[rows]]]] = True
        return out

    def _note(self, which: Ints, share: Floats, distance: Floats) -> None:
        """Keep what is nearer than anything found before."""
        contact = distance.argmin(axis=1)
        least = distance[np.arange(len(which)), contact]
        order = np.lexsort((least, which))
        first = order[np.r_[True, np.diff(which[order]) > 0]]
        better = first[least[first] < self.best.distance[which[first]]]
        self.best.distance[which[better]] = least[better]
        self.best.share[which[better]] = share[better]
        self.best.contact[which[better]] = contact[better]
