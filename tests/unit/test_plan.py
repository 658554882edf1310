"""Plans: what they show, limits and time kept, what is refused or told of them; deciding runs."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import table1
from menus import arm
from monte_carlo import Bench, fit_with_replicates
from searches import design

from pumaid.cli.commands.experiments import ATTENTION
from pumaid.design.candidate_runs import stance, top_speed
from pumaid.design.plan import check_plan, plan
from pumaid.diagnosis.discrimination import Separation, candidates, deciding, runs_ahead
from pumaid.diagnosis.score_test import DECISIVE, evidence, refine_shape, scores_at
from pumaid.effect_spec import EffectTerm
from pumaid.effects import catalogue
from pumaid.errors import ModelError
from pumaid.estimation.fit import Projector, loaded
from pumaid.estimation.gls import refit
from pumaid.io.plan_file import plan_text, read_plan
from pumaid.joint_bins import COARSE, extent, joint_bins
from pumaid.model import Model, minimal
from pumaid.robot import Box, Capsule, Joint, Robot, Safety
from pumaid.simulation import Hidden, draw
from pumaid.trajectory import Motion, Plan

ARMS = ("puma560", "stanford", "pendulum2")
PENDULUM = arm("pendulum2")
#: Where the tip comes by when the hip stands half a radian from straight down.
POST = Safety((Box("post", (0.3, -0.1, -0.7), (0.4, 0.1, -0.55)),), (0.4, 0.0, 0.0), 0.01)
#: The second joint, of 0.1 deg/s, needs an hour for its span.
SLOW = tuple(Joint(k, f"j{k}", "revolute", alpha=1.0, a=0.2, max_velocity=v) for k, v in ((1, 1.0), (2, np.pi / 1800)))


@cache
def planned(name: str) -> Plan:
    """The default plan of a shipped recipe."""
    return plan(arm(name), seed=5)


@cache
def pendulums() -> Plan:
    """A plan of six minutes."""
    return plan(PENDULUM, minutes=6, seed=1)


@cache
def papers() -> Plan:
    """The paper's motions, looked at."""
    return check_plan(arm("puma560"), table1.experiment(), seed=1)


def fitted(found: Plan, joint: int) -> list[Motion]:
    """Runs of a joint that are to be fitted."""
    return [motion for motion in found.motions if motion.joint == joint and motion.purpose == "fit"]


def texts(found: Plan, slug: str) -> list[str]:
    """Of its notes of one kind."""
    return [note.text for note in found.notes if note.slug == slug]


@pytest.mark.parametrize("name", ARMS)
def test_everything_the_arm_has_is_promised(name):
    """Each parameter has an expected error, or a reason why it has none."""
    found, structure, n = planned(name), minimal(arm(name)), arm(name).n_joints
    assert set(found.unseen) == set(structure.absent) | {f"gain_ratio.{i}.{j}" for i, j in structure.redundant}
    friction = {
        f"{kind}.j{k}.{side}" for k in range(1, n + 1) for kind in ("coulomb", "viscous") for side in ("plus", "minus")
    }
    assert friction | {f"gain_ratio.{k}.{k + 1}" for k in range(1, n)} <= set(found.expected) | set(found.unseen)
    assert not set(found.expected) & set(found.unseen)
    assert all(0.0 < error < 1.0 for error in found.expected.values())


@pytest.mark.parametrize("name", ARMS)
def test_every_joint_has_postures_speeds_and_spans(name):
    """Four postures and speeds, wide ranges in two, both ways equally; judged at speeds and postures of no fit."""
    # No motion passes a limit or a highest speed, moving or held.
    for joint in arm(name).joints:
        for motion in planned(name).motions:
            moves = motion.joint == joint.number
            places = (motion.start, motion.end) if moves else (motion.hold[joint.number - 1],)
            low, high = joint.limits or (-np.inf, np.inf)
            assert all(low <= place <= high for place in places)
            assert not moves or 0.0 < motion.velocity <= (joint.max_velocity or np.inf)
        runs = fitted(planned(name), joint.number)
        speeds = sorted({m.velocity for m in runs})
        assert len({m.hold for m in runs}) >= 4 and len(speeds) >= 4
        assert speeds[0] <= speeds[-1] / 14.0
        assert speeds[-1] == pytest.approx(top_speed(arm(name), joint.number), rel=0.02)
        wide = 0.75 * np.ptp(stance(arm(name))[1][joint.number - 1])
        assert len({m.hold for m in runs if abs(m.end - m.start) >= wide}) >= 2
        for hold in {m.hold for m in runs}:
            ways = [m.end - m.start for m in runs if m.hold == hold]
            assert sum(ways) == pytest.approx(0.0, abs=1e-9)
            assert min(ways) < 0.0 < max(ways)
        judged = [m for m in planned(name).motions if m.joint == joint.number and m.purpose == "heldout"]
        assert judged and not {m.velocity for m in judged} & {m.velocity for m in runs}
        assert arm(name).n_joints == 2 or not {m.hold for m in judged} & {m.hold for m in runs}


def test_replicates_are_a_pass_apart():
    """Each joint has many runs that are made again, and between the two most other joints have run."""
    found, places = planned("puma560"), dict[Motion, list[int]]()
    for place, motion in enumerate(found.motions):
        if motion.purpose == "fit":
            places.setdefault(motion, []).append(place)
    twice = {motion: where for motion, where in places.items() if where[-1] - where[0] > 20}
    assert min(sum(motion.joint == joint for motion in twice) for joint in range(1, 7)) >= 6
    gaps = [{m.joint for m in found.motions[where[0] : where[-1]]} for where in twice.values()]
    # A block at the end of the first pass may come early in the second; across the plan nearly all joints lie between.
    assert np.mean([len(gap) for gap in gaps]) > 4.0


def test_budget_is_kept():
    """A plan for so many minutes takes no longer, and more time tells more."""
    means = []
    for minutes, made in ((15, plan(PENDULUM, minutes=15, seed=1)), (6, pendulums())):
        assert 30.0 * minutes < made.duration <= 60.0 * minutes
        means.append(np.mean(np.log(list(made.expected.values()))))
    assert means[0] < means[1]


def test_too_little_time_is_told():
    """Half a minute is too short for two joints; the message names the least that is not; less than none is refused."""
    with pytest.raises(ModelError) as caught:
        plan(PENDULUM, minutes=0.5)
    assert caught.value.slug == "plan-too-short"
    least = int(caught.value.mend.split()[2])
    assert plan(PENDULUM, minutes=least).duration <= 60.0 * least
    with pytest.raises(ModelError, match="-1 minutes are out of range"):
        plan(PENDULUM, minutes=-1.0)


@pytest.mark.parametrize(
    "robot",
    [
        Robot("turntable", (Joint(1, "turn", "revolute"),)),
        Robot("hinge", (Joint(1, "hinge", "revolute", alpha=np.pi / 2),)),
        Robot("lift", (Joint(1, "lift", "prismatic"),)),
        Robot("gantry", tuple(Joint(k, f"axis {k}", "prismatic", alpha=np.pi / 2) for k in (1, 2, 3))),
        Robot("weightless", tuple(Joint(k, f"j{k}", "revolute", alpha=1.0) for k in (1, 2)), gravity=(0.0, 0.0, 0.0)),
        Robot("slow", SLOW),
        Robot("narrow", (Joint(1, "nod", "revolute", alpha=1.5, limits=(-0.05, 0.08)), Joint(2, "tip", "revolute"))),
    ],
    ids=lambda robot: robot.name,
)
def test_odd_arms_get_a_plan(robot):
    """One joint, no weight, only sliding joints, a span of seven degrees: a plan all the same, with its reasons."""
    # Runs of a crawling joint last for seconds at four speeds or more, not for hours over its span.
    found = plan(robot, seed=2)
    assert {motion.joint for motion in found.motions} == set(range(1, robot.n_joints + 1))
    assert {f"coulomb.j{k}.plus" for k in range(1, robot.n_joints + 1)} <= set(found.expected)
    if robot.name == "hinge":
        assert "Joint 1 (hinge) states no limits: -125..125 deg taken." in found.assumptions
    if robot.name == "slow":
        assert len({motion.velocity for motion in fitted(found, 2)}) >= 4
        assert max(abs(motion.end - motion.start) / motion.velocity for motion in fitted(found, 2)) < 70.0


def test_rounding_decides_nothing(monkeypatch):
    """A seed's plan stays where inverses are off in their twelfth digit, as on a machine that adds in other order."""
    exact, rng = np.linalg.inv, np.random.default_rng(0)
    wanted = pendulums().motions
    monkeypatch.setattr(
        np.linalg, "inv", lambda m: exact(m) * (1.0 + 1e-12 * rng.standard_normal((*m.shape[:-2], 1, 1)))
    )
    assert plan(PENDULUM, minutes=6, seed=1).motions == wanted


def test_a_thin_plan_says_what_it_lacks():
    """In little more than the least time each joint has two postures, and a note says so."""
    notes = texts(plan(PENDULUM, minutes=1.6, seed=1), "plan-lacks")
    assert len(notes) == 2 and all("2 of 4 postures" in text for text in notes)


def test_a_joint_that_can_run_nowhere_is_told():
    """A lid over a table leaves joint 1 no way in any posture: refused, with what is struck."""
    boxes = (Box("table", (-2, -2, -1), (2, 2, -0.1)), Box("lid", (-2, -2, 0.12), (2, 2, 2)))
    safety = Safety(boxes, (0.0, 0.0, 0.1), 0.02, capsules=(Capsule(3, (0.2, 0.0, 0.0), (0.2, 0.0, 0.0), 0.08),))
    with pytest.raises(ModelError) as caught:
        plan(replace(arm("puma560"), safety=safety), seed=1)
    assert (caught.value.slug, caught.value.where.joint) == ("plan-unsafe", 1)
    assert "joint 1 (waist) collides" in caught.value.what and "'lid'" in caught.value.what


def test_the_papers_plan_lacks_what_diagnosis_needs():
    """Every joint lacks postures, replicates and runs for judging; none lacks speeds; the best plan is far better."""
    lacks = [note for note in papers().notes if note.slug == "plan-lacks"]
    assert [note.where.joint for note in lacks] == [1, 2, 3, 4, 5, 6]
    for note in lacks:
        assert "of 4 postures" in note.text and "made twice" in note.text and "kept for judging" in note.text
        assert "speeds" not in note.text
    assert texts(papers(), "plan-needs-tilt") and "plan-lacks" in ATTENTION
    better = plan(arm("puma560"), minutes=papers().duration / 60.0, seed=1).expected
    logs = [np.log(better[name] / error) for name, error in papers().expected.items()]
    assert np.exp(np.mean(logs)) < 0.7


def test_the_planners_plan_is_as_promised():
    """The same seed gives the same errors, duration, assumptions and reasons, and nothing asks for attention."""
    wanted = pendulums()
    found = check_plan(PENDULUM, replace(wanted, expected={}, unseen={}, notes=()), seed=1)
    assert (found.expected, found.unseen, found.duration) == (wanted.expected, wanted.unseen, wanted.duration)
    assert found.assumptions == wanted.assumptions
    assert not {note.slug for note in found.notes} & set(ATTENTION)


def test_a_joint_that_never_runs_is_told_with_all_it_hides():
    """Without joint 2's runs its gravity, its friction and the ratio are dark, and it is said to never run."""
    wanted = pendulums()
    found = check_plan(PENDULUM, replace(wanted, motions=tuple(m for m in wanted.motions if m.joint == 1)), seed=1)
    friction = {f"{kind}.j2.{side}" for kind in ("coulomb", "viscous") for side in ("plus", "minus")}
    assert friction | {"gravity.l2.x", "gravity.l2.y", "gain_ratio.1.2"} == set(found.unseen)
    assert all(name in texts(found, "plan-dark")[0] for name in found.unseen)
    assert texts(found, "plan-lacks") == ["joint 2 (knee): it never runs"]


def test_runs_and_moves_that_strike_are_named():
    """A box in the way of a run is named with the run, the free runs are not; the planner avoids the box."""
    robot = replace(PENDULUM, safety=POST)
    free, hit = Motion(2, (0.0, 0.0), 0.0, -0.5, 0.5), Motion(1, (0.0, 0.0), -1.5, 1.5, 0.5)
    found = check_plan(robot, Plan(robot.name, (free, hit, free)), seed=1)
    strikes = [note for note in found.notes if note.slug == "plan-strikes" and note.text.startswith("run ")]
    assert [note.where.field for note in strikes] == ["runs[2]"]
    assert "post" in strikes[0].text
    assert not texts(check_plan(robot, plan(robot, minutes=6, seed=1), seed=1), "plan-strikes")


def test_runs_that_no_log_shows_are_told():
    """A run over a hundredth of a radian and one slower than what counts as rest are named, and ask for attention."""
    first = pendulums().motions[0]
    short, slow = replace(first, end=first.start + 0.01), replace(first, velocity=0.002)
    found = check_plan(PENDULUM, replace(pendulums(), motions=(short, *pendulums().motions, slow)), seed=1)
    (note,) = [note for note in found.notes if note.slug == "plan-unusable"]
    assert note.text.startswith(f"2 run(s) of joint {first.joint} ") and note.where.field == "runs[1]"


PUMA = arm("puma560")
JOINT, SPEEDS = 3, (0.15, 0.35, 0.6, 0.9)
STRIBECK = Hidden("stribeck", JOINT, {"a": 0.3, "velocity": 0.15, "exponent": 1.0})
WARM = Hidden("warmup", JOINT, {"a": 0.3, "time_constant": 100.0})
#: Shapes that a rival is fitted with: wider than its own grid, since more runs let it take others.
SHAPES = {
    "stribeck": [{"velocity": v, "exponent": d} for v in np.geomspace(0.02, 4.0, 9).tolist() for d in (0.6, 1.0, 2.0)],
    "viscous_power": [{"exponent": p} for p in (0.1, 0.3, 0.6, 0.9, 1.1, 1.4, 2.0, 3.0)],
}


def campaign(seed: int) -> list[Motion]:
    """Joint 3 both ways at some speeds in random postures, all twice, in random order."""
    return list(design(PUMA, [JOINT], postures=3, speeds=SPEEDS, reach=1.5, seed=seed).motions)


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
    effect, row, projector = catalogue()[name], solved.by_bin[JOINT], Projector(solved)
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
    been = solved.by_bin[JOINT].bins.samples.position
    reached = list(zip(been.min(axis=0), been.max(axis=0), strict=True))
    reached[JOINT - 1] = (-1.5, 1.5)
    check_within(replace(solved, model=Model(bare)), reached, max(SPEEDS))


def test_gain_is_what_least_squares_leaves():
    """A gain is what a dense fit of the rival to data and forecast leaves, less what one to the data leaves."""
    _, solved = measured()
    truth, rival = trial(solved, "stribeck"), trial(solved, "viscous_power")
    ahead = runs_ahead(solved, candidates(solved, JOINT)[0], np.array([0]), bins=40)
    rows = [solved.by_bin[JOINT], ahead[0]]
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
