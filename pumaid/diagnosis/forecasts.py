"""What adding a finding will do to runs that were not fitted."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

from pumaid.diagnosis.candidates import Together
from pumaid.diagnosis.cross_validation import rmse_of
from pumaid.diagnosis.records import ADD, DOUBTFUL, Finding
from pumaid.effect_spec import EffectTerm, marked
from pumaid.errors import ModelError
from pumaid.estimation.fit import Fit
from pumaid.estimation.gls import refit, releveled, with_errors
from pumaid.estimation.nonlinear import check_better
from pumaid.joint_bins import JointBins

#: Refits until effects of the load have the loads that they leave.
LOAD_ROUNDS = 4


def with_effect(before: Fit, term: EffectTerm) -> Fit | None:
    """A fit with one more effect, whose loads are those that it has itself; None where it goes astray."""
    more = term.effect.terms if isinstance(term.effect, Together) else (term,)
    model = before.model.with_effects(marked([*before.model.effects, *more]))
    with suppress(ModelError):
        after = releveled(refit(before, model, is_renewed=True))
        places, robot = range(len(before.model.effects), len(model.effects)), model.robot
        sized = [model.effects[place].searched(robot).at({}, after.sizes(place).tolist()) for place in places]
        model = model.with_effects([*before.model.effects, *sized])
        for _ in range(LOAD_ROUNDS if model.needs_loads() else 1):
            after = refit(after, model)
        # Of what only rescales a load, such steps take any size; then loads move with what makes them.
        after = with_errors(after) if any(part.needs_loads for part in more) else after
        check_better({joint: row.rmse for joint, row in before.by_bin.items()}, after, [term.effect.name])
        return after
    return None


def forecast(finding: Finding, before: Fit, after: Fit | None, *, unseen: Sequence[JointBins]) -> Finding:
    """A finding with the error of runs that were not fitted, without and with it; doubtful where that does not fall."""
    if after is None:
        return replace(finding, verdict=DOUBTFUL, reason="a fit with it goes astray")
    without, (rmse, error) = rmse_of(before, unseen)[0], rmse_of(after, unseen)
    if rmse >= without and finding.verdict == ADD:
        finding = replace(finding, verdict=DOUBTFUL, reason="it does not lower the error of runs that were held out")
    return replace(finding, rmse_heldout_before=without, rmse_heldout_after=rmse, forecast=rmse, forecast_error=error)
