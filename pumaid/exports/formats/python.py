"""Python: one module that needs numpy and nothing else."""

from __future__ import annotations

from collections.abc import Mapping

from pumaid.exports.base import Form, Subject, rendered
from pumaid.exports.source_code import LanguageSyntax, context

#: How each function of a formula is called.
FUNCTIONS = {name: f"np.{name}" for name in ("sin", "cos", "exp", "sqrt", "abs", "sign")} | {"max": "np.maximum"}


def _quantities(joint: int, joints: int) -> Mapping[str, str]:
    i = joint - 1
    named = {
        "q": f"q[..., {i}]",
        "v": "np.abs(v)",
        "shaft": "v",
        "load": f"at.load[..., {i}]",
        "drawn": f"(at.load[..., {i}] + base)",
    }
    named |= {f"load_{m + 1}": f"at.load[..., {m}]" for m in range(joints)}
    named |= {f"slope_{m + 1}": f"_slope(at, {i}, {m})" for m in range(joints)}
    return named | {"across": f"_across(at, {i})", "tilt_x": f"_tilt(at, {i}, 0)", "tilt_y": f"_tilt(at, {i}, 1)"}


class Python(Form):
    """Functions of one posture or of many at once."""

    title = "Python module, numpy only: gravity, friction and their sum, for one posture or many"
    suffixes = (".py",)

    def texts(self, subject: Subject) -> dict[str, str]:
        values = context(
            subject, LanguageSyntax(FUNCTIONS, "**", _quantities, ("[", "]", ",")), left_out=self.left_out(subject)
        )
        return {".py": rendered("model.py.txt", **values)}
