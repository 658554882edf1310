"""MATLAB: one function file, for Simulink's MATLAB Function block too."""

from __future__ import annotations

from collections.abc import Mapping

from pumaid.exports.base import Form, Subject, rendered
from pumaid.exports.source_code import LanguageSyntax, context

#: How each function of a formula is called.
FUNCTIONS = {name: name for name in ("sin", "cos", "exp", "sqrt", "abs", "sign", "max")}


def _quantities(joint: int, joints: int) -> Mapping[str, str]:
    named = {
        "q": f"q({joint})",
        "v": "abs(v)",
        "shaft": "v",
        "load": f"load({joint})",
        "drawn": f"(load({joint}) + base)",
    }
    named |= {f"load_{m}": f"load({m})" for m in range(1, joints + 1)}
    named |= {f"slope_{m}": f"slope(c, z, moment, {joint}, {m})" for m in range(1, joints + 1)}
    named |= {"across": f"across(c, z, moment, {joint})"}
    return named | {f"tilt_{axis}": f"tilt(c, z, moment, {joint}, {n})" for n, axis in enumerate("xy", start=1)}


class Matlab(Form):
    """Runs in Octave as well, and needs no toolbox."""

    title = "MATLAB function file (Octave too): gravity, friction and their sum of one posture"
    suffixes = (".m",)

    def texts(self, subject: Subject) -> dict[str, str]:
        values = context(
            subject, LanguageSyntax(FUNCTIONS, "^", _quantities, ("[", "]", ";")), left_out=self.left_out(subject)
        )
        return {".m": rendered("model.m.txt", **values)}
