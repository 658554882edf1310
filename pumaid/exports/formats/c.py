"""C99: a header and a source file, for controllers."""

from typing import ClassVar

from pumaid.exports.base import SourceForm


class C(SourceForm):
    """Nothing is allocated and no data changes, so that it runs in an interrupt and on several arms at once."""

    templates = ("model.h", "model.c")
    names: ClassVar = {
        "abs": "fabs",
        "max": "fmax",
        "sign": "SIGN",
        "q": "q[{i}]",
        "v": "fabs(v)",
        "shaft": "v",
        "load": "at->load[{i}]",
        "drawn": "(at->load[{i}] + base)",
        "load_": "at->load[{m}]",
        "slope_": "slope(at, {i}, {m})",
        "across": "across(at, {i})",
        "tilt_x": "tilt(at, {i}, 0)",
        "tilt_y": "tilt(at, {i}, 1)",
    }
    power = "pow"
    brackets = ("{", "}", ",")
