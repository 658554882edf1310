"""Physics that a virtual robot has and the paper's model has not, in code of its own.

Nothing here is shared with the effects that a model is fitted with: the laws are written a second time, most of them
exactly where the model has a linear form, and gravity comes from the virtual arm's own masses.
"""

from pumaid.simulation.hidden.catalogue import LAWS
from pumaid.simulation.hidden.law import Hidden
from pumaid.simulation.hidden.sizes import sized
from pumaid.simulation.hidden.spoken import parse
from pumaid.simulation.hidden.state import Instants, State
from pumaid.simulation.hidden.total import bent, delays, felt, total

__all__ = ["LAWS", "Hidden", "Instants", "State", "bent", "delays", "felt", "parse", "sized", "total"]
