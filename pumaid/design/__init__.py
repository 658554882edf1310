"""Experiment design: which runs tell most in the time that a robot has."""
