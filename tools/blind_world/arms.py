"""Arms drawn by seed: modified Denavit-Hartenberg chains with masses, gears and motors, as MuJoCo models."""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

GRAVITY = 9.80665
#: s, step of the closed loop's simulation.
STEP = 0.0025
QUARTER = np.pi / 2
TURN = 2.6
COMMON: dict[str, tuple[float, ...]] = {
    "theta": (0,) * 6,
    "slides": (False,) * 6,
    "low": (-TURN,) * 6,
    "high": (TURN,) * 6,
}
#: What arms of one kind have in common, one entry a joint, as in `Arm`; `constant` is N m per A and `rotor` kg m2 at
#: the motor, `reach` m the largest distance of a centre of mass from its frame.
KINDS: dict[str, dict[str, tuple[float, ...]]] = {
    "puma": COMMON
    | {
        "alpha": (0, -QUARTER, 0, QUARTER, -QUARTER, QUARTER),
        "a": (0, 0, 0.4318, -0.0203, 0, 0),
        "d": (0, 0.2435, -0.0934, 0.4331, 0, 0),
        "speed": (1.3, 1.2, 1.4, 2.2, 2.0, 2.4),
        "mass": (13.0, 17.4, 4.8, 0.9, 0.4, 0.15),
        "reach": (0.1, 0.25, 0.12, 0.06, 0.03, 0.03),
        "gear": (62.6, 107.8, 53.7, 76.0, 71.9, 76.7),
        "constant": (0.25, 0.24, 0.25, 0.09, 0.09, 0.08),
        "rotor": (2e-4, 2e-4, 2e-4, 3e-5, 3e-5, 3e-5),
        "coulomb": (0.5, 0.7, 0.4, 0.2, 0.22, 0.18),
    },
    "ur": COMMON
    | {
        "alpha": (0, QUARTER, 0, 0, QUARTER, -QUARTER),
        "a": (0, 0, -0.425, -0.3922, 0, 0),
        "d": (0.1625, 0, 0, 0.1333, 0.0997, 0.0996),
        "speed": (1.4, 1.3, 1.5, 2.0, 2.2, 2.4),
        "mass": (3.8, 8.4, 2.3, 1.2, 1.2, 0.25),
        "reach": (0.04, 0.25, 0.2, 0.04, 0.04, 0.04),
        "gear": (101.0,) * 6,
        "constant": (0.125, 0.125, 0.125, 0.092, 0.092, 0.092),
        "rotor": (1e-4, 1e-4, 1e-4, 3e-5, 3e-5, 3e-5),
        "coulomb": (0.7, 0.8, 0.6, 0.35, 0.35, 0.3),
    },
    "stanford": COMMON
    | {
        "alpha": (0, -QUARTER, QUARTER, 0, -QUARTER, QUARTER),
        "a": (0,) * 6,
        "d": (0.412, 0.154, 0.0, 0.0, 0.0, 0.263),
        "theta": (0, 0, -QUARTER, 0, 0, 0),
        "slides": (False, False, True, False, False, False),
        "low": (-TURN, -TURN, 0.30, -TURN, -1.5, -TURN),
        "high": (TURN, TURN, 1.10, TURN, 1.5, TURN),
        "speed": (1.2, 1.2, 0.45, 2.0, 2.0, 2.2),
        "mass": (9.0, 6.0, 4.3, 1.1, 0.7, 0.5),
        "reach": (0.1, 0.12, 0.3, 0.05, 0.05, 0.06),
        "gear": (100.0, 100.0, 600.0, 80.0, 80.0, 60.0),
        "constant": (0.11, 0.12, 0.08, 0.07, 0.07, 0.06),
        "rotor": (1e-4, 1e-4, 5e-5, 2e-5, 2e-5, 2e-5),
        "coulomb": (0.5, 0.6, 0.4, 0.25, 0.25, 0.2),
    },
}


@dataclass(frozen=True, eq=False)
class Arm:
    """One arm; J joints, arrays by joint, SI.

    Attributes
    ----------
    mass, centre, inertia
        (J,) kg, (J, 3) m and (J, 3) kg m2 (principal, along the frame's axes) of each link in its own frame.
    gear, armature
        (J,) motor turns per joint turn; (J,) kg m2 or kg: rotor seen from the joint.
    gain
        (J,) A per N m or N, with the sign of the motor's wiring.
    is_geared
        Whether the recipe tells the gear ratios.
    """

    kind: str
    seed: int
    alpha: Floats
    theta: Floats
    low: Floats
    high: Floats
    slides: NDArray[np.bool_]
    a: Floats
    d: Floats
    speed: Floats
    mass: Floats
    centre: Floats
    inertia: Floats
    gear: Floats
    armature: Floats
    gain: Floats
    coulomb: Floats
    is_geared: bool

    @property
    def n(self) -> int:
        """Joints."""
        return len(self.alpha)

    @property
    def name(self) -> str:
        """As the recipe calls it."""
        return f"{self.kind} {self.seed}"


def draw_arm(kind: str, seed: int, joints: int = 6) -> Arm:
    """An arm of a kind: lengths, masses, gears and motors within physical ranges about the kind's own.

    It has the kind's first `joints`.
    """
    common = {name: values[:joints] for name, values in KINDS[kind].items()}
    n, rng = joints, np.random.default_rng([seed, sorted(KINDS).index(kind), 1])

    def about(values: tuple[float, ...], share: float) -> Floats:
        return np.array(values, dtype=float) * rng.uniform(1.0 - share, 1.0 + share, n)

    mass = about(common["mass"], 0.35)
    centre = rng.uniform(-1.0, 1.0, (n, 3)) * np.array(common["reach"])[:, None] * 0.4
    _lay_along_links(centre, common, rng)
    if rng.random() < 0.8:  # a tool
        mass[-1] += rng.uniform(0.4, 2.0)
        centre[-1] = [rng.uniform(-0.06, 0.06), rng.uniform(-0.06, 0.06), rng.uniform(0.03, 0.12)]
    sides = np.square(np.array(common["reach"])[:, None] * rng.uniform(0.5, 1.5, (n, 3)))  # of a solid block
    inertia = mass[:, None] * (sides.sum(axis=1, keepdims=True) - sides) / 12.0 + 1e-5
    gear, constant = about(common["gear"], 0.2), about(common["constant"], 0.2)
    sign = np.where(rng.random(n) < 0.25, -1.0, 1.0)
    return Arm(
        kind=kind,
        seed=seed,
        **{name: np.array(common[name], dtype=float) for name in ("alpha", "theta", "low", "high")},
        slides=np.array(common["slides"]),
        a=about(common["a"], 0.2),
        d=about(common["d"], 0.2),
        speed=about(common["speed"], 0.15),
        mass=mass,
        centre=centre,
        inertia=inertia,
        gear=np.round(gear, 1),
        armature=about(common["rotor"], 0.3) * gear**2,
        gain=sign / (gear * constant),
        coulomb=about(common["coulomb"], 0.5),
        is_geared=bool(rng.random() < 0.5),
    )


def _lay_along_links(centre: Floats, common: dict[str, tuple[float, ...]], rng: np.random.Generator) -> None:
    """Put each centre of mass part of the way to the next frame, where a link's body is."""
    for k in range(len(centre) - 1):
        alpha, a, d = common["alpha"][k + 1], common["a"][k + 1], 0.0 if common["slides"][k + 1] else common["d"][k + 1]
        centre[k] += rng.uniform(0.2, 0.6) * np.array([a, -d * np.sin(alpha), d * np.cos(alpha)])
    for k in np.flatnonzero(common["slides"]).tolist():
        centre[k, 2] -= rng.uniform(0.2, 0.8) * common["reach"][k]


def model_of(arm: Arm, loop: tuple[Floats, Floats, Floats] | None = None) -> mujoco.MjModel:
    """The arm in MuJoCo.

    A `loop` gives its joints (J,) stiffness and damping of PD actuators (N m/rad and N m s/rad, or N/m and N s/m), and
    dry friction (N m or N).
    """
    parts = [
        f'<mujoco><compiler angle="radian"/><option timestep="{STEP}" integrator="implicitfast" '
        f'gravity="0 0 {-GRAVITY}"><flag contact="disable"/></option><worldbody>'
    ]
    for k in range(arm.n):
        s, c = np.sin(arm.alpha[k]), np.cos(arm.alpha[k])
        kind = "slide" if arm.slides[k] else "hinge"
        loss = "" if loop is None else f' frictionloss="{loop[2][k]}"'
        place, turn = f"{arm.a[k]} {-arm.d[k] * s} {arm.d[k] * c}", f"{arm.alpha[k]} 0 {arm.theta[k]}"
        parts.append(
            f'<body name="link{k + 1}" pos="{place}" euler="{turn}">'
            f'<joint name="joint{k + 1}" type="{kind}" axis="0 0 1" armature="{arm.armature[k]}"{loss}/>'
            f'<inertial pos="{_row(arm.centre[k])}" mass="{arm.mass[k]}" diaginertia="{_row(arm.inertia[k])}"/>'
        )
    parts.append("</body>" * arm.n + "</worldbody>")
    for k, (p, v, _) in enumerate(zip(*loop, strict=True) if loop else ()):
        motor = f'<general joint="joint{k + 1}" gainprm="{p}" biastype="affine" biasprm="0 {-p} {-v}"/>'
        parts.append(f"<actuator>{motor}</actuator>")
    return mujoco.MjModel.from_xml_string("".join([*parts, "</mujoco>"]))


def _row(values: Floats) -> str:
    return " ".join(f"{value:.12g}" for value in values)
