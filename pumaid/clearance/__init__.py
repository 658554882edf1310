"""Whether the arm keeps clear of forbidden boxes and of itself along a whole path, not only at samples of it."""

from pumaid.clearance.clearance import Clearance
from pumaid.clearance.paths import Route, straight, trapezoids

__all__ = ["Clearance", "Route", "straight", "trapezoids"]
