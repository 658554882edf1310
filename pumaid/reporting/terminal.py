"""What the terminal shows of a diagnosis and of a residual budget: sentences first, then the numbers behind them."""

from __future__ import annotations

from pumaid.diagnosis.records import ADEQUATE, UNEXPLAINED_JOINT, Diagnosis, JointDiagnosis
from pumaid.estimation.comparison import Budget, BudgetPart, Comparison
from pumaid.reporting import diagnosis_text as sentences
from pumaid.reporting.table import Paragraph, Table
from pumaid.reporting.tables import candidate_table, deciding_runs_table, limit_table, shape_table
from pumaid.reporting.text import (
    BUDGET_CAPTION,
    PART_NAMES,
    budget_limit_sentences,
    budget_sentence,
    is_noise_only,
    noise_only_sentence,
    part_share,
)
from pumaid.robot import Robot

#: Characters of a bar that is the whole residual; what fills it for noise and for a significant part.
BAR, NOISE, SIGNIFICANT = 40, "░", "█"

EMPTY = Paragraph("")


def diagnosis_parts(diagnosis: Diagnosis, robot: Robot, *, units: str = "rad") -> list[Paragraph | Table]:
    """Everything that is said of a diagnosis, part by part; angles in `units` (``rad`` or ``deg``)."""
    parts: list[Paragraph | Table] = [Paragraph(sentences.headline(diagnosis, robot), style="bold")]
    for number, finding in enumerate(diagnosis.findings, start=1):
        parts += [EMPTY, Paragraph(f"{number}. {sentences.finding_title(finding, robot)}", style="bold")]
        texts = sentences.finding_sentences(finding, diagnosis, robot, units=units)
        parts += [Paragraph(text, 3) for text in [*texts, sentences.decision_sentence(finding)] if text]
        if finding.command:
            parts += [Paragraph("Add it with:", 3), Paragraph(finding.command, 5, is_command=True)]
    for joint in diagnosis.joints:
        parts += _unexplained(joint, robot, units) if joint.verdict == UNEXPLAINED_JOINT else []
    for text in sentences.other_sentences(diagnosis, robot):
        parts += [EMPTY, Paragraph(text)]
    rest = [*sentences.adequate_sentences(diagnosis, robot), *sentences.suspect_sentences(diagnosis)]
    rest += sentences.applied_sentences(diagnosis, robot)
    parts += [EMPTY, *map(Paragraph, rest)] if rest else []
    limits = sentences.weaknesses(diagnosis, robot)
    parts += [EMPTY, Paragraph("Limits of this diagnosis:")] if limits else []
    parts += [Paragraph(f"- {text}", 2) for text in limits]
    quiet = [joint.joint for joint in diagnosis.joints if joint.verdict == ADEQUATE]
    tables = [candidate_table(diagnosis, robot)]
    tables += [deciding_runs_table(finding, robot, units) for finding in diagnosis.findings]
    tables += [limit_table(diagnosis, robot, units=units, joints=quiet)] if quiet else []
    for table in tables:
        parts += [] if table is None else [EMPTY, table]
    return parts


def _unexplained(joint: JointDiagnosis, robot: Robot, units: str) -> list[Paragraph | Table]:
    title = Paragraph(sentences.unexplained_title(joint, robot), style="bold")
    texts = sentences.unexplained_sentences(joint, units)
    table = [shape_table(joint.unexplained, units)] if joint.unexplained is not None else []
    return [EMPTY, title, *(Paragraph(text, 3) for text in texts), *table]


def budget_parts(comparison: Comparison, robot: Robot) -> list[Paragraph]:
    """A sentence and bars for each joint whose residual is more than noise, then the other joints."""
    parts = []
    for score in comparison.joints:
        if score.budget is not None and not is_noise_only(score.budget):
            parts += [Paragraph(budget_sentence(score, robot)), Paragraph(budget_bars(score.budget), 2), EMPTY]
    parts += [Paragraph(BUDGET_CAPTION, style="dim"), EMPTY] if parts else []
    noise_only, limits = noise_only_sentence(comparison, robot), budget_limit_sentences(comparison)
    parts += [Paragraph(noise_only)] if noise_only else []
    parts += [Paragraph("What these runs cannot separate:")] if limits else []
    parts += [Paragraph(f"- {text}", 2) for text in limits]
    head = [EMPTY, Paragraph("Residual budget", style="bold")]
    return [*head, *parts] if parts else []


def budget_bars(budget: Budget) -> str:
    """Each part of a residual with its share and a bar, a line each."""
    parts = [part for part in budget.parts if part.mean_square > 0.0]
    width = max((len(PART_NAMES[part.name]) for part in parts), default=0)
    return "\n".join(_bar(budget, part, width) for part in parts)


def _bar(budget: Budget, part: BudgetPart, width: int) -> str:
    share = part_share(budget, part)
    mark = NOISE if part.name.startswith("noise") or not part.is_more else SIGNIFICANT
    return f"{PART_NAMES[part.name]:<{width}}  {100.0 * share:5.1f} %  {mark * max(round(BAR * share), 1)}"
