"""What ``pumaid plan`` is asked: a whole experiment, the runs that show one effect, or what a given plan promises."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import rich_click as click

if TYPE_CHECKING:
    from pumaid.design.prior import Setup
    from pumaid.records import Estimate, Plan
    from pumaid.robot import Robot

#: Sizes of an effect, SI, between which there is something to plan for.
_LEAST, _MOST = 1e-12, 1e9
#: Notes that ask for attention where a given plan is looked at.
ATTENTION = ("plan-strikes", "plan-lacks", "plan-dark", "plan-unusable")


@dataclass(frozen=True, slots=True)
class Ask:
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
    recipe: Path | None = None

    @property
    def shapes_a_plan(self) -> bool:
        """Whether a whole plan is asked to be other than by default."""
        given = (self.minutes, self.speeds, self.postures, self.replicates)
        return self.criterion != "geometric" or any(one is not None for one in given)


def listed(count: int | None = None) -> Callable[..., tuple[float, ...] | None]:
    """A click callback that reads numbers with commas between, `count` of them where that is given."""

    def read(_: click.Context, __: click.Parameter, text: str | None) -> tuple[float, ...] | None:
        if text is None:
            return None
        try:
            found = tuple(float(part) for part in text.split(","))
        except ValueError:
            raise click.BadParameter(f"{text!r} is not a list of numbers such as 0.1,0.3,0.8") from None
        if count is not None and len(found) != count:
            raise click.BadParameter(f"{text!r} has {len(found)} numbers, not {count}")
        return found

    return read


def check_together(ask: Ask, given: Path | None) -> None:
    """Refuse options that do not go together.

    Parameters
    ----------
    ask
        The options.
    given
        The plan that ``--check`` names.
    """
    pairs = (
        (ask.against is not None and ask.wanted is None, "--against goes with --for"),
        (ask.size is not None and ask.wanted is None, "--size goes with --for"),
        (
            ask.size is not None and ask.against is not None and bool(ask.logs),
            "--size goes without --logs where there is a rival: in logs an effect has the size that it has",
        ),
        (bool(ask.logs) and ask.wanted is None, "--logs goes with --for"),
        (given is not None and ask.wanted is not None, "--check looks at a plan; --for makes one"),
        (given is not None and ask.shapes_a_plan, "--check looks at a plan; it has its time, speeds and passes"),
        (bool(ask.logs) and ask.shapes_a_plan, "--for with --logs adds runs; options of a whole plan have no use"),
        (ask.wanted is not None and (ask.payload or ask.tilt) is not None, "--for plans for the arm as it stands"),
    )
    for is_wrong, told in pairs:
        if is_wrong:
            raise click.UsageError(told)


def setup_of(ask: Ask) -> Setup:
    """Tilt (deg in the option) and payload."""
    from pumaid.design.prior import Setup
    from pumaid.units import factor

    payload = None
    if ask.payload is not None:
        mass, x, y, z = ask.payload
        payload = (mass, x, y, z)
    tilt = None if ask.tilt is None else (ask.tilt[0] * factor("deg"), ask.tilt[1] * factor("deg"))
    return Setup(tilt, payload)


def planned(robot: Robot, ask: Ask, tell: Callable[[str], None]) -> Plan:
    """The plan that is asked for.

    Parameters
    ----------
    robot
        The arm.
    ask
        The options.
    tell
        Called with a word on what is done.
    """
    from pumaid.design.plan import plan

    def whole() -> Plan:
        return plan(
            robot,
            minutes=ask.minutes,
            speeds=ask.speeds,
            postures_per_joint=ask.postures,
            replicates=ask.replicates,
            criterion=ask.criterion,
            prior=prior_of(robot, ask),
            setup=setup_of(ask),
            seed=ask.seed,
            tell=tell,
        )

    return whole() if ask.wanted is None else _for(robot, ask, whole, tell=tell)


def _for(robot: Robot, ask: Ask, whole: Callable[[], Plan], *, tell: Callable[[str], None]) -> Plan:
    from pumaid.choices import at_one_joint, spoken
    from pumaid.cli.reading import read_dataset, recipe_path
    from pumaid.verbs.decide import decide

    assert ask.wanted is not None
    _check_size(ask)
    wanted = spoken(ask.wanted, robot, option="--for")
    rival = None if ask.against is None else spoken(ask.against, robot, option="--against")
    at_one_joint(wanted, robot, "--for")  # what is refused is refused before the work
    logs = read_dataset(ask.logs, recipe_path(ask.recipe), robot=robot)[1] if ask.logs else None
    return decide(
        robot,
        wanted,
        against=rival,
        size=ask.size,
        ground=None if logs is not None else whole(),
        logs=logs,
        estimate=prior_of(robot, ask),
        seed=ask.seed,
        tell=tell,
    )


def _check_size(ask: Ask) -> None:
    """Refuse a size with which no forecast can be made."""
    from pumaid.errors import ModelError, Where

    if ask.size is None or _LEAST <= abs(ask.size) <= _MOST:
        return
    what = f"no arm has an effect of the size {ask.size:g}"
    mend = f"give a number other than 0, up to {_MOST:g} and no smaller than {_LEAST:g}"
    raise ModelError("plan-impossible", what, Where(field=f"--for {ask.wanted}"), mend)


def checked(robot: Robot, path: Path, ask: Ask, *, tell: Callable[[str], None]) -> Plan:
    """What a given plan promises, with notes on what asks for attention.

    Parameters
    ----------
    robot
        The arm.
    path
        The plan.
    ask
        The options.
    tell
        Called with a word on what is done.
    """
    from pumaid.design.plan import check_plan
    from pumaid.io.plan import read_plan

    given = read_plan(path, robot)
    return check_plan(robot, given, prior=prior_of(robot, ask), setup=setup_of(ask), seed=ask.seed, tell=tell)


def prior_of(robot: Robot, ask: Ask) -> Estimate | None:
    """The earlier model of ``--prior``, refused where it is of another arm."""
    if ask.prior is None:
        return None
    from pumaid.cli.reading import check_model, read_known_model

    estimate = read_known_model(ask.prior)
    check_model(estimate, robot, (ask.recipe, ()))
    return estimate


def recipe_as_set_up(robot: Robot, recipe: Path | None, ask: Ask) -> str | None:
    """The recipe's text with gravity as a tilted base sees it; None without a tilt.

    Parameters
    ----------
    robot
        The arm as it stands.
    recipe
        The command's argument.
    ask
        The options.
    """
    if ask.tilt is None:
        return None
    from pumaid.cli.reading import recipe_path
    from pumaid.io.recipe_gravity import with_gravity

    return with_gravity(recipe_path(recipe), setup_of(ask).robot(robot).gravity)


def needs_attention(found: Plan) -> bool:
    """Whether a given plan strikes something, leaves something in the dark, or lacks what diagnosis needs."""
    slugs: Sequence[str] = [note.slug for note in found.notes]
    return any(slug in ATTENTION for slug in slugs)
