"""A virtual robot: a truth that is known, and the logs or runs that it would leave.

Nothing here uses the effects that a model is fitted with: gravity comes from masses and potential energy, motion from
MuJoCo, and hidden effects have a table of their own.
"""

from pumaid.simulation.hidden_effects import Hidden
from pumaid.simulation.session import constant_run, simulate
from pumaid.simulation.virtual_robot import (
    BREAKAWAY,
    Constants,
    Friction,
    Links,
    Noise,
    Truth,
    constants,
    draw,
    gravity_load,
    links_of,
)

__all__ = [
    "BREAKAWAY",
    "Constants",
    "Friction",
    "Hidden",
    "Links",
    "Noise",
    "Truth",
    "constant_run",
    "constants",
    "draw",
    "gravity_load",
    "links_of",
    "simulate",
]
