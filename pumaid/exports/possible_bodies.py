"""Rigid bodies that are possible and have given sums of inertial parameters, or else the nearest that are."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from pumaid.maths import Floats
from pumaid.rigid_body import PARAMETERS, TENSOR

#: Newton's steps at most, and the least share of a step.
STEPS, SHORTEST = 50, 1e-6
#: What a step gains below which it is taken whole, and below which it is the last.
QUADRATIC, SETTLED = 0.05, 1e-12
#: Relative size of what is residual of equations that are solved.
SOLVED = 1e-11
#: Standard error of a sum, as a share of the guess's or of the largest, below which none counts.
SUREST = 1e-6
#: Squared standard errors that nearness to the guess may cost, where no links have the sums, and by how much less at a
#: time a search comes down to it.
SLACK, FASTER = 1e-3, 0.1
#: A divergence, but for the factor 2, beyond which no links have the sums.
FARTHEST = 1e5
#: Least eigenvalue of a pseudo-inertia, beside the guess's, at which a search stays in double precision.
EDGE = 1e-7


def _pseudo_inertia() -> Floats:
    """(11, 5, 5) what a unit of each of `PARAMETERS` adds to the pseudo-inertia of a link, its rotor beside it."""
    out = np.zeros((len(PARAMETERS), 5, 5))
    out[0, 3, 3] = out[-1, 4, 4] = 1.0
    for axis in range(3):
        out[1 + axis, axis, 3] = out[1 + axis, 3, axis] = 1.0
    for k, name in enumerate(PARAMETERS[4:10], 4):
        a, b = TENSOR[name]
        out[k, :3, :3] = 0.5 * (a == b) * np.eye(3)
        out[k, a, b] -= 1.0
        out[k, b, a] = out[k, a, b]
    return out


#: A link is possible where its parameters times these add up to a positive definite matrix.
PSEUDO_INERTIA = _pseudo_inertia()


def possible(guess: Floats, sums: Floats, wanted: Floats, *, covariance: Floats) -> tuple[Floats, float | None]:
    """(J, 11) parameters of possible links near a `guess` (J, 11), itself possible, of which `sums` (P, 11 J) are as
    `wanted` (P,), to rounding.

    Where no possible links have these sums they are the fewest standard errors off, by their `covariance` (P, P); then
    how many. Near is a small log-determinant divergence from the guess, in which all but possible links are infinitely
    far.

    Source: P. M. Wensing, S. Kim and J.-J. E. Slotine, IEEE Robotics and Automation Letters 3 (2018) 60-67, for what is
    possible; T. Lee, P. M. Wensing and F. C. Park, IEEE Trans. Robotics 36 (2020) 168-182, for the divergence.
    """
    links = _ScaledLinks.near(guess)
    rows = sums * links.scale.ravel()
    sizes = np.linalg.norm(rows, axis=1)
    errors = covariance + np.diag((SUREST * sizes * (1.0 + np.abs(wanted / sizes).max())) ** 2)
    root = np.linalg.inv(np.linalg.cholesky(errors))
    rows, wanted = root @ rows, root @ wanted
    values = links.start
    off = rows @ values - wanted
    slack = max(float(off @ off), SLACK)
    while slack > SLACK and off @ off < FARTHEST * slack:
        slack = max(slack * FASTER, SLACK)
        values = links.centred(rows, wanted, values, slack=slack)
        off = rows @ values - wanted
    exact, target, residual = values, wanted, off
    before = np.inf if off @ off < FARTHEST * slack else 0.0
    while np.linalg.norm(residual) < 0.5 * before:  # M. J. D. Powell's method of multipliers
        before = float(np.linalg.norm(residual))
        if before < SOLVED * np.linalg.norm(wanted):
            return links.parameters(exact), None
        target = target - residual
        exact = links.centred(rows, target, exact, slack=slack)
        residual = rows @ exact - wanted
    return links.parameters(values), float(np.linalg.norm(off))


@dataclass(frozen=True, eq=False, slots=True)
class _ScaledLinks:
    """Pseudo-inertias as multiples of a guess's: (J, 11, 5, 5) of each parameter, which is measured by `scale`."""

    parts: Floats
    scale: Floats  # (J, 11)
    start: Floats  # (11 J,) the guess

    @classmethod
    def near(cls, guess: Floats) -> "_ScaledLinks":
        """Links measured by a guess (J, 11)."""
        factor = np.linalg.inv(np.linalg.cholesky(np.einsum("jk,kab->jab", guess, PSEUDO_INERTIA)))
        parts = factor[:, None] @ PSEUDO_INERTIA @ factor.transpose(0, 2, 1)[:, None]
        scale = 1.0 / np.linalg.norm(parts, axis=(2, 3))
        return cls(parts * scale[:, :, None, None], scale, (guess / scale).ravel())

    def parameters(self, values: Floats) -> Floats:
        """(J, 11) of scaled parameters (11 J,)."""
        return np.asarray(values.reshape(self.scale.shape) * self.scale)

    def centred(self, rows: Floats, wanted: Floats, values: Floats, *, slack: float) -> Floats:
        """(11 J,) scaled parameters of least divergence plus ``|rows values - wanted|^2 / (2 slack)``, from given ones.

        Source: S. Boyd and L. Vandenberghe, Convex Optimization, ch. 9.6: Newton's method, self-concordant costs.
        """
        for _ in range(STEPS):
            turned = np.linalg.inv(self._whole(values))[:, None] @ self.parts
            pull = np.trace(self.parts - turned, axis1=2, axis2=3).ravel()
            inverse = block_diag(*np.linalg.inv(np.einsum("jkab,jlba->jkl", turned, turned)))
            off, across = rows @ values - wanted, rows @ inverse
            pull = pull + rows.T @ np.linalg.solve(across @ rows.T + slack * np.eye(len(rows)), off - across @ pull)
            step = -inverse @ pull
            gain, share = float(step @ -pull + np.square(rows @ step).sum() / slack), 1.0
            cost = self._cost(values) + off @ off / (2.0 * slack)
            while share > SHORTEST:
                residual = rows @ (values + share * step) - wanted
                after = self._cost(values + share * step) + residual @ residual / (2.0 * slack)
                if after < cost - 0.1 * share * gain or (gain < QUADRATIC and np.isfinite(after)):
                    break
                share *= 0.5
            if share <= SHORTEST:
                break
            values = values + share * step
            if gain < SETTLED:
                break
        return values

    def _whole(self, values: Floats) -> Floats:
        """(J, 5, 5) pseudo-inertias, as multiples of the guess's."""
        return np.einsum("jk,jkab->jab", values.reshape(self.scale.shape), self.parts)

    def _cost(self, values: Floats) -> float:
        """Divergence from the guess but for a constant; infinite where a link is not possible or hardly so."""
        sizes = np.linalg.eigvalsh(self._whole(values))
        return float((sizes - np.log(sizes)).sum()) if sizes.min() > EDGE else np.inf
