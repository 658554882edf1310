"""Friction that follows the temperature."""

from pumaid.effects import Effect, Family, Parameter


class ThermalFriction(Effect):
    """Friction in proportion to the joint's measured temperature.

    s is the sign of the motion; a is negative where grease thins as it warms. The reference only shifts Coulomb
    friction. Where the logs have no temperature the effect is nothing, as if the joint were at the reference: with no
    temperature at all it cannot be seen.
    """

    formula = "s * a * (temperature - 25)"
    left_out = "it follows a measured temperature: what is written is the joint at 25 degC"
    source = (
        "A. C. Bittencourt and S. Gunnarsson, Static friction in a robot joint: modeling and identification of load and"
        " temperature effects, ASME J. Dynamic Systems, Measurement, and Control 134 (2012) 051013"
    )
    family = Family.TEMPERATURE
    seen_in = "logs that hold the motors' temperatures, of a cold and of a warm arm"
    look_alikes = ("warmup", "torque_constant_drift", "friction_step")
    linear = (Parameter("a", "A/degC", "friction per degree", "a{n}", -0.008),)
