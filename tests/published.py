"""Arms by their vendors' published numbers: joint origins, and the weight that joints carry by published masses."""

import numpy as np
import pinocchio as pin

HALF = np.pi / 2
#: Kinova Gen3 7DOF: joint origins (xyz m, rpy rad; axis z), masses (kg) and centres (m) of the arm with its camera.
#: Kinovarobotics/ros2_kortex (BSD-3-Clause), kortex_description/arms/gen3/7dof/urdf/gen3_macro.xacro.
GEN3 = (
    ((0, 0, 0.15643), (np.pi, 0, 0), 1.3773, (-2.3e-05, -0.010364, -0.07336)),
    ((0, 0.005375, -0.12838), (HALF, 0, 0), 1.1636, (-4.4e-05, -0.09958, -0.013278)),
    ((0, -0.21038, -0.006375), (-HALF, 0, 0), 1.1636, (-4.4e-05, -0.006641, -0.117892)),
    ((0, 0.006375, -0.21038), (HALF, 0, 0), 0.9302, (-1.8e-05, -0.075478, -0.015006)),
    ((0, -0.20843, -0.006375), (-HALF, 0, 0), 0.6781, (1e-06, -0.009432, -0.063883)),
    ((0, 0.00017505, -0.10593), (HALF, 0, 0), 0.6781, (1e-06, -0.045483, -0.00965)),
    ((0, -0.10593, -0.00017505), (-HALF, 0, 0), 0.5, (0.000281, 0.011402, -0.029798)),
)
#: UR3e: standard Denavit-Hartenberg a, d (m) and alpha (rad), masses and centres in the frame at a link's far end.
#: Universal Robots, "DH Parameters for calculations of kinematics and dynamics" (support article); the same masses in
#: UniversalRobots/Universal_Robots_ROS2_Description, config/ur3e/physical_parameters.yaml.
UR3E = (
    (0.0, 0.15185, HALF, 1.98, (0.0, -0.02, 0.0)),
    (-0.24355, 0.0, 0.0, 3.4445, (0.13, 0.0, 0.1157)),
    (-0.2132, 0.0, 0.0, 1.437, (0.05, 0.0, 0.0238)),
    (0.0, 0.13105, HALF, 0.871, (0.0, 0.0, 0.01)),
    (0.0, 0.08535, -HALF, 0.805, (0.0, 0.0, 0.01)),
    (0.0, 0.0921, 0.0, 0.261, (0.0, 0.0, -0.02)),
)


def model_of(links) -> pin.Model:
    """One of these arms, upright."""
    model, parent, behind = pin.Model(), 0, pin.SE3.Identity()
    for *where, mass, centre in links:
        before = after = pin.SE3.Identity()
        if len(where) == 2:
            before = pin.SE3(pin.rpy.rpyToMatrix(*where[1]), np.array(where[0], dtype=float))
        else:
            after = pin.SE3(pin.utils.rotate("x", where[2]), np.array([where[0], 0.0, where[1]]))
        parent = model.addJoint(parent, pin.JointModelRZ(), behind * before, f"j{model.njoints}")
        model.appendBodyToJoint(parent, pin.Inertia(mass, np.array(centre), np.zeros((3, 3))), after)
        behind = after
    model.gravity.linear = np.array([0.0, 0.0, -9.80665])
    return model


def first_harmonic(links, position, joint: int) -> list[float]:
    """N m on `joint` (from 1) at its positions 0 and a quarter turn, the other joints held at `position` (rad)."""
    # The load at any other position q of the joint is their sum weighted with cos q and sin q.
    model, held, out = model_of(links), np.array(position, dtype=float), []
    for held[joint - 1] in (0.0, HALF):
        out.append(float(pin.computeGeneralizedGravity(model, model.createData(), held)[joint - 1]))
    return out
