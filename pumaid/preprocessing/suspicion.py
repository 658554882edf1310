"""Logs that do not mean what the recipe says: wrong units, swapped columns, dead currents."""

from __future__ import annotations

from pumaid.errors import LogError, Note
from pumaid.preprocessing import doubts, signals
from pumaid.preprocessing.tally import Tally


def suspicions(tally: Tally) -> tuple[list[LogError], list[Note]]:
    """What the sums of a whole stream tell: faults that must be refused, and doubts.

    Parameters
    ----------
    tally
        Of all logs of one robot.

    Returns
    -------
    faults, notes
        In the order in which a user should look at them: units first, since they cause most of the rest.
    """
    found: list[LogError | Note] = [*doubts.of_units(tally)]
    if not any(isinstance(item, LogError) for item in found):
        found += [
            *doubts.of_limits(tally),
            *signals.of_velocity(tally),
            *signals.of_position(tally),
            *signals.of_current(tally),
            *doubts.of_order(tally),
        ]
        found += doubts.of_rest(tally)
    return [item for item in found if isinstance(item, LogError)], [item for item in found if isinstance(item, Note)]
