"""C99: a header and a source file, for controllers."""

from __future__ import annotations

from collections.abc import Mapping

from pumaid.exports.base import Form, Subject, rendered
from pumaid.exports.source_code import LanguageSyntax, context

#: How each function of a formula is called.
FUNCTIONS = {"sin": "sin", "cos": "cos", "exp": "exp", "sqrt": "sqrt", "abs": "fabs", "max": "fmax"} | {
    "sign": "(({} > 0.0) - ({} < 0.0))"
}


def _quantities(joint: int, joints: int) -> Mapping[str, str]:
    i = joint - 1
    named = {
        "q": f"q[{i}]",
        "v": "fabs(v)",
        "shaft": "v",
        "load": f"at->load[{i}]",
        "drawn": f"(at->load[{i}] + base)",
        "across": f"across(at, {i})",
    }
    named |= {f"load_{m + 1}": f"at->load[{m}]" for m in range(joints)}
    named |= {f"slope_{m + 1}": f"slope(at, {i}, {m})" for m in range(joints)}
    return named | {"tilt_x": f"tilt(at, {i}, 0)", "tilt_y": f"tilt(at, {i}, 1)"}


class C(Form):
    """Nothing is allocated and no data changes, so that it runs in an interrupt and on several arms at once."""

    title = "C99 header and source: gravity, friction and their sum, without allocation"
    suffixes = (".h", ".c")

    def texts(self, subject: Subject) -> dict[str, str]:
        values = context(
            subject, LanguageSyntax(FUNCTIONS, "call", _quantities, ("{", "}", ",")), left_out=self.left_out(subject)
        )
        return {suffix: rendered(f"model{suffix}", **values) for suffix in self.suffixes}
