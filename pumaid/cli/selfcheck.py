"""Does this installation work? A robot whose parameters are known is simulated, logged, identified and diagnosed."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pumaid.dataset import Dataset
    from pumaid.records import Estimate
    from pumaid.robot import Robot
    from pumaid.simulation import Truth

#: The arm, the seed of its making, minutes of its experiment, samples a second.
ARM, SEED, MINUTES, RATE = "pendulum2", 11, 4.0, 50.0
#: The effect that it hides, and where.
HIDDEN, JOINT = "ripple", 2
#: Standard errors that an estimate may be off: some twenty degrees of freedom give 5 once in 10,000 parameters.
FAR = 6.0


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that must work: its name, whether it did, what was seen, how long it took (s)."""

    name: str
    passed: bool
    text: str
    seconds: float


def self_check(tell: Callable[[str], None]) -> Iterator[Check]:
    """Run the checks, each on what the one before left; after the first that fails there are no more.

    Parameters
    ----------
    tell
        Called with the name of what is checked.
    """
    with tempfile.TemporaryDirectory() as scratch:
        bench: dict[str, object] = {}
        steps: tuple[tuple[str, Callable[[], str]], ...] = (
            ("simulate and write logs", lambda: _logged(Path(scratch), bench)),
            ("read and segment logs", lambda: _segmented(bench)),
            ("identify", lambda: _identified(bench)),
            ("diagnose", lambda: _diagnosed(bench)),
            ("draw", lambda: _drawn(Path(scratch))),
        )
        for name, step in steps:
            tell(name)
            begin = time.monotonic()
            with _judged() as told:
                told.append(step())
            passed = len(told) == 1
            yield Check(name, passed, told[-1], time.monotonic() - begin)
            if not passed:
                return


class Wrong(Exception):
    """Something came out otherwise than it must."""


@contextmanager
def _judged() -> Iterator[list[str]]:
    """A list of what was seen; what went wrong is told behind an empty first entry."""
    told: list[str] = []
    try:
        yield told
    except (Wrong, ArithmeticError, ImportError, LookupError, OSError, RuntimeError, TypeError, ValueError) as error:
        told[:] = ["", f"{type(error).__name__}: {error}"]


def _logged(folder: Path, bench: dict[str, object]) -> str:
    from pumaid.design.plan import plan
    from pumaid.io.recipe import read_recipe, shipped_recipes
    from pumaid.io.table import write_log
    from pumaid.simulation import Hidden, draw
    from pumaid.verbs.simulate import simulate

    robot = read_recipe(shipped_recipes()[ARM])
    truth = draw(robot, SEED).hiding([Hidden(HIDDEN, JOINT, {})])
    logs = list(simulate(robot, plan(robot, minutes=MINUTES), truth=truth, seed=SEED, rate=RATE))
    paths = [folder / "first.parquet", folder / "second.csv"]
    half = len(logs) // 2 or 1
    for path, some in zip(paths, (logs[:half], logs[half:]), strict=True):
        write_log(path, some, robot)
    bench |= {"robot": robot, "truth": truth, "paths": paths, "rows": sum(map(len, logs))}
    return f"{bench['rows']} rows as Parquet and CSV"


def _segmented(bench: dict[str, object]) -> str:
    from pumaid.io.table import LogReader
    from pumaid.verbs.segment import segment

    robot: Robot = bench["robot"]  # type: ignore[assignment]
    dataset = segment(LogReader(bench["paths"], robot), robot)  # type: ignore[arg-type]
    rows = sum(facts.rows for facts in dataset.files)
    if rows != bench["rows"]:
        raise Wrong(f"{rows} rows were read of {bench['rows']}")
    bench["evidence"] = dataset
    return f"{len(dataset.runs)} runs"


def _identified(bench: dict[str, object]) -> str:
    from pumaid.robot import EffectChoice
    from pumaid.verbs.identify import identify

    robot: Robot = bench["robot"]  # type: ignore[assignment]
    dataset: Dataset = bench["evidence"]  # type: ignore[assignment]
    truth: Truth = bench["truth"]  # type: ignore[assignment]
    known = truth.parameters()
    bench["estimate"] = identify(dataset, robot)
    whole = identify(dataset, robot, effects=[EffectChoice(HIDDEN, JOINT, {})])
    off = {
        one.name: abs(one.value - known[one.name]) / one.std_error
        for one in whole.values
        if one.value is not None and one.std_error and one.name in known
    }
    worst = max(off, key=lambda name: off[name])
    if off[worst] > FAR:
        raise Wrong(f"{worst} is {off[worst]:.1f} standard errors from the truth")
    return f"{len(off)} parameters within {off[worst]:.1f} standard errors of the truth"


def _diagnosed(bench: dict[str, object]) -> str:
    from pumaid.verbs.diagnose import diagnose

    robot: Robot = bench["robot"]  # type: ignore[assignment]
    dataset: Dataset = bench["evidence"]  # type: ignore[assignment]
    estimate: Estimate = bench["estimate"]  # type: ignore[assignment]
    found = [(one.effect, one.joint) for one in diagnose(estimate, dataset, robot).findings]
    if (HIDDEN, JOINT) not in found:
        raise Wrong(f"the hidden {HIDDEN} at joint {JOINT} was not found, but {found or 'nothing'}")
    return f"the hidden {HIDDEN} at joint {JOINT} is found"


def _drawn(folder: Path) -> str:
    import matplotlib as mpl

    mpl.use("Agg", force=True)
    from matplotlib import pyplot

    figure = pyplot.figure()
    figure.add_subplot().plot([0, 1])
    figure.savefig(folder / "page.png")
    pyplot.close(figure)
    return f"a picture of {(folder / 'page.png').stat().st_size} bytes"
