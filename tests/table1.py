"""The paper's PUMA 560 as a virtual robot, and the experiment that was made on it (Table I)."""

import numpy as np

from pumaid.robot import Joint, Robot
from pumaid.simulation.virtual_robot import BREAKAWAY, Constants, Friction, Noise, Truth, links_of
from pumaid.trajectory import Motion, Plan, Posture
from pumaid.units import factor

#: The table prints k* times this, m/s2.
TABLE_GRAVITY = 9.8
_DEG = factor("deg")

_NAMES = ("waist", "shoulder", "elbow", "wrist roll", "wrist pitch", "flange")
#: Of each joint: alpha (deg), a, d (m); k*_x, k*_y as printed; Coulomb friction forward and backward (A), viscous
#: friction forward and backward (A s/deg); standard deviation (A).
_ALPHA_DEG, _A, _D, _K_X, _K_Y, _COULOMB_PLUS, _COULOMB_MINUS, _VISCOUS_PLUS, _VISCOUS_MINUS, _STD = np.array(
    [
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.71678, -0.28355, 0.00222, 0.00332, 0.0225),
        (-90.0, 0.0, 0.2435, 2.191535, 0.00371, 0.54814, -0.98279, 0.00677, 0.00291, 0.0293),
        (0.0, 0.4318, -0.0934, 0.02212, 0.80144, -0.45359, 0.3625, -0.00573, -0.00475, 0.0149),
        (90.0, -0.0203, 0.4331, -0.0306, 0.01287, -0.16843, 0.22914, -0.00133, -0.00121, 0.0187),
        (-90.0, 0.0, 0.0, -0.01424, 0.13828, -0.18605, 0.27428, -0.0029, -0.00195, 0.0167),
        (90.0, 0.0, 0.0, -0.00053, 0.00043, -0.16082, 0.23237, -0.00181, -0.00238, 0.00636),
    ]
).T

_ARM = (0, -90, 90, 0, 0, 0)
_WRIST = (0, -90, 0, 0, 0, 0)
#: joint -> its postures, deg.
_POSTURES_DEG: dict[int, tuple[tuple[int, ...], ...]] = {
    1: (_ARM,),
    2: (_ARM, (0, -90, 150, 0, 0, 0)),
    3: (_ARM, (0, -90, 90, 0, 90, 0)),
    4: (_WRIST, (0, -90, 0, 0, 90, 0)),
    5: (_WRIST, (0, -90, 0, 0, 0, 90)),
    6: (_WRIST,),
}


def robot() -> Robot:
    """The PUMA 560 of the paper, without limits (the experiment turned every joint over -125..125 deg)."""
    return Robot(
        name="PUMA 560",
        joints=tuple(
            Joint(
                number=i + 1,
                name=_NAMES[i],
                kind="revolute",
                alpha=float(_ALPHA_DEG[i]) * _DEG,
                a=float(_A[i]),
                d=float(_D[i]),
            )
            for i in range(6)
        ),
    )


def puma560() -> Truth:
    """The virtual robot whose parameters are those of Table I.

    Its noise has the table's standard deviations, a fifth of the variance being a level of each run. Motor inertia and
    the steps of encoders and current sensors are not in the table; plausible values stand in.

    Source
    ------
    S.-K. Lin, "Identification of a Class of Nonlinear Deterministic Systems with Application to Manipulators", Table I.
    """
    friction = Friction(_COULOMB_PLUS, _COULOMB_MINUS, _VISCOUS_PLUS / _DEG, _VISCOUS_MINUS / _DEG)
    # eta_1/eta_2 acts on nothing (joint 1 is parallel to gravity) and is not in the table; 1 stands in.
    ratio = np.array([1.0, -0.5745, 0.10676, 0.14463, 2e-06])
    given = Constants(_K_X / TABLE_GRAVITY, _K_Y / TABLE_GRAVITY, np.zeros(6), ratio)
    # Steps of the current sensor (A) and of the encoders (counts a rad) are well below the noise.
    noise = Noise(_STD, current_step=0.0005, counts=np.full(6, 1e5))
    inertia = np.array([0.12, 0.15, -0.06, -0.03, -0.03, -0.02])
    links, gain = links_of(robot(), given, inertia)
    return Truth(robot(), friction, noise, links, gain, inertia, np.full(6, BREAKAWAY), given_constants=given)


def experiment(replicates: int = 1) -> Plan:
    """The paper's motions, made `replicates` times: five speeds of each joint both ways in the paper's postures."""
    postures = [
        Posture(joint, tuple(value * _DEG for value in hold), (), "a posture of the paper")
        for joint, holds in _POSTURES_DEG.items()
        for hold in holds
    ]
    end = 125 * _DEG
    return Plan(
        robot="PUMA 560",
        motions=tuple(
            Motion(posture.joint, posture.hold, -end * sign, end * sign, speed * _DEG)
            for _ in range(replicates)
            for posture in postures
            for speed in (30, 40, 50, 60, 70)
            for sign in (1, -1)
        ),
        postures=tuple(postures),
    )
