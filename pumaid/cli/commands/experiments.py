"""``pumaid init``, ``plan``, ``simulate`` and ``demo``: a recipe, what to run, and a robot that runs it."""

from __future__ import annotations

import math
import shlex
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import rich_click as click

from pumaid.cli import options
from pumaid.cli.output import document, notes, progress, remark, say, show, spare_inputs, write_result
from pumaid.errors import ModelError, PumaidError, ResultError, Where, listed, meant

if TYPE_CHECKING:
    from pumaid.experiment import Experiment
    from pumaid.robot import Robot
    from pumaid.simulation import Truth
    from pumaid.trajectory import Plan

# init


@click.command()
@click.argument("name", required=False)
@click.option("--list", "is_list", is_flag=True, help="List the robots that pumaid knows.")
@click.option("--joints", type=click.IntRange(1, 50), metavar="N", help="Joints of a blank recipe.  [default: 6]")
@click.option(
    "--urdf", type=options.FILE_OR_PIPE, metavar="FILE", help="Take the joints of this URDF, xacro or MJCF file."
)
@click.option("--base", metavar="LINK", help="Where the arm starts in the file.  [default: what nothing carries]")
@click.option("--tip", metavar="LINK", help="Where the arm ends in the file.  [default: where it splits]")
@click.option(
    "--arg", "arguments", type=(str, str), multiple=True, metavar="NAME VALUE", help="An argument of a xacro file."
)
@click.option("--preset", metavar="NAME", help="What writes the logs, such as ur-rtde or dynamixel-xm430.")
@options.force_option
@options.output_option("File or folder; - prints.  [default: recipe.yaml]")
@options.json_option
def init(
    *,
    name: str | None,
    is_list: bool,
    joints: int | None,
    urdf: Path | None,
    base: str | None,
    tip: str | None,
    arguments: tuple[tuple[str, str], ...],
    preset: str | None,
    force: bool,
    output: Path | None,
    as_json: bool,
) -> None:
    """Write a recipe to start from: a robot that pumaid knows, one described by a file, or a blank one to fill in.

    NAME is a robot's name from --list, or blank. In a terminal without NAME it asks for robot and logs.

    \b
    Example:
      pumaid init --list
      pumaid init ur5e -o my_arm/recipe.yaml
      pumaid init --urdf my_arm.urdf --tip tool0 -o my_arm/recipe.yaml
      pumaid init blank --joints 4
    """
    from pumaid.io.recipe import parsed_recipe, read_recipe
    from pumaid.io.urdf import UrdfRecipe
    from pumaid.reporting.run_tables import axes_table

    if is_list:
        _list_robots(as_json)
        return
    if any(value not in (None, ()) for value in ((base, tip, arguments) if urdf is None else (name, joints))):
        raise click.UsageError("NAME, --joints or --urdf FILE, --base, --tip, --arg: these are two recipes.")
    is_asking = name is None and urdf is None and sys.stdin.isatty() and sys.stdout.isatty()
    text = "" if urdf or is_asking else _recipe_text(name, joints)
    path = output / "recipe.yaml" if output and output.is_dir() else output or Path("recipe.yaml")
    spare_inputs([path], [urdf], new=() if force else (path,))
    text = _asked_recipe() if is_asking else text
    facts: dict[str, Any] = {}
    if urdf is not None:
        made = UrdfRecipe(urdf, base=base, tip=tip, arguments=dict(arguments))
        text = made.text
        facts["urdf"] = {"file": made.urdf.file, "base": made.base, "tip": made.tip}
        notes(made.notes)
    if preset is not None:
        text = f"{text.rstrip()}\n\nlog: {{preset: {preset}}}\n"
        parsed_recipe(text.encode(), f"--preset {preset}")
    if str(path) == "-":
        document(facts | {"text": text}, "recipe") if as_json else write_result(path, text.rstrip() + "\n")
        return
    write_result(path, text)
    robot = read_recipe(path)
    if as_json:
        facts |= {"file": str(path), "robot": robot.name, "joints": robot.n_joints, "sha256": robot.digest}
        document(facts, "recipe")
        return
    if urdf is not None:
        show(axes_table(robot))
    remark(f"wrote {path}: {robot.name}, {robot.n_joints} joints; check it, then pumaid identify or pumaid plan {path}")


def _recipe_text(name: str | None, joints: int | None) -> str:
    from pumaid.io.recipe import blank, shipped_recipes, started_from

    names = [*shipped_recipes(), "blank"]
    if name not in names:
        raise click.UsageError(
            f"There is no robot {name}: {meant(name, names)}; a URDF, xacro or MJCF file goes after --urdf."
            if name
            else f"Which one? {listed(names)}; or --urdf FILE."
        )
    if name != "blank" and joints is not None:
        raise click.UsageError(f"--joints is for a blank recipe; {name} has its own.")
    return blank(joints or 6) if name == "blank" else started_from(name)


def _asked_recipe() -> str:
    """The text of a recipe of the robot that the user names, with the `log` block of the logs that are named."""
    from pumaid.io.paths import expand
    from pumaid.io.recipe import parsed_recipe
    from pumaid.io.urdf import UrdfRecipe
    from pumaid.preprocessing.ingest import ingest

    name = click.prompt("Robot (a name of pumaid init --list, or a URDF, xacro or MJCF file)", err=True)
    made = UrdfRecipe(Path(name)) if Path(name).is_file() else None
    notes(made.notes if made else ())
    recipe = made.text if made else _recipe_text(name, None)
    logs = click.prompt("Logs (a file or folder; Enter if there are none yet)", "", show_default=False, err=True)
    if not logs:
        return recipe
    paths = expand([logs])[:1]
    try:
        dataset = ingest(paths, parsed_recipe(recipe.encode(), "recipe.yaml"))
        text = "".join(note.text for note in dataset.notes if note.slug == "columns-named")
    except PumaidError as error:
        text = str(getattr(error, "faults", [error])[0])
    remark(text or "The log has the columns of the recipe.")
    _, is_offered, lines = text.partition("log:\n")
    is_right = bool(is_offered) and click.confirm("Do the columns mean that?", default=True, err=True)
    return f"{recipe.rstrip()}\n\n{is_offered}{lines}\n" if is_right else recipe


def _list_robots(as_json: bool) -> None:
    from pumaid.io.recipe import read_recipe, shipped_recipes
    from pumaid.reporting.table import Table

    robots = {name: read_recipe(path) for name, path in shipped_recipes().items()}
    rows = [{"name": name, "robot": robot.name, "joints": robot.n_joints} for name, robot in robots.items()]
    if as_json:
        document({"recipes": rows}, "recipes")
    else:
        rows += [{"name": "blank", "robot": "to fill in, any number of joints", "joints": "--joints N"}]
        show(Table("", ("name", "robot", "joints"), [list(map(str, row.values())) for row in rows], words=(0, 1)))


# plan

#: Notes that ask for attention where a given plan is checked.
ATTENTION = ("plan-strikes", "plan-lacks", "plan-dark", "plan-unusable")


@click.command()
@click.argument("recipe", type=options.FILE, required=False, metavar="[RECIPE]")
@click.option("--minutes", type=float, metavar="M", help="Robot time, moves included.")
@click.option(
    "--motion",
    type=click.Choice(["fourier", "picks"]),
    metavar="KIND",
    help="All joints at once: fourier or picks. [2 min]",
)
@click.option("--prior", type=options.FILE, metavar="MODEL", help="A model of the arm to plan for.")
@click.option(
    "--payload",
    callback=options.separated(click.FLOAT, 4),
    metavar="KG,X,Y,Z",
    help="The last link carries KG at X,Y,Z (m; its frame in the recipe).",
)
@click.option("--check", type=options.FILE, metavar="PLAN", help="What PLAN promises; exit code 1 if it lacks any.")
@click.option(
    "--format",
    "form",
    type=click.Choice(["yaml", "csv", "urscript", "ros2"]),
    default="yaml",
    metavar="FORM",
    help="yaml, csv, urscript or ros2.",
)
@options.force_option
@options.output_option("The plan; - prints. [default: plan.yaml]")
@options.seed_option
@options.json_option
def plan(
    *,
    recipe: Path | None,
    form: str,
    force: bool,
    output: Path | None,
    as_json: bool,
    **asked: Any,
) -> bool:
    """Plan the runs that tell most of an arm in the time that it has.

    With --check: what a plan promises and lacks. RECIPE is a file or the name of a shipped one; else recipe.yaml here.

    \b
    Example:
      pumaid plan recipe.yaml --minutes 30 --prior results/model.json
      pumaid plan recipe.yaml --motion fourier --minutes 2
      pumaid plan ur5e --payload 0.5,0.1,0,0
      pumaid plan --check plan.yaml --format urscript -o plan.script
    """
    from pumaid.experiment import Experiment
    from pumaid.io.plan_file import PLAN_NAME, PROGRAMS, plan_document, plan_text
    from pumaid.reporting.run_tables import plan_tables
    from pumaid.trajectory import Plan

    given = asked["check"]
    if given is not None and (asked["minutes"] is not None or asked["motion"] is not None):
        raise click.UsageError("--check looks at a plan, which has its time and kind of motion already.")
    if given is not None and recipe is None:
        recipe = Experiment((str(given),)).recipe_path  # a plan lies beside its recipe
    experiment = Experiment(recipe=recipe, tell=remark)
    robot, path = experiment.robot, output
    suffix, text_of = PROGRAMS.get(form) or (f".{form}", partial(plan_text, format=form))
    if given is None:
        text_of(Plan(robot.name, ()), robot)  # an arm that the form cannot move is refused before the work
        path = output or (experiment.folder / PLAN_NAME).with_suffix(suffix)
    inputs = [file for file in experiment.files(asked["prior"], given) if file.name != PLAN_NAME or file == given]
    spare_inputs([path], inputs, new=() if force else (path,))
    with progress("planning") as step:
        made = _plan(experiment, options=asked, tell=lambda text: step(0.0, text))
    is_piped = str(path) == "-"
    if path is not None and not is_piped:
        write_result(path, text_of(made, robot), "plan")
    notes(made.notes)
    if as_json:
        document(plan_document(made, robot))
    elif is_piped:
        write_result(Path("-"), text_of(made, robot).rstrip("\n") + "\n")
    else:
        show(*plan_tables(made, robot))
    return given is not None and any(note.slug in ATTENTION for note in made.notes)


def _plan(experiment: Experiment, *, options: dict[str, Any], tell: Callable[[str], None]) -> Plan:
    """The plan that the options (name -> value) ask for, or the one that ``--check`` names with what it promises."""
    from pumaid.design import motion
    from pumaid.design import plan as design
    from pumaid.io.plan_file import read_plan

    robot = experiment.robot
    given = None if options["check"] is None else read_plan(options["check"], robot)
    shared: dict[str, Any] = {
        "prior": None if options["prior"] is None else experiment.model(options["prior"]),
        "payload": options["payload"],
        "seed": options["seed"],
        "tell": tell,
    }
    if given is not None:
        check = design.check_plan if given.trajectory is None else motion.check_motion
        return check(robot, given, **shared)
    if options["motion"] is not None:
        return motion.plan_motion(robot, options["motion"], minutes=options["minutes"], **shared)
    return design.plan(robot, minutes=options["minutes"], **shared)


# simulate


@click.command()
@click.argument("recipe", type=options.FILE, required=False, metavar="[RECIPE]")
@click.option("--plan", "runs", type=options.FILE_OR_PIPE, metavar="FILE", help="The plan; else beside the recipe.")
@options.output_option("Folder of the logs; else logs/.")
@click.option(
    "--hide", multiple=True, metavar="EFFECT[@JOINT]", help="An effect that it has: stribeck@3:a=0.2; repeatable."
)
@options.effects_option
@click.option("--rate", type=float, default=250.0, metavar="HZ", help="Samples a second.")
@click.option("--noise", type=click.FloatRange(0, 1e6), metavar="A", help="Noise of every current; 0 for none.")
@click.option(
    "--format", "form", type=click.Choice(["parquet", "csv"]), default="parquet", help="Form of the log files."
)
@click.option("--no-velocity", is_flag=True, help="Leave velocities out of the logs.")
@click.option("--temperature", "has_temperature", is_flag=True, help="Write the motors' temperatures, too.")
@click.option("--runs-per-file", type=click.IntRange(min=1), default=40, metavar="N", help="Runs in a log file.")
@options.force_option
@options.seed_option
@options.json_option
@options.of_experiment
def simulate(
    *,
    experiment: Experiment,
    runs: Path | None,
    output: Path | None,
    hide: tuple[str, ...],
    noise: float | None,
    form: str,
    no_velocity: bool,
    force: bool,
    seed: int,
    as_json: bool,
    **logging: Any,
) -> None:
    """Let a virtual robot execute a plan in closed loop and write logs as a real one would.

    Its masses, motors, friction and noise are drawn from the seed and written to truth.json in the logs' folder. RECIPE
    is a file or the name of a shipped one; else recipe.yaml here.

    \b
    Example:
      pumaid simulate recipe.yaml --plan plan.yaml -o logs/ --seed 7
      pumaid simulate --hide stribeck@3:a=0.2 --hide spring@2 -o hidden/
    """
    from pumaid.io import plan_file, write
    from pumaid.reporting.table import Table
    from pumaid.results.truth_file import as_json as truth_json
    from pumaid.simulation import session

    if str(output) == "-":
        raise click.UsageError("-o names the folder of the logs and of truth.json.")
    folder = output or experiment.folder / "logs"
    robot = experiment.robot
    read = plan_file.read_plan(runs or experiment.folder / plan_file.PLAN_NAME, robot)
    notes(note for note in read.notes if note.slug == "plan-other-robot")
    if any(motion.payload for motion in read.motions):
        mend = "simulate the loaded runs apart, by a recipe whose robot has the load"
        raise ModelError("plan-payload", "runs of this plan carry loads, which no virtual robot takes up", mend=mend)
    virtual = _virtual_robot(robot, hide=hide, noise=noise, seed=seed)
    logs = session.simulate(robot, read, seed=seed, truth=virtual, has_velocity=not no_velocity, **logging)
    with progress("simulating", total=read.duration or None) as step:
        files = write.write_session(
            folder,
            logs,
            robot,
            form=form,
            force=force,
            truth=truth_json(virtual, seed=seed),
            progress=lambda seconds: step(seconds, f"{seconds:.0f} s of robot time"),
        )
    if as_json:
        entries = [dict(zip(("file", "samples", "start", "end"), entry, strict=True)) for entry in files]
        document({"robot": robot.name, "seed": seed, "files": entries}, "simulation")
    else:
        rows = [[name, f"{samples:,}", f"{start:.1f}", f"{end:.1f}"] for name, samples, start, end in files]
        show(Table("", ("file", "samples", "from (s)", "to (s)"), rows))
    remark(f"logs and truth.json written to {folder}")


def _virtual_robot(robot: Robot, *, hide: Sequence[str], noise: float | None, seed: int) -> Truth:
    from pumaid.simulation import draw, hidden_effects

    virtual = draw(robot, seed)
    virtual = virtual.hiding([hidden_effects.parse(text, robot) for text in hide]) if hide else virtual
    if noise is not None and not math.isfinite(noise):
        raise click.BadParameter(f"{noise} is no noise", param_hint="--noise")
    return virtual if noise is None else virtual.with_noise(noise)


# demo

#: The robot's minutes a joint and Hz of its log: enough to find an effect, little enough for a minute of the user's.
MINUTES, RATE = 20 / 6, 50
#: Effects that are hidden by turns; any joint can have them.
KINDS = ("stribeck", "ripple", "friction_step", "position_friction", "warmup")


@click.command()
@click.argument("folder", type=options.FILE, default=Path("pumaid_demo"), metavar="[FOLDER]")
@click.option("--robot", default="puma560", metavar="NAME", help="The arm; pumaid init lists them.")
@click.option("--motion", "is_motion", is_flag=True, help="All joints move at once, for two minutes.")
@options.seed_option
@options.json_option
def demo(*, folder: Path, robot: str, is_motion: bool, seed: int, as_json: bool) -> None:
    """Tell the whole story on a virtual arm that hides a physical effect, in under a minute.

    Makes an experiment in FOLDER (pumaid_demo where not given), runs the commands that a user would type there, and
    shows what they print. The effect and its joint follow from the seed; no command but simulate is told. At the end
    stands what was hidden, and what diagnosis named.

    \b
    Example:
      pumaid demo
      pumaid demo my_demo --seed 7
      pumaid demo --motion
    """
    from pumaid.diagnosis.records import ADD, read_diagnosis
    from pumaid.io.write import read_truth

    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ResultError(
            "file-exists",
            f"{folder} is there already and is not empty",
            Where(file=str(folder)),
            "name another folder: pumaid demo FOLDER",
        )
    steps: list[dict[str, Any]] = []
    with progress("demo") as step:
        for done in _story(folder, robot=robot, is_motion=is_motion, seed=seed):
            steps.append(done)
            step(len(steps), done["command"])
            if not as_json:
                say(f"$ {done['command']}\n{done['told']}")
    (secret,) = read_truth(folder / "logs" / "truth.json")["hidden"]
    diagnosis, named = read_diagnosis(folder / "results" / "diagnosis.json"), []
    for finding in (*diagnosis.applied, *diagnosis.findings):
        rivals = f" (or {', '.join(finding.rivals)})" if finding.rivals else ""  # what these data cannot tell from it
        named += [f"{finding.effect}@{finding.joint or 'all'}{rivals}"] if finding.verdict == ADD else []
    hidden = f"{secret['effect']}@{secret['joint']}"
    if as_json:
        document({"folder": str(folder), "seed": seed, "steps": steps, "hidden": hidden, "named": named}, "demo")
    else:
        say(f"What was hidden: {hidden}. What diagnosis named: {', '.join(named) or 'nothing'}.")


def _story(folder: Path, *, robot: str, is_motion: bool, seed: int) -> Iterator[dict[str, Any]]:
    """Run the commands in a new experiment, one after the other; none opens ``logs/truth.json`` with the secret."""
    from pumaid.io.recipe import read_recipe

    recipe, logs, model = (str(folder / name) for name in ("recipe.yaml", "logs", "results/model.json"))
    yield run("init", robot, "-o", recipe)
    joints, numbered = read_recipe(Path(recipe)).n_joints, ["--seed", str(seed)]
    secret = f"{KINDS[seed % len(KINDS)]}@{1 + seed * 7 // len(KINDS) % joints}"
    shape = ["--motion", "fourier", "--minutes", "2"] if is_motion else ["--minutes", str(round(MINUTES * joints))]
    yield run("plan", recipe, *shape, *numbered)
    yield run("simulate", recipe, "--hide", secret, *numbered, *([] if is_motion else ["--rate", str(RATE)]))
    yield run("identify", logs)
    yield run("compare", model, logs)
    yield run("diagnose", model, logs, "--apply")
    yield run("report", model, logs, "--format=")


def run(*words: str) -> dict[str, Any]:
    """Run ``pumaid`` with some words, in this process: the line, and what it printed.

    ResultError [step-failed] where it fails.
    """
    from click.testing import CliRunner

    from pumaid.cli import EXIT_INTERRUPTED, group

    line = shlex.join(["pumaid", *words])
    done = CliRunner().invoke(group, words, catch_exceptions=False, prog_name="pumaid", standalone_mode=False)
    code, remarks = done.return_value, done.stderr.strip()
    if code == EXIT_INTERRUPTED:
        raise KeyboardInterrupt
    if code:
        raise ResultError("step-failed", f"'{line}' left with exit code {code}: {remarks}", mend="mend what it says")
    return {"command": line, "told": done.stdout or f"{remarks.splitlines()[-1]}\n"}
