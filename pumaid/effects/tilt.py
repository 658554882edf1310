"""Base tilted against gravity."""

from pumaid.effects import RARE, Effect, Family, Parameter, Scope, Shape, load_refusal
from pumaid.robot import Robot

#: Ratios of gains at which a search begins: those of neighbours on published arms, of either sign.
RATIOS = (-3.0, -1.0, -0.3, 0.3, 1.0, 3.0)


class Tilt(Effect):
    """The base is turned by small angles about its own x and y: gravity's load changes in every joint.

    x and y (rad) turn the whole arm by the right hand about the base frame's axes, gravity staying where it is. A turn
    about the direction of gravity changes nothing, so for an arm that stands upright x and y are all there is. It gives
    a load to a joint whose axis was thought upright: by its gain, which nothing else tells and which is a shape, and by
    the first moment of its own link, which no current shows until then and which has parameters of its own.
    """

    formula = "x * tilt_x + y * tilt_y"
    source = (
        "B. Siciliano, L. Sciavicco, L. Villani and G. Oriolo, Robotics: Modelling, Planning and Control, Springer"
        " 2009, section 7.1.2 (gravity's potential), linearised about the recipe's direction"
    )
    scope = Scope.ARM
    family = Family.GRAVITY
    prior_odds = RARE
    seen_in = "runs of a joint whose axis is upright, and of others in several postures"
    look_alikes = ("zero_offset", "counterbalance", "coupling", "spring")

    def parameters(self, robot: Robot, number: int) -> tuple[Parameter, ...]:
        return (
            Parameter("x", "rad", "turn of the base about its x axis", "tilt x", 0.02, -0.5, 0.5),
            Parameter("y", "rad", "turn of the base about its y axis", "tilt y", -0.015, -0.5, 0.5),
            *(
                Parameter(
                    f"{part}{n}",
                    "A",
                    f"load that link {n}'s own moment gives upright joint {n}",
                    f"tilt {part}{n}",
                    0.01,
                )
                for n in _uprights(robot)
                for part in ("cos", "sin")
            ),
        )

    def shapes(self, robot: Robot, number: int) -> tuple[Shape, ...]:
        meaning = "gain of an upright joint over that of the next joint with a load, which no other current tells"
        return (Shape("waist", "1", meaning, -30.0, 30.0, 1.0, starts=RATIOS),) if _uprights(robot) else ()

    def formula_in(self, robot: Robot, number: int, joint: int) -> str:
        if joint not in _uprights(robot):
            return self.formula
        return f"waist * ({self.formula}) + cos{joint} * cos(q) + sin{joint} * sin(q)"


def _uprights(robot: Robot) -> tuple[int, ...]:
    return tuple(
        joint.number for joint in robot.joints if joint.is_revolute and load_refusal(robot, joint.number) is not None
    )
