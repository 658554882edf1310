"""Repeat experiments on virtual arms and print the tables that the documents state.

    python tools/trials.py accuracy [-o FIGURE.png]     docs/validation.md; five minutes
    python tools/trials.py motion [--experiments 40]    docs/validation.md; ten minutes
    python tools/trials.py missing [--experiments 120]  docs/validation.md; an hour
    python tools/trials.py planning [--experiments 40]  docs/planning.md
    python tools/trials.py statistics                   docs/statistics.md; ten minutes

Seeds were not used in development. Shares stand with Wilson's 95 % interval. Arms, noise and hidden effects are those
of `pumaid.simulation`, which shares no code with the model.
"""

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import matplotlib.pyplot as plt
import numpy as np
import table1
from blind_world.tables import header, interval, row
from experiments import coverage, logged, losses
from free_motion import loaded, picks, reach, recorded, waves
from monte_carlo import Bench

from pumaid import identify, segment, simulate
from pumaid.dataset import Dataset, first_motions
from pumaid.design.plan import plan
from pumaid.diagnosis.candidates import minus_log10_p
from pumaid.diagnosis.detection_limits import detection_limits
from pumaid.diagnosis.diagnose import DiagnosisBuilder, diagnose
from pumaid.diagnosis.records import ADD, UNEXPLAINED_JOINT
from pumaid.diagnosis.score_test import LEVEL
from pumaid.diagnosis.stepwise import Step, Stepwise
from pumaid.effects import catalogue
from pumaid.errors import ModelError
from pumaid.estimate import Estimate
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.model import Model
from pumaid.preprocessing.hold_out import match_with_plan
from pumaid.robot import Robot
from pumaid.simulation import Hidden, Noise, Truth, draw
from pumaid.trajectory import Motion, Plan, duration

#: Design -> postures, speeds (of a slide: a fifth, in m/s), directions, repeats.
DESIGNS: dict[str, tuple[int, Sequence[float], Sequence[int], int]] = {
    "4 postures, 4 speeds, both ways, twice": (4, (0.2, 0.4, 0.8, 1.2), (1, -1), 2),
    "the same, once": (4, (0.2, 0.4, 0.8, 1.2), (1, -1), 1),
    "2 postures, 2 speeds, both ways, twice": (2, (0.3, 0.9), (1, -1), 2),
}
FULL = next(iter(DESIGNS))
#: Arms at work: recipe, way of moving, tool (kg), encoder counts a rad; and the first of their seeds.
WORK = (
    ("puma560", "waves", 1.5, 2e4),
    ("puma560", "waves", 1.5, 2.5e3),
    ("puma560", "picks", 1.5, 2e4),
    ("puma560", "picks", 1.5, 2.5e3),
    ("ur5e", "picks", 0.0, 2e4),
    ("stanford", "waves", 0.0, 2e4),
)
FIRST_WORK = 5000


def drawn(name: str, seed: int) -> Truth:
    """A virtual arm of a shipped recipe."""
    return draw(read_recipe(shipped_recipes()[name]), seed)


def designed(robot: Robot, design: str, seed: int) -> Plan:
    """Every joint in random postures, in random order, repeats one after another."""
    postures, speeds, ways, repeats = DESIGNS[design]
    rng, holds, motions = np.random.default_rng(seed), {}, list[Motion]()
    size = np.where(robot.is_revolute, 2.0, 0.3)
    for joint in robot.joints:
        holds[joint.number] = [tuple(rng.uniform(-size, size)) for _ in range(postures)]
    for joint in robot.joints * repeats:
        reach, slow = (2.0, 1.0) if joint.is_revolute else (0.3, 0.2)
        once = [
            Motion(joint.number, hold, -reach * way, reach * way, speed * slow)
            for hold in holds[joint.number]
            for speed in speeds
            for way in ways
        ]
        motions += [once[k] for k in rng.permutation(len(once))]
    return Plan(robot.name, tuple(motions))


def bench(truth: Truth, motions: Plan) -> Bench:
    """The quick virtual laboratory of all trials but those of accuracy."""
    return Bench(truth, motions, rate=50.0, bins=120)


#: Experiments of each arm; recipe and seed of the drawn arms; seeds of the experiments that go through log files.
EXPERIMENTS, ARMS, LOGS = 200, (("ur3e", 11), ("stanford", 12), ("panda", 14), ("pendulum2", 13)), range(900, 920)


def accuracy(options: argparse.Namespace) -> Iterator[str]:
    """Coverage of intervals, errors over the Cramer-Rao bound, and Table I through log files."""
    truth = table1.puma560()
    paper = Bench(truth, table1.experiment(2), rate=50.0)
    clustered, white = coverage(truth, paper, experiments=EXPERIMENTS, white=EXPERIMENTS)
    if options.output is not None:
        coverage_figure(clustered, white, options.output)
    shares = {"PUMA 560, the paper's experiment twice": clustered, "the same, white-noise errors": white}
    for name, seed in ARMS:
        arm = drawn(name, seed)
        planned = Bench(arm, plan(arm.robot, seed=seed), rate=50.0)
        shares[f"{arm.robot.name}, planned"] = coverage(arm, planned, experiments=EXPERIMENTS)[0]
    yield header("arm and experiment", "parameters", "intervals that hold the truth", "lowest of a single parameter")
    for title, by_name in shares.items():
        lowest = min(by_name, key=lambda name: by_name[name])
        mean = 100 * np.mean(list(by_name.values()))
        yield row(title, len(by_name), f"{mean:.1f} %", f"{100 * by_name[lowest]:.1f} % ({lowest})")
    quiet = Noise(truth.noise.std, level_share=0.0, correlation_time=0.0)
    names, *methods = losses(replace(truth, noise=quiet), table1.experiment())
    for title, loss in zip(("joint fit", "recursion"), methods, strict=True):
        worst = ", ".join(f"{names[k]} {loss[k]:.2f}" for k in np.argsort(-loss)[:3])
        yield f"\nRMS error over the Cramer-Rao bound, {title}: {np.exp(np.mean(np.log(loss))):.3f}; most: {worst}"
    exact, contained = truth.parameters(), []
    for seed in LOGS:
        with TemporaryDirectory() as folder:
            values = [value for value in logged(Path(folder), seed).values if value.ci95 is not None]
        contained += [value.ci95[0] <= exact[value.name] <= value.ci95[1] for value in values if value.ci95]
    yield f"\nIntervals that hold the value of Table I, through log files: {interval(contained)}"


def held_at_work(place: int, seed: int) -> dict[str, bool | None]:
    """Whether each interval of a row of `WORK` in one experiment holds the truth, in closed loop; None: not told.

    Judged are gravity, friction and ratios of gains that some motion shows.
    """
    name, way, tool, counts = WORK[place]
    robot, rng = read_recipe(shipped_recipes()[name]), np.random.default_rng(seed)
    truth = loaded(draw(robot, seed), tool) if tool else draw(robot, seed)
    wanted = (waves if way == "waves" else picks)(rng, 60.0 if way == "waves" else 120.0, reach(robot))
    estimate = identify(segment([recorded(truth, wanted, rng, counts=counts)], robot), robot)
    exact, judged = truth.parameters(), [value for value in estimate.values if value.name in truth.parameters()]
    return {v.name: v.ci95[0] <= exact[v.name] <= v.ci95[1] if v.ci95 is not None else None for v in judged}


def motion(options: argparse.Namespace) -> Iterator[str]:
    """Coverage of intervals from logs of arms at work."""
    yield header("arm and motion", "encoder (rad)", "intervals", "lowest of a single parameter", "ratios not told")
    seeds = range(FIRST_WORK, FIRST_WORK + options.experiments)
    with ProcessPoolExecutor(options.jobs) as pool:
        for place, (name, way, tool, counts) in enumerate(WORK):
            judged = list(pool.map(partial(held_at_work, place), seeds))
            by_name = {key: [bool(holds[key]) for holds in judged if holds[key] is not None] for key in judged[0]}
            lowest = min((key for key in by_name if by_name[key]), key=lambda key: np.mean(by_name[key]))
            ratios = [key for key in by_name if key.startswith("gain_ratio")]
            untold = sum(holds[key] is None for holds in judged for key in ratios)
            share = interval([held for outcomes in by_name.values() for held in outcomes])
            title = f"{name}{f', {tool:g} kg tool' if tool else ''}, {way}"
            yield row(title, f"{1.0 / counts:.0e}", share, f"{interval(by_name[lowest])} ({lowest})", untold)


#: Effects hidden in arms at work, with the values that make their size; sizes, as multiples of the noise, of what the
#: base model leaves of them.
AT_WORK: dict[str, tuple[str, ...]] = {
    "coupling": ("c",),
    "stribeck": ("a",),
    "ripple": ("cos", "sin"),
    "spring": ("a",),
    "payload": ("mass",),
    "zero_offset": ("delta",),
    "warmup": ("a",),
    "friction_step": ("a",),
    "position_friction": ("cos", "sin"),
    "viscous_power": ("b",),
    "load_friction": ("drive", "back"),
    "tilt": ("x", "y"),
    "flexibility": ("c",),
}
MULTIPLES = (0.0, 0.5, 1.0, 2.0)


def hidden_at_work(seed: int) -> tuple[float, str, str]:
    """The size and name of what is hidden in an arm at work, and how the diagnosis answers."""
    rng, (name, way, tool, counts) = np.random.default_rng([seed, 77]), WORK[(0, 2, 4, 5)[seed % 4]]
    seconds, move = (60.0, waves) if way == "waves" else (100.0, picks)
    robot = read_recipe(shipped_recipes()[name])
    truth = loaded(draw(robot, seed), tool) if tool else draw(robot, seed)

    def estimated(arm: Truth, counts: float) -> tuple[Dataset, Estimate]:
        wanted = move(np.random.default_rng(seed), seconds, reach(robot))
        dataset = segment([recorded(arm, wanted, np.random.default_rng(seed), counts=counts)], robot)
        return dataset, identify(dataset, robot)

    size, effect = float(rng.choice(MULTIPLES)), str(rng.choice(list(AT_WORK)))
    joint = None if effect in ("payload", "tilt") else int(rng.integers(1, robot.n_joints + 1))
    if joint and catalogue()[effect].applies(robot, joint, in_motion=True) is not None:
        return size, effect, "not to be had"
    if size:
        times = {"warmup": {"time_constant": seconds / 3.0}, "friction_step": {"time": seconds / 2.0}}
        times["payload"] = times["friction_step"]
        try:
            lacking = truth.hiding([Hidden(effect, joint, times.get(effect, {}))])
        except ModelError:  # the joint carries no weight
            return size, effect, "not to be had"
        quiet = replace(truth.noise, std=0.0 * truth.noise.std)
        # Squares of what the base model leaves, beside what it leaves of the arm without the effect.
        more, before = (
            np.array([fit.rmse for fit in estimated(replace(arm, noise=quiet), 1e7)[1].joints], float) ** 2
            for arm in (lacking, truth)
        )
        (hidden,) = lacking.hidden
        factor = size / float(np.sqrt(np.max((more - before) / truth.noise.sample_std**2)))
        values = {key: value * (factor if key in AT_WORK[effect] else 1.0) for key, value in hidden.values.items()}
        truth = replace(truth, hidden=(replace(hidden, values=values),))
    dataset, estimate = estimated(truth, counts)
    findings = [finding for finding in diagnose(estimate, dataset, robot).findings if finding.verdict == ADD]
    if not size or not findings:
        return size, effect, "something" if findings else "nothing"
    first = findings[0]
    if (first.effect, first.joint) == (effect, joint):
        return size, effect, "first"
    return size, effect, "rival" if effect in [rival.split("@")[0] for rival in first.rivals] else "wrong"


def missing(options: argparse.Namespace) -> Iterator[str]:
    """How the diagnosis answers where one effect is hidden in an arm at work, or none."""
    with ProcessPoolExecutor(options.jobs) as pool:
        answers = list(pool.map(hidden_at_work, range(FIRST_WORK, FIRST_WORK + options.experiments)))
    yield header("size (noise)", "experiments", "named first", "a rival of the first", "wrong", "nothing named")
    for size in MULTIPLES:
        judged = [answer for multiple, _, answer in answers if multiple == size and answer != "not to be had"]
        words = ("something",) if not size else ("first", "rival", "wrong")
        shares = [interval([answer == word for answer in judged]) for word in words]
        cells = ["-", "-", *shares] if not size else shares
        yield row(f"{size:g}", len(judged), *cells, interval([answer == "nothing" for answer in judged]))
    for _, effect, answer in answers:
        if answer in ("wrong", "something"):
            yield f"{effect}: {answer}"


def coverage_figure(clustered: dict[str, float], white: dict[str, float], path: Path) -> None:
    """Coverage by parameter: clustered by run against white noise, with the band in which experiments scatter."""
    names = list(clustered)
    fig, ax = plt.subplots(figsize=(9, 4.6), layout="constrained")
    half = 1.96 * np.sqrt(0.95 * 0.05 / EXPERIMENTS)
    ax.axhspan(100 * (0.95 - half), 100 * (0.95 + half), color="#d9e6f2", lw=0, label="95 % and its scatter")
    ax.axhline(95, color="#5b7fa3", lw=1)
    ax.plot([100 * clustered[name] for name in names], "o", color="#0072b2", ms=5, label="pumaid: clustered by run")
    plain = [100 * white.get(name, np.nan) for name in names]
    ax.plot(plain, "s", color="#d55e00", ms=5, mfc="none", label="plain least squares: white noise")
    ax.set_xticks(range(len(names)), names, rotation=90, fontsize=7)
    ax.set(ylim=(0, 103), ylabel="intervals that hold the truth (%)")
    title = f"How often a 95 % interval holds the truth: virtual PUMA 560, {EXPERIMENTS} experiments"
    ax.set_title(title, loc="left", fontsize=10)
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(loc="center right", bbox_to_anchor=(1.0, 0.6), frameon=False, fontsize=8)
    fig.savefig(path, dpi=150)


#: How often the paper's experiment is made: its time is that of the plans; first seed of the experiments.
TIMES, PLANNED = (1, 2), 5000
#: A ratio that no plan shows on the paper's PUMA.
UNSHOWN = "gain_ratio.5.6"


def planning(options: argparse.Namespace) -> Iterator[str]:
    """The planner against the paper's postures on the paper's PUMA in the same robot time, in closed loop.

    Compared is the standard deviation of each estimate over experiments that are simulated sample by sample, segmented
    and identified, in the geometric mean over the parameters that all plans show.
    """
    arm = read_recipe(shipped_recipes()["puma560"])
    seeds = range(PLANNED, PLANNED + options.experiments)
    yield header("minutes", "plan", "runs", "predicted", "measured", "the paper's error over this")
    for times in TIMES:
        paper = table1.experiment(times)
        minutes = duration(arm, paper) / 60.0
        prior = through_logs(arm, table1.experiment(), 999)
        plans = {
            "the paper's experiment": paper,
            "from the recipe alone": plan(arm, minutes=minutes, seed=0),
            "`--prior`": plan(arm, minutes=minutes, seed=0, prior=prior),
        }
        spreads = {name: scatter(arm, motions, seeds, jobs=options.jobs) for name, motions in plans.items()}
        names = sorted(set.intersection(*map(set, spreads.values())) - {UNSHOWN})
        base = geometric_mean(spreads["the paper's experiment"], names)
        for name, motions in plans.items():
            predicted = [parameter for parameter in names if parameter in motions.expected]
            promise = f"{geometric_mean(motions.expected, predicted):.5f}" if predicted else ""
            mean = geometric_mean(spreads[name], names)
            yield row(f"{minutes:.1f}", name, len(motions.motions), promise, f"{mean:.5f}", f"{base / mean:.2f}")
        gains = {name: spreads["the paper's experiment"][name] / spreads["`--prior`"][name] for name in names}
        ranked = sorted(names, key=lambda name: gains[name])
        yield "gained: " + ", ".join(f"{name} {gains[name]:.2f}" for name in (*ranked[:5], *ranked[-5:]))


def through_logs(arm: Robot, motions: Plan, seed: int) -> Estimate:
    """One experiment on the robot of Table I, through its logs; held-out runs are not fitted."""
    logs = simulate(arm, motions, truth=replace(table1.puma560(), robot=arm), seed=seed, rate=100.0)
    return identify(match_with_plan(segment(logs, arm), motions, arm), replace(arm, effects=()))


def _values(arm: Robot, motions: Plan, seed: int) -> dict[str, float]:
    return {value.name: value.value for value in through_logs(arm, motions, seed).values if value.value is not None}


def scatter(arm: Robot, motions: Plan, seeds: Sequence[int], *, jobs: int) -> dict[str, float]:
    """Standard deviation of every estimate over experiments; what any of them does not have is left out."""
    count = len(seeds)
    with ProcessPoolExecutor(jobs) as pool:
        estimates = list(pool.map(_values, [arm] * count, [motions] * count, seeds))
    names = set.intersection(*map(set, estimates))
    return {name: float(np.std([values[name] for values in estimates], ddof=1)) for name in names}


def geometric_mean(errors: dict[str, float], names: Sequence[str]) -> float:
    """Of the errors of some parameters."""
    return float(np.exp(np.mean([np.log(errors[name]) for name in names])))


#: First seed of the clean experiments, and of those with a hidden effect; clean ones of the small arm and the PUMA.
CLEAN, HIDDEN, SMALL, LARGE = 610_000, 620_000, 300, 30
#: Levels at which p values of clean experiments are counted.
QUANTILES = (LEVEL, 0.1, 0.25, 0.5, 0.9)
#: Hidden effects: name, joint.
EFFECTS = (("spring", 1), ("stribeck", 2), ("warmup", 1), ("ripple", 2))
#: Experiments at the limit with the middle shape, at the limit with any shape, and at a third of it.
AT_MIDDLE, AT_ANY, BELOW = 60, 40, 20
#: Clean experiments whose limits are averaged.
ANNOUNCED = 10


def statistics(options: argparse.Namespace) -> Iterator[str]:
    """False findings and p values on clean data, and hits at the announced detection limits."""
    yield from clean()
    yield from hits()


def searching(truth: Truth, motions: Plan, seed: int) -> Stepwise:
    """A search on one experiment, not yet run."""
    runs = bench(truth, motions).runs(np.random.default_rng(seed))
    return Stepwise(Model.of_runs(truth.robot, runs), runs, begun=first_motions(runs))


def p_values(step: Step) -> dict[tuple[str, int | None], float]:
    """Family-wise p value of the best shape of each effect at each joint."""
    scale = step.scan.solved.scale
    seen = {key: best.surprise(scale) for key, best in step.scan.best().items()}
    seen |= {spectrum.key: spectrum.surprise(scale) for spectrum in step.scan.spectra}
    return {key: step.family.p_value(key, value) for key, value in seen.items()}


def bonferroni(step: Step) -> float:
    """p value of the best of the whole catalogue by chi-square, times as many as were tried."""
    scale = step.scan.solved.scale
    seen = [float(minus_log10_p(trial.statistic / scale, trial.width)) for trial in step.scan.trials]
    for spectrum in step.scan.spectra:
        seen += list(minus_log10_p(spectrum.statistic() / scale, 2))
    return min(1.0, len(seen) * 10.0 ** -max(seen))


def clean() -> Iterator[str]:
    """What is called missing of arms that lack nothing, and how p values are spread."""
    spread, smallest_of_all = [], []
    yield header("design", "something called missing", "a joint unexplained", "chi-square")
    for design in DESIGNS:
        missing, unexplained, smallest, theory = [], [], [], []
        for truth, count in ((drawn("pendulum2", 31), SMALL), (table1.puma560(), LARGE)):
            motions = designed(truth.robot, design, CLEAN)
            for seed in range(CLEAN, CLEAN + count):
                search = searching(truth, motions, seed)
                search.run()
                verdicts = DiagnosisBuilder(search, (), search.runs).verdicts.values()
                missing.append(bool(search.accepted))
                unexplained.append(any(joint.verdict == UNEXPLAINED_JOINT for joint in verdicts))
                smallest.append(min(p_values(search.steps[0]).values()))
                theory.append(bonferroni(search.steps[0]) <= LEVEL)
        yield row(design, interval(missing), interval(unexplained), interval(theory))
        spread.append((design, smallest))
        smallest_of_all += smallest
    yield "\n" + header("design", *(f"p <= {level:g}" for level in QUANTILES))
    for design, smallest in (*spread, ("all", smallest_of_all)):
        yield row(design, *(interval(p <= level for p in smallest) for level in QUANTILES))


def shapes_by_information(step: Step, name: str, joint: int) -> list[dict[str, float]]:
    """Shapes that the limit of an effect is the median of, the least visible first."""
    spectrum = next((waves for waves in step.scan.spectra if waves.key == (name, joint)), None)
    if spectrum is not None:
        return [{"frequency": float(spectrum.frequency[k])} for k in np.argsort(spectrum.information)]
    trials = [trial for trial in step.scan.trials if trial.added.key == (name, joint)]
    return [dict(trial.added.shape) for trial in sorted(trials, key=lambda trial: float(trial.information[0, 0]))]


def hiding(truth: Truth, name: str, joint: int, *, size: float, shape: dict[str, float], seed: int) -> Truth:
    """The arm with the effect: a wave of any phase, the sign that the physics has, either where it has none."""
    rng = np.random.default_rng([HIDDEN, seed])
    if name == "ripple":
        phase = rng.uniform(0.0, 2.0 * np.pi)
        values = {"cos": size * float(np.cos(phase)), "sin": size * float(np.sin(phase))}
    else:
        signs = catalogue()[name].signs(shape) or (0,)
        values = {"a": size * (signs[0] or float(rng.choice([-1.0, 1.0])))}
    return replace(truth, hidden=(Hidden(name, joint, {**values, **shape}),))


def hits() -> Iterator[str]:
    """Beyond chance, and called missing by its name or as a rival, at and below the announced limit of an effect."""
    truth = drawn("pendulum2", 31)
    motions = designed(truth.robot, FULL, HIDDEN)
    steps = [searching(truth, motions, HIDDEN + number).look([]) for number in range(ANNOUNCED)]
    announced = [detection_limits(step.scan, step.family) for step in steps]
    yield "\n" + header("effect", "limit", "beyond chance", "called missing", "of any shape", "at a third")
    for place, (name, joint) in enumerate(EFFECTS):
        sizes = [limits[name, joint].size for limits in announced]
        limit = float(np.mean([size for size in sizes if size is not None]))
        shapes, cells = shapes_by_information(steps[0], name, joint), []
        for block, (count, share) in enumerate(((AT_MIDDLE, 1.0), (AT_ANY, 1.0), (BELOW, 1.0 / 3.0))):
            beyond, named = [], []
            first = HIDDEN + 1000 * (place + 1) + 100 * block
            for seed in range(first, first + count):
                pick = int(np.random.default_rng(seed).integers(len(shapes))) if block == 1 else len(shapes) // 2
                arm = hiding(truth, name, joint, size=share * limit, shape=shapes[pick], seed=seed)
                step = searching(arm, motions, seed).look([])
                beyond.append(p_values(step).get((name, joint), 1.0) <= LEVEL)
                rivals = [step.chosen, *step.chosen.rivals] if step.chosen is not None else []
                named.append((name, joint) in [rival.key for rival in rivals])
            cells += [interval(beyond)] if block == 0 else []
            cells.append(interval(named))
        yield row(f"{name}@{joint}", f"{limit:.4g} {announced[0][name, joint].unit}", *cells)


TRIALS_BY_NAME = {trial.__name__: trial for trial in (accuracy, missing, motion, planning, statistics)}


def main() -> None:
    """Print the tables of one trial as they come."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("trial", choices=TRIALS_BY_NAME)
    parser.add_argument("-o", "--output", type=Path, help="where the figure of accuracy goes")
    parser.add_argument("--experiments", type=int, default=40, help="of planning, of what is missing, of each arm")
    parser.add_argument("--jobs", type=int, default=1, help="processes of motion, missing and planning")
    options = parser.parse_args()
    for line in TRIALS_BY_NAME[options.trial](options):
        print(line, flush=True)


if __name__ == "__main__":
    main()
