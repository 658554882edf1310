"""Findings as plain sentences, for an engineer first; the numbers stand in them, not instead of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pumaid.records import IDENTIFIED, NOT_IDENTIFIABLE, JointScore
from pumaid.reporting.numbers import amperes, percent
from pumaid.reporting.scores import ATTENTION, ROUNDING
from pumaid.reporting.story import Story
from pumaid.reporting.tables import is_absent
from pumaid.units import number

#: An error within this factor of the noise floor is at the floor: the floor itself is not known better.
AT_FLOOR = 1.1

#: An error below this share of the noise floor says that the floor holds more than noise: what drifts or warms up makes
#: repeats differ although the model, fitted to all of them, stands in their middle.
BELOW_FLOOR = 0.8

#: Predictions that differ by less than this share of the joint's RMSE are one current.
CALM = 0.2


def joint_sentence(story: Story, score: JointScore) -> str:
    """How well the model explains one joint's current, and whether there is more to explain."""
    title = story.title(score.joint)
    if score.rmse is None:
        return f"{title} never moves alone in these logs, so nothing is known of its error."
    words = f"{title}: {_explained(story, score)}; {amperes(score.rmse)} is left"
    if score.noise_floor is None:
        words += "."
    else:
        ratio = (score.rmse - ROUNDING) / max(score.noise_floor, ROUNDING)
        words += f", the noise floor is {amperes(score.noise_floor)}: {_verdict(ratio)}."
    if score.heldout is not None and score.heldout_runs < score.runs:
        words += f" On {plural(score.heldout_runs, 'run')} that were not fitted, {amperes(score.heldout)} is left."
    if score.undetermined:
        words += f" {plural(score.undetermined, 'run')} asked for more than the fitted logs could tell."
    return words


def _explained(story: Story, score: JointScore) -> str:
    """How much of what varies in a joint's current the model accounts for, or why there is nothing to account for."""
    if (score.rms or 0.0) <= ROUNDING:
        return "no current was measured"
    if score.explained is None:
        return "the measured current never changes"
    predicted = np.concatenate([one.predicted for one in story.comparison.of_joint(score.joint)])
    if float(np.ptp(predicted)) <= CALM * (score.rmse or 0.0):
        return "these runs ask for one and the same current, so there is no change to explain"
    if score.explained < 0.0:
        return "the model does worse than a constant current would"
    return f"the model explains {percent(score.explained)} of how the current changes"


def still_sentence(story: Story) -> str | None:
    """Which joints were never moved alone; None where all were."""
    still = [str(score.joint) for score in story.comparison.joints if score.rmse is None]
    if not still:
        return None
    return f"Joint{'s' * (len(still) > 1)} {listed(still)} never move{'s' * (len(still) == 1)} alone in these logs."


def noise_sentence(story: Story) -> str | None:
    """For which joints the noise floor is not known, and what to do; None where it is known of all."""
    blind = [score.joint for score in story.comparison.joints if score.rmse is not None and score.noise_floor is None]
    if not blind:
        return None
    everywhere = len(blind) == len(story.moving())
    of = "any joint" if everywhere else listed([f"joint {joint}" for joint in blind])
    return (
        f"No run of {of} is repeated, so how much of what is left is noise is not known:"
        " repeat a few runs (same posture, speed and direction) to learn it."
    )


def _verdict(ratio: float) -> str:
    if ratio < BELOW_FLOOR:
        return "repeated runs differ by more than the model leaves, so something changes from run to run"
    if ratio <= AT_FLOOR:
        return "nothing missing that repeated runs can show"
    if ratio <= ATTENTION:
        return "little more to explain"
    return f"{number(ratio, 2)} times the floor, so the model lacks something here"


def parameters_sentence(story: Story) -> str:
    """How many parameters are known, and how many are not."""
    values = [value for value in story.estimate.values if not is_absent(value)]
    known = sum(value.state == IDENTIFIED for value in values)
    unknown = sum(value.state == NOT_IDENTIFIABLE for value in values)
    words = f"{known} of {len(values)} parameters are identified"
    if unknown:
        words += f"; {plural(unknown, 'parameter')} cannot be told from these logs, for the reasons below the table"
    sums = len(story.estimate.combinations)
    if sums:
        words += f"; of these, {plural(sums, 'sum')} {'is' if sums == 1 else 'are'} known all the same"
    return words + "."


def data_sentence(story: Story) -> str:
    """What the logs held."""
    runs, files = story.dataset.runs, story.dataset.files
    heldout = sum(run.heldout for run in runs)
    seconds = sum(run.duration for run in runs)
    words = f"{plural(len(runs), 'run')} were found" + (f" in {plural(len(files), 'file')}" if files else "")
    words += f", {number(seconds, 3)} s of motion of one joint alone"
    strokes = sum(run.kind == "stroke" for run in runs)
    if strokes:
        words += f"; {plural(strokes, 'run')} are strokes from rest to rest, which carry an inertia term"
    if heldout:
        words += f"; {heldout} are kept from fitting, to judge the model"
    return words + "."


def plural(count: int, word: str) -> str:
    """A count with its noun: ``1 run``, ``2 runs``."""
    return f"{count} {word}{'' if count == 1 else 's'}"


def listed(words: Sequence[str]) -> str:
    """``a, b and c``."""
    if len(words) < 2:
        return "".join(words)
    return ", ".join(words[:-1]) + f" and {words[-1]}"
