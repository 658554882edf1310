"""All hidden laws by the names of the effects that a model may have."""

from __future__ import annotations

from pumaid.simulation.hidden import clock, current, gravity, load, motion, position, speed

#: Name -> law; laws of the whole current last, in the order in which they act.
LAWS = {**speed.LAWS, **load.LAWS, **position.LAWS, **motion.LAWS, **clock.LAWS, **gravity.LAWS, **current.LAWS}
