"""A virtual robot: a truth that is known, and the logs or runs that it would leave.

Nothing here uses the effects that a model is fitted with: gravity comes from masses and potential energy, motion from
MuJoCo, and hidden effects have a table of their own.
"""

from pumaid.simulation import table1
from pumaid.simulation.hidden_effects import Hidden
from pumaid.simulation.monte_carlo import Bench
from pumaid.simulation.random_robot import draw
from pumaid.simulation.session import simulate
from pumaid.simulation.virtual_robot import Constants, Friction, Links, Noise, Truth, gravity_load

__all__ = [
    "Bench",
    "Constants",
    "Friction",
    "Hidden",
    "Links",
    "Noise",
    "Truth",
    "draw",
    "gravity_load",
    "simulate",
    "table1",
]
