"""MATLAB: one function file, for Simulink's MATLAB Function block too."""

from typing import ClassVar

from pumaid.exports.base import SourceForm


class Matlab(SourceForm):
    """Runs in Octave as well, and needs no toolbox."""

    templates = ("model.m.txt",)
    names: ClassVar = {
        "q": "q({i})",
        "v": "abs(v)",
        "shaft": "v",
        "load": "load({i})",
        "drawn": "(load({i}) + base)",
        "load_": "load({m})",
        "slope_": "slope(c, z, moment, {i}, {m})",
        "across": "across(c, z, moment, {i})",
        "tilt_x": "tilt(c, z, moment, {i}, 1)",
        "tilt_y": "tilt(c, z, moment, {i}, 2)",
    }
    power = "power"
    first = 1
    brackets = ("[", "]", ";")
