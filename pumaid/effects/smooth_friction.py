"""Smooth friction: builds up with speed."""

from pumaid.effects import Effect, Family, Parameter, Shape


class SmoothFriction(Effect):
    """Friction lacks a at the slowest motion and has its full value at a few times the speed `velocity`.

    s is the sign of the motion, v the speed. Coulomb friction takes what does not change with speed, so this is what a
    tanh(v/velocity) lacks of it: the opposite of a Stribeck fall. A positive a that is as large as Coulomb friction
    means that friction goes through zero without a jump.
    """

    formula = "s * a * (tanh(v / velocity) - 1)"
    source = (
        "S. Andersson, A. Soderberg and S. Bjorklund, Friction models for sliding dry, boundary and mixed lubricated"
        " contacts, Tribology International 40 (2007) 580-587; C. Makkar, W. E. Dixon, W. G. Sawyer and G. Hu, A new"
        " continuously differentiable friction model for control systems design, IEEE/ASME AIM 2005, 600-605"
    )
    family = Family.SPEED
    seen_in = "runs both ways at four speeds or more, down to the slowest that is smooth"
    look_alikes = ("stribeck", "viscous_power", "torque_droop", "saturation")
    linear = (Parameter("a", "A", "what friction lacks at rest", "a{n}", 0.1, sign=1),)
    nonlinear = (
        Shape(
            "velocity",
            "{unit}/s",
            "speed at which friction has 76 % of its rise",
            1e-4,
            20.0,
            0.15,
            starts=(0.06, 0.12, 0.25, 0.5, 1.0),
            of="fastest",
        ),
    )
