"""Which physical effect a model misses, with the dataset, the rivals, and the run that would decide."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np

from pumaid import __version__
from pumaid.dataset import Dataset, Run
from pumaid.diagnosis.account import Account
from pumaid.diagnosis.stepwise import Stepwise, silent
from pumaid.diagnosis.suspect import Suspect
from pumaid.effect_spec import check_known, terms_of
from pumaid.effects import Effect, catalogue
from pumaid.errors import LogError, Where
from pumaid.model import Model
from pumaid.preprocessing.hold_out import held_out_otherwise
from pumaid.preprocessing.options import CONSTANT
from pumaid.records import Campaign, Diagnosis, Estimate
from pumaid.results.model_file import check_same_recipe, model_digest
from pumaid.robot import Robot

#: Runs at constant speed from which a joint's strokes are not needed.
STEADY = 12


def diagnose(
    estimate: Estimate,
    dataset: Dataset,
    robot: Robot,
    *,
    suspects: Sequence[str] = (),
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Try every effect of the catalogue at every joint, and say what is missing.

    Bins of all runs are whitened by the noise that repeated runs show; each candidate is scored beside the fitted
    model, all else refitted; its chance is that of the best of the whole catalogue when the signs of whole runs are
    flipped; it must then predict runs that were left out. What passes is added, and all is looked at again.

    Parameters
    ----------
    estimate
        The model; what it already has is not sought again.
    dataset
        Runs of the same arm; those held out are only used to judge.
    robot
        By the recipe that the model was made with.
    suspects
        Names of extra columns that `dataset` carries.
    progress
        Called with a word on what is done.

    Returns
    -------
    diagnosis
        Same input, same diagnosis.

    Raises
    ------
    ModelError [model-other-recipe]
        The model was identified with another recipe.
    ModelError [unknown-effect]
        It holds an effect that the catalogue does not have.
    LogError [no-runs]
        There is no run to look at.
    """
    check_same_recipe(estimate, robot)
    check_known(estimate.effects)
    runs = _looked_at([run for run in dataset.runs if not run.heldout])
    if not runs:
        where = Where(file=dataset.files[0].name if dataset.files else None)
        raise LogError("no-runs", "there is no run to diagnose", where, "see why with: pumaid segment LOGS --rejects")
    search = Stepwise(
        Model.of_runs(robot, [run for run in dataset.runs if not run.heldout]),
        runs,
        given=terms_of(estimate.effects),
        campaign=Campaign.of(dataset.runs),
        unseen=tuple(run for run in dataset.runs if run.heldout),
        effects=[*catalogue().values(), *_suspects(dataset, suspects)],
        tell=progress or silent,
    )
    search.run()
    account = Account(search, dataset)
    return Diagnosis(
        robot=robot.name,
        joints=account.joints(),
        findings=account.findings(),
        model=model_digest(estimate),
        logs={facts.name: facts.digest for facts in dataset.files},
        notes=(*held_out_otherwise(estimate, dataset), *account.notes()),
        recipe_digest=robot.digest,
        version=__version__,
    )


def _looked_at(runs: Sequence[Run]) -> tuple[Run, ...]:
    """Runs without the strokes of joints that have runs at constant speed enough.

    In a stroke the model misses more, by all that a change of speed does; a few of them, left by moves between
    postures, would pass for missing physics.
    """
    steady = Counter(run.joint for run in runs if run.kind == CONSTANT)
    return tuple(run for run in runs if run.kind == CONSTANT or steady[run.joint] < STEADY)


def _suspects(dataset: Dataset, names: Sequence[str]) -> list[Effect]:
    """An effect for each suspected column, scaled by what it does in these runs."""
    out: list[Effect] = []
    for name in names:
        place = dataset.extra.index(name)
        every = [run.bins.extra[:, place] for run in dataset.runs if run.bins.extra is not None]
        values = np.concatenate(every) if every else np.zeros(1)
        values = values[np.isfinite(values)]
        middle, spread = (float(values.mean()), float(values.std())) if len(values) else (0.0, 0.0)
        out.append(Suspect(name, place, middle=middle, spread=spread))
    return out
