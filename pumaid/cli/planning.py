"""What ``pumaid plan`` is asked, what answers it, and the files that it writes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import rich_click as click

if TYPE_CHECKING:
    from pumaid.design.prior import Setup
    from pumaid.estimate import Estimate
    from pumaid.robot import Robot
    from pumaid.trajectory import Plan

#: Forms of a plan; the last two are programs, which are not read back.
PLAN_FORMS = ("yaml", "csv", "urscript", "ros2")
#: Notes that ask for attention where a given plan is checked.
ATTENTION = ("plan-strikes", "plan-lacks", "plan-dark", "plan-unusable")


@dataclass(frozen=True, slots=True)
class PlanOptions:
    """The options of ``pumaid plan`` that shape a plan."""

    minutes: float | None
    speeds: tuple[float, ...] | None
    postures: int | None
    replicates: int | None
    criterion: str
    prior: Path | None
    payload: tuple[float, ...] | None
    tilt: tuple[float, ...] | None
    wanted: str | None
    against: str | None
    size: float | None
    logs: tuple[str, ...]
    seed: int
    recipe: Path | None

    @property
    def setup(self) -> Setup:
        """Tilt (deg in the option) and payload."""
        from pumaid.design.prior import Setup
        from pumaid.units import factor

        tilt = None if self.tilt is None else (self.tilt[0] * factor("deg"), self.tilt[1] * factor("deg"))
        return Setup(tilt, None if self.payload is None else self.payload[:4])  # type: ignore[arg-type]

    def refuse_contradictions(self, given: Path | None) -> None:
        """Refuse options that do not go together; `given` is the plan that ``--check`` names."""
        shapes = (self.minutes, self.speeds, self.postures, self.replicates)
        shapes_a_plan = self.criterion != "geometric" or any(value is not None for value in shapes)
        rules = (
            (self.against is not None and self.wanted is None, "--against goes with --for"),
            (self.size is not None and self.wanted is None, "--size goes with --for"),
            (
                self.size is not None and self.against is not None and bool(self.logs),
                "--size goes without --logs where there is a rival: in logs an effect has the size that it has",
            ),
            (bool(self.logs) and self.wanted is None, "--logs goes with --for"),
            (given is not None and self.wanted is not None, "--check looks at a plan; --for makes one"),
            (given is not None and shapes_a_plan, "--check looks at a plan; it has its time, speeds and passes"),
            (bool(self.logs) and shapes_a_plan, "--for with --logs adds runs; options of a whole plan have no use"),
            (self.wanted is not None and (self.payload or self.tilt) is not None, "--for plans for the bare arm"),
        )
        for is_wrong, message in rules:
            if is_wrong:
                raise click.UsageError(message)


def numbers(count: int | None = None) -> Callable[..., tuple[float, ...] | None]:
    """A click callback that reads numbers with commas between, `count` of them where that is given."""

    def read(_: click.Context, __: click.Parameter, text: str | None) -> tuple[float, ...] | None:
        if text is None:
            return None
        try:
            values = tuple(float(part) for part in text.split(","))
        except ValueError:
            raise click.BadParameter(f"{text!r} is not a list of numbers such as 0.1,0.3,0.8") from None
        if count is not None and len(values) != count:
            raise click.BadParameter(f"{text!r} has {len(values)} numbers, not {count}")
        return values

    return read


def make_plan(robot: Robot, options: PlanOptions, given: Path | None, *, tell: Callable[[str], None]) -> Plan:
    """The plan that is asked for, or the one at `given` with what it promises."""
    from pumaid.design.plan import check_plan, plan
    from pumaid.io.plan_file import read_plan

    if options.wanted is not None:
        return _plan_for(robot, options, tell)
    read = None if given is None else read_plan(given, robot)
    shared: dict[str, Any] = {"setup": options.setup, "seed": options.seed, "tell": tell}
    shared["prior"] = _prior(options)
    if read is not None:
        return check_plan(robot, read, **shared)
    return plan(
        robot,
        minutes=options.minutes,
        speeds=options.speeds,
        postures_per_joint=options.postures,
        replicates=options.replicates,
        criterion=options.criterion,
        **shared,
    )


def _plan_for(robot: Robot, options: PlanOptions, tell: Callable[[str], None]) -> Plan:
    """The runs that show an effect, or tell it from a rival."""
    from pumaid.diagnosis.plan_for_effect import plan_for_effect
    from pumaid.effect_spec import parse_effect
    from pumaid.experiment import Experiment

    recipe = Experiment(recipe=options.recipe).recipe_path
    alone = replace(options, wanted=None, against=None, size=None, logs=())
    return plan_for_effect(
        robot,
        parse_effect(options.wanted or "", robot, option="--for"),
        against=None if options.against is None else parse_effect(options.against, robot, option="--against"),
        size=options.size,
        whole=lambda: make_plan(robot, alone, None, tell=tell),
        dataset=Experiment(options.logs, recipe).dataset() if options.logs else None,
        prior=_prior(options),
        seed=options.seed,
        tell=tell,
    )


def _prior(options: PlanOptions) -> Estimate | None:
    """The earlier model of ``--prior``, refused where it is of another arm."""
    if options.prior is None:
        return None
    from pumaid.experiment import Experiment

    return Experiment(recipe=options.recipe).model(options.prior)


def plan_suffix(form: str) -> str:
    """How the name of a plan's file ends: ``.yaml``, ``.csv``, ``.script`` or ``.ros2.yaml``."""
    from pumaid.design.robot_programs import PROGRAMS

    return PROGRAMS[form][0] if form in PROGRAMS else f".{form}"


def formed(plan: Plan, robot: Robot, form: str) -> str:
    """A plan as text in one of `PLAN_FORMS`; an arm that the form cannot move is refused (program-other-robot)."""
    from pumaid.design.robot_programs import PROGRAMS
    from pumaid.io.plan_file import plan_text

    return PROGRAMS[form][1](plan, robot) if form in PROGRAMS else plan_text(plan, robot, format=form)


def write_plan(path: Path, plan: Plan, robot: Robot, *, form: str, tilted: tuple[Path, PlanOptions] | None) -> None:
    """Write a plan in one of `PLAN_FORMS`, and the recipe with gravity as a tilted base sees it."""
    from pumaid.cli.output import remark
    from pumaid.experiment import Experiment
    from pumaid.io.recipe import with_gravity
    from pumaid.io.write import write_file

    if tilted is not None:
        beside, options = tilted
        recipe = Experiment(recipe=options.recipe).recipe_path
        write_file(beside, with_gravity(recipe, options.setup.robot(robot).gravity))
        remark(f"recipe of the tilted arm written to {beside}: simulate and identify these runs with it")
    write_file(path, formed(plan, robot, form))
    remark(f"plan written to {path}")


def draw_plan(path: Path, plan: Plan, robot: Robot) -> None:
    """Draw the arm in every posture to `path`, and the schedule beside it (``NAME-timetable.png``)."""
    from pumaid.cli.output import picture_form, remark
    from pumaid.io.write import write_file
    from pumaid.reporting.figures.arm import posture_figure
    from pumaid.reporting.figures.runs import timetable_figure
    from pumaid.trajectory import run_times

    form, beside = picture_form(path), path.with_name(f"{path.stem}-timetable{path.suffix}")
    write_file(path, posture_figure(plan, robot).file(form))
    write_file(beside, timetable_figure(plan, robot, run_times(robot, plan)).file(form))
    remark(f"pictures written to {path} and {beside}")


def print_plan(plan: Plan, robot: Robot, *, form: str, as_json: bool, is_piped: bool) -> None:
    """Print a plan: as one JSON document, as its file's text where that goes to standard output, or as tables."""
    from pumaid.cli.output import content, document, notes, table
    from pumaid.io.plan_file import plan_document
    from pumaid.reporting.run_tables import plan_tables

    notes(plan.notes)
    if as_json:
        document(plan_document(plan, robot))
    elif is_piped:
        content(formed(plan, robot, form).rstrip("\n") + "\n")
    else:
        for item in plan_tables(plan, robot):
            table(item)
            table("")
