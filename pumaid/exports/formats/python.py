"""Python: one module that needs numpy and nothing else."""

from typing import ClassVar

from pumaid.exports.base import SourceForm


class Python(SourceForm):
    """Functions of one posture or of many at once."""

    templates = ("model.py.txt",)
    names: ClassVar = {name: f"np.{name}" for name in ("sin", "cos", "exp", "sqrt", "abs", "sign")} | {
        "max": "np.maximum",
        "q": "q[..., {i}]",
        "v": "np.abs(v)",
        "shaft": "v",
        "load": "at.load[..., {i}]",
        "drawn": "(at.load[..., {i}] + base)",
        "load_": "at.load[..., {m}]",
        "slope_": "_slope(at, {i}, {m})",
        "across": "_across(at, {i})",
        "tilt_x": "_tilt(at, {i}, 0)",
        "tilt_y": "_tilt(at, {i}, 1)",
    }
