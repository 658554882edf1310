"""Virtual arms with hidden physics, for judging a diagnosis blind.

Gravity and motion come from MuJoCo; friction, drives, sensors, noise and the detection limits are written here.
Nothing is shared with the program under test: it is only called, by `program`, the way its command line calls it.
"""
