"""Runs planned for an effect, and runs that would decide: they show it by what they promise."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from menus import arm

from pumaid.design.information import prior_robots
from pumaid.design.plan import plan
from pumaid.diagnosis.discrimination import (
    Separation,
    candidates,
    deciding,
    plan_for_effect,
    rehearsed,
    runs_ahead,
    showing,
    solved_on,
    usual,
)
from pumaid.diagnosis.score_test import refine_shape, score_at, scores_at
from pumaid.diagnosis.stepwise import DECISIVE, evidence
from pumaid.effect_spec import EffectTerm
from pumaid.effects import catalogue
from pumaid.errors import ModelError
from pumaid.estimation.fit import Projector, loaded
from pumaid.estimation.gls import fit_with_replicates, refit
from pumaid.io.plan_file import plan_text, read_plan
from pumaid.io.recipe import read_recipe
from pumaid.joint_bins import COARSE, extent, joint_bins
from pumaid.model import Model
from pumaid.robot import EffectChoice, Joint, Robot
from pumaid.simulation import Bench, Hidden, draw
from pumaid.trajectory import Motion, Plan

#: Its upright first joint feels a tilt of the base.
TURRET = Robot(
    "turret",
    (
        Joint(1, "turn", "revolute"),
        Joint(2, "nod", "revolute", alpha=np.pi / 2),
        Joint(3, "bend", "revolute", a=0.3),
        Joint(4, "tip", "revolute", a=0.25),
    ),
)
ARMS = {"pendulum": arm("pendulum2"), "turret": TURRET}
#: Effects and sizes of the first parameter (SI) that are near the noise of a short experiment, so that both the
#: experiment alone and with the added runs have noise, and not the effect, in what is left.
CASES = [
    ("pendulum", "stribeck", 2, 0.03),
    ("pendulum", "spring", 1, 0.005),
    ("pendulum", "position_friction", 1, 0.006),
    ("turret", "tilt", None, 0.004),
]
#: Ratio of gains of the turret's joints.
WAIST = float(prior_robots(TURRET, seed=3).robots[0].constants.ratio[0])
#: Robots on which a promise is kept; none was looked at while the planner was made.
SEEDS = range(6200, 6206)


@cache
def ground(name: str) -> Plan:
    """A short experiment."""
    return plan(ARMS[name], minutes=1.5 * ARMS[name].n_joints, seed=1)


def sized(name: str, effect: str, joint: int | None, size: float) -> Hidden:
    """An effect whose first parameter is `size`, the rest as usual."""
    return usual(prior_robots(ARMS[name], seed=3).robots[0], EffectChoice(effect, joint), size)


def statistic(name: str, hidden: Hidden, made: Plan, seed: int) -> float:
    """By how much the true effect lowers the square, in units of the noise's, where a robot hides it."""
    robot, law = ARMS[name], catalogue()[hidden.effect]
    usual_one = prior_robots(robot, seed=3).robots[0]
    # How strongly an upright joint feels a tilt is its ratio of gains: the promise is for this robot's.
    drawn = usual_one if hidden.effect == "tilt" else draw(robot, seed)
    truth = replace(drawn, hidden=(hidden,), noise=usual_one.noise)
    system = solved_on(robot, rehearsed(truth, made, seed=seed).runs)
    shapes = [one.name for one in law.shapes(robot, hidden.joint or 0)]
    shape = {shape: WAIST if shape == "waist" else hidden.values[shape] for shape in shapes}
    return score_at(Projector(system), EffectTerm(law, hidden.joint, shape)).statistic / system.scale


def promised(found: Plan) -> float:
    """Standard deviations that the added runs together promise: those of a set times the root of how many."""
    text = found.assumptions[-1]
    often = re.search(r"made (\d+) times", text)
    return float(re.search(r"would show by ([\d.]+) standard", text)[1]) * np.sqrt(int(often[1]) if often else 1)


@pytest.mark.parametrize(("name", "effect", "joint", "size"), CASES)
def test_added_runs_show_what_they_promise(name, effect, joint, size):
    """They follow the experiment, and raise the separation over some experiments by half to twice of their promise."""
    hidden, seeds = sized(name, effect, joint, size), SEEDS[: 12 // ARMS[name].n_joints]
    wanted = EffectChoice(effect, joint, {"waist": WAIST} if effect == "tilt" else {})
    found = plan_for_effect(ARMS[name], wanted, whole=lambda: ground(name), seed=3, size=size)
    base = ground(name)
    assert found.motions[: len(base.motions)] == base.motions and found.duration > base.duration
    assert {motion.joint for motion in found.motions[len(base.motions) :]} == {joint or 1}
    assert found.postures[-1].why.startswith(f"shows {effect}")
    each = np.array([[statistic(name, hidden, made, seed) for made in (base, found)] for seed in seeds])
    raised = np.sqrt(max(np.mean(each[:, 1] - each[:, 0]), 0.0))
    # Of several parameters the promise is for the least visible; all together show more.
    alone = len(catalogue()[effect].parameters(ARMS[name], joint or 0)) == 1
    assert 0.5 < raised / promised(found) < (2.0 if alone else np.inf)


@pytest.mark.parametrize(("first", "second"), [("stribeck", "viscous_power"), ("spring", "position_friction")])
def test_rivals_are_told_apart_by_new_runs(first, second):
    """The rival takes the joint of what it rivals, and the runs promise a separation of either from the other."""
    wanted = EffectChoice(first, 1)
    rival, whole = EffectChoice(second, None), lambda: ground("pendulum")
    found = plan_for_effect(ARMS["pendulum"], wanted, against=rival, whole=whole, seed=3)
    assert f"tells {first}@1 from {second}@1" in found.assumptions[-1]
    apart = [float(one) for one in re.findall(r"by ([\d.]+) (?:standard|if)", found.assumptions[-1])]
    assert min(apart) > 1.0


@pytest.mark.parametrize(("effect", "joint"), [("inertia", 1), ("payload", None), ("friction_step", 2), ("tilt", None)])
def test_what_no_run_shows_is_said(effect, joint):
    """Inertia, what begins at an instant, and a tilt that both level axes absorb: refused with what might help."""
    with pytest.raises(ModelError, match="plan-undecided") as caught:
        plan_for_effect(ARMS["pendulum"], EffectChoice(effect, joint), whole=lambda: ground("pendulum"), seed=3)
    assert effect in caught.value.what and caught.value.mend


@pytest.mark.parametrize(
    ("wanted", "rival", "slug", "words"),
    [
        (EffectChoice("load_friction", 1), None, "effect-joint", "direction of gravity"),
        (EffectChoice("stribek", 1), None, "unknown-effect", "did you mean stribeck?"),
        (EffectChoice("stribeck", None), None, "effect-joint", "--for stribeck"),
        (EffectChoice("stribeck", 3), None, "effect-joint", "no joint 3"),
        (EffectChoice("tilt", 1), None, "effect-joint", "whole arm"),
        (EffectChoice("tilt", None), EffectChoice("spring", None), "effect-joint", "--against spring"),
        (EffectChoice("spring", 1), EffectChoice("sprung", 1), "unknown-effect", "did you mean spring?"),
        (EffectChoice("spring", 1), EffectChoice("spring", 1), "plan-undecided", "from spring@1"),
    ],
)
def test_wrong_effects_are_refused(wanted, rival, slug, words):
    """An effect of weight at an upright joint, misspelt names, missing or absent joints, a rival that is itself."""
    robot = TURRET if wanted.effect == "load_friction" else ARMS["pendulum"]
    with pytest.raises(ModelError, match=slug) as caught:
        plan_for_effect(robot, wanted, against=rival, whole=lambda: ground("pendulum"), seed=3)
    assert words in str(caught.value)


PUMA = read_recipe(Path(__file__).parents[2] / "recipes" / "puma560.yaml")
JOINT, SPEEDS = 3, (0.15, 0.35, 0.6, 0.9)
STRIBECK = Hidden("stribeck", JOINT, {"a": 0.3, "velocity": 0.15, "exponent": 1.0})
WARM = Hidden("warmup", JOINT, {"a": 0.3, "time_constant": 100.0})
#: Shapes that a rival is fitted with: wider than its own grid, since more runs let it take others.
SHAPES = {
    "stribeck": [{"velocity": v, "exponent": d} for v in np.geomspace(0.02, 4.0, 9).tolist() for d in (0.6, 1.0, 2.0)],
    "viscous_power": [{"exponent": p} for p in (0.1, 0.3, 0.6, 0.9, 1.1, 1.4, 2.0, 3.0)],
}


def campaign(seed: int, *, speeds=SPEEDS, reach: float = 1.5, postures: int = 3) -> list[Motion]:
    """Joint 3 both ways at some speeds in random postures, all twice, in random order."""
    rng, once = np.random.default_rng(seed), []
    for _ in range(postures):
        hold = tuple(np.round(rng.uniform(-1.2, 1.2, 6), 2).tolist())
        once += [Motion(JOINT, hold, -s * reach, s * reach, v) for v in speeds for s in (1.0, -1.0)]
    return [once[k] for _ in range(2) for k in rng.permutation(len(once))]


def runs_of(hidden: Hidden, motions, seed: int, *, is_quiet: bool = False):
    """Runs of a drawn arm with a hidden effect."""
    truth = replace(draw(PUMA, seed), hidden=(hidden,))
    bench = Bench(truth.with_noise(0.0) if is_quiet else truth, Plan(PUMA.name, tuple(motions)), rate=50.0, bins=128)
    return bench.runs(np.random.default_rng(seed))


def system(runs, noises=None):
    """The base model solved on runs."""
    model, bins = Model.of_runs(PUMA, runs), joint_bins(PUMA, runs, most=COARSE)
    fit = fit_with_replicates(model, bins)
    return loaded(fit if noises is None else refit(fit, model, noise=noises))


def trial(solved, name: str):
    """An effect at joint 3 at its best shape."""
    effect, row, projector = catalogue()[name], solved.row(JOINT), Projector(solved)
    grid = SHAPES.get(name) or effect.grid(PUMA, extent([row.bins], row.bins.joint, row.drawn))
    found = [one for one in scores_at(projector, [EffectTerm(effect, JOINT, dict(shape)) for shape in grid]) if one]
    return refine_shape(projector, max(found, key=lambda one: one.statistic))


@cache
def measured(hidden: str = "stribeck", seed: int = 1):
    """Motions and the solved system of an arm that hides one effect."""
    motions = campaign(seed)
    return motions, system(runs_of({"stribeck": STRIBECK, "warmup": WARM}[hidden], motions, seed))


def gap(solved, first: str, second: str) -> float:
    """How far the first effect's evidence is ahead."""
    return evidence(solved, trial(solved, first)) - evidence(solved, trial(solved, second))


def test_runs_can_be_planned_and_made(tmp_path):
    """The motions, the same each time, are a plan that is read without complaint and that a virtual arm can make."""
    _, solved = measured()
    both = trial(solved, "stribeck"), trial(solved, "viscous_power")
    found = deciding(solved, *both)
    assert found == deciding(solved, *both)
    path = tmp_path / "plan.yaml"
    path.write_text(plan_text(Plan(PUMA.name, found.motions), PUMA), encoding="utf-8")
    again = read_plan(path, PUMA)
    assert 4 <= len(again.motions) == len(found.motions) <= 12
    assert {motion.purpose for motion in again.motions} == {"fit"}
    assert len(runs_of(STRIBECK, again.motions, 1)) == len(found.motions)


def check_within(solved, arm, speed: float) -> None:
    """Stretches, held positions and speeds of all that is tried keep the limits of `arm`, and of joint 3 the speed."""
    tried, new = candidates(solved, JOINT)
    assert len({c.sweeps[0].speed for c in tried}) > 5 and new
    for candidate in tried:
        (sweep,) = candidate.sweeps
        for number, (low, high) in enumerate(arm, start=1):
            places = (sweep.low, sweep.high) if number == JOINT else (candidate.hold[number - 1],)
            assert all(low - 1e-6 <= place <= high + 1e-6 for place in places)
        assert 0.0 < sweep.speed <= speed


def test_candidates_are_within_limits():
    """Those of the recipe; without any the arm is not sent where it has not been, nor faster than it has moved."""
    _, solved = measured()
    check_within(solved, [joint.limits for joint in PUMA.joints], PUMA.joint(JOINT).max_velocity)
    bare = replace(PUMA, joints=tuple(replace(joint, limits=None, max_velocity=None) for joint in PUMA.joints))
    been = solved.row(JOINT).bins.samples.position
    reached = list(zip(been.min(axis=0), been.max(axis=0), strict=True))
    reached[JOINT - 1] = (-1.5, 1.5)
    check_within(replace(solved, model=Model(bare)), reached, max(SPEEDS))


def test_gain_is_what_least_squares_leaves():
    """A gain is what a dense fit of the rival to data and forecast leaves, less what one to the data leaves."""
    _, solved = measured()
    truth, rival = trial(solved, "stribeck"), trial(solved, "viscous_power")
    ahead = runs_ahead(solved, candidates(solved, JOINT)[0], np.array([0]), bins=40)
    rows = [solved.row(JOINT), ahead[0]]
    first, other = (
        [row.noise.whiten(row.bins, one.added.linear(solved.model.robot, row.bins.samples)) for row in rows]
        for one in (truth, rival)
    )
    turned = solved.inverse @ rows[0].jacobian.T @ first[0]
    target = [rows[0].residual, (first[1] - rows[1].jacobian @ turned) @ truth.sizes]

    def left(count: int) -> float:
        design = np.vstack([np.column_stack([row.jacobian, C]) for row, C in zip(rows[:count], other, strict=False)])
        design /= np.linalg.norm(design, axis=0) + 1e-300
        y = np.concatenate(target[:count])
        return float(np.sum((y - design @ np.linalg.lstsq(design, y, rcond=1e-9)[0]) ** 2))

    scale = (solved.square - truth.statistic) / (solved.size - solved.rank)
    pair = (truth.added, truth.sizes, truth.statistic, [rival.added])
    found = Separation(solved, [ahead], 1, pair=pair).gains(np.ones((1, 1)))
    assert found[0] == pytest.approx((left(2) - left(1)) / scale, rel=2e-3)  # a ridge stands for what no run shows


def test_promise_is_kept():
    """Made without noise, the runs set the true effect ahead by what was promised, within a third."""
    motions, solved = measured(seed=2)
    found = deciding(solved, trial(solved, "stribeck"), trial(solved, "viscous_power"))
    leads = []
    for made in (motions, [*motions, *found.motions]):
        noises = system(runs_of(STRIBECK, made, 2)).noises
        quiet = system(runs_of(STRIBECK, made, 2, is_quiet=True), noises)
        leads.append(trial(quiet, "stribeck").statistic - trial(quiet, "viscous_power").statistic)
    assert np.sqrt(leads[1] - leads[0]) > 0.67 * found.separation


def test_chosen_runs_decide_sooner_than_others():
    """Over two arms the chosen runs set Stribeck friction farther ahead than as many random runs or repeats do."""
    leads = []
    for seed in (1, 2):
        motions, solved = measured(seed=seed)
        found = deciding(solved, trial(solved, "stribeck"), trial(solved, "viscous_power")).motions
        rng, tried = np.random.default_rng(seed), candidates(solved, JOINT)[0]
        some = [motion for k in rng.integers(len(tried), size=len(found) // 2) for motion in tried[k].motions]
        again = [motions[k] for k in rng.permutation(len(motions))[: len(found)]]
        every = [system(runs_of(STRIBECK, [*motions, *more], seed)) for more in (found, some, again)]
        leads.append([gap(one, "stribeck", "viscous_power") for one in every])
    chosen, at_random, repeated = np.mean(leads, axis=0)
    assert chosen > at_random > repeated
    assert np.min(leads, axis=0)[0] > DECISIVE


def test_what_has_passed_is_asked_of_a_cold_arm():
    """Warm-up and a step of friction are told apart by letting the arm cool: one comes back, the other stays."""
    _, solved = measured("warmup")
    found = deciding(solved, trial(solved, "warmup"), trial(solved, "friction_step"))
    assert found.text.startswith("let the arm cool") and found.repeats is not None
    assert showing(solved, EffectChoice("friction_step", JOINT), {}) is None
