"""Sources: literature of the effects in the model, digests of the inputs, versions."""

from __future__ import annotations

from pumaid.effects import catalogue
from pumaid.reporting.context import ReportContext
from pumaid.reporting.sections import Content, Section
from pumaid.reporting.table import Table


class Sources(Section):
    """What is needed to repeat the identification."""

    order, title = 90, "Sources and versions"

    def content(self, context: ReportContext) -> Content:
        titles: dict[str, list[str]] = {}
        for name in dict.fromkeys(name.split(".")[0] for name in context.estimate.names):
            if name in catalogue():
                titles.setdefault(catalogue()[name].source, []).append(catalogue()[name].title)
        fitted, compared = context.estimate.logs, context.comparison.logs
        rows = [["recipe", context.robot.origin or "in memory", context.robot.digest or "-"]]
        rows += [["fitted log", name, digest] for name, digest in fitted.items()]
        rows += [["compared log", name, digest] for name, digest in compared.items() if digest not in fitted.values()]
        inputs = Table("Inputs", ("kind", "file", "SHA-256"), rows, words=(0, 1, 2))
        return {"sources": titles, "inputs": inputs, "model_version": context.estimate.version}
