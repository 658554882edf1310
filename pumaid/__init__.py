"""pumaid: learn from logged motions what a robot arm's motor currents are spent on."""

__version__ = "0.1.0"
