"""The demo's story: which commands follow each other, and what each showed, in a sentence."""

from __future__ import annotations

import itertools
import json
import os
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pumaid.cli.rehearsal import Step, run
from pumaid.errors import ModelError, RecipeError, ResultError, Where
from pumaid.units import number

#: The file by which a folder is known to be a demo's.
MARK = "demo.json"
#: What a demo makes in its folder.
MADE = ("recipe.yaml", "plan.yaml", "logs", "results", MARK)
#: The robot's minutes a joint and Hz of its log: enough to find an effect, little enough for a minute of the user's.
MINUTES, RATE = 20 / 6, 50

Document = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Told:
    """A step of the story: the command that was run, and what it showed."""

    step: Step
    sentence: str


def check(robot: str, effect: str | None, *, seed: int) -> None:
    """Refuse what no demo can be made of, before an earlier one makes room for it.

    Parameters
    ----------
    robot
        Name of a shipped recipe.
    effect
        What is hidden, or none where that is left open.
    seed
        Of the robot.

    Raises
    ------
    RecipeError [recipe-not-found]
        There is no such robot.
    ModelError [hide-wrong]
        There is no such effect, or this robot cannot have it.
    """
    from pumaid.io.recipe import read_recipe, shipped_recipes
    from pumaid.simulation.draw import draw
    from pumaid.simulation.hidden import LAWS, Hidden, sized

    shipped = shipped_recipes()
    if robot not in shipped:
        raise RecipeError("recipe-not-found", f"there is no robot {robot!r}", Where(), f"known: {', '.join(shipped)}")
    if effect is None:
        return
    if effect not in LAWS:
        raise ModelError("hide-wrong", f"{effect!r} is no effect", Where(field=effect), f"known: {', '.join(LAWS)}")
    truth = draw(read_recipe(shipped[robot]), seed)
    joints = [None, *range(1, truth.robot.n_joints + 1)]
    refusals = []
    for joint in joints:
        try:
            sized([Hidden(effect, joint)], truth)
        except ModelError as error:
            refusals.append(error)
    if len(refusals) == len(joints):
        raise refusals[-1]


def make_room(folder: Path) -> None:
    """An empty folder for a demo: an earlier demo's files are removed, anybody else's are not touched.

    Raises
    ------
    ResultError [demo-in-the-way]
        The folder holds something that no demo made; nothing is removed.
    """
    if folder.exists() and not folder.is_dir():
        raise _in_the_way(folder, folder)
    files, folders = _contents(folder)
    strange = _strange(folder, files, folders)
    if strange is not None:
        raise _in_the_way(folder, strange)
    # The mark goes last: what is left by an end on the way is known as a demo's.
    for path in sorted(files, key=lambda path: path == folder / MARK):
        path.unlink()
    for path in sorted(folders, reverse=True):
        path.rmdir()
    folder.mkdir(parents=True, exist_ok=True)
    mark(folder)


def mark(folder: Path) -> None:
    """Write into a demo's folder which files the demo has made there; a later demo may remove these and no others."""
    content = {"kind": "demo", "format": 1, "made": made(folder)}
    (folder / MARK).write_text(json.dumps(content) + "\n", encoding="utf-8")


def made(folder: Path) -> list[str]:
    """The files in a demo's folder, which was empty when it began; paths below it, with ``/``."""
    return [path.relative_to(folder).as_posix() for path in _contents(folder)[0] if not path.is_symlink()]


def _contents(folder: Path) -> tuple[list[Path], list[Path]]:
    """Files and folders below a folder, in order; links are files, wherever they lead."""
    files: list[Path] = []
    folders: list[Path] = []
    for root, below, names in os.walk(folder):
        paths = [Path(root) / name for name in below]
        folders += [path for path in paths if not path.is_symlink()]
        files += [path for path in paths if path.is_symlink()] + [Path(root) / name for name in names]
    return sorted(files), sorted(folders)


def _strange(folder: Path, files: Sequence[Path], folders: Sequence[Path]) -> Path | None:
    """The first file or folder that no demo made; None where there is none."""
    marked = folder / MARK
    if marked.is_symlink() or not marked.is_file():
        return next(iter(sorted([*files, *folders])), None)
    try:
        listed = json.loads(marked.read_text(encoding="utf-8")).get("made")
    except (ValueError, AttributeError):
        return marked
    own = {marked, *(folder / str(name) for name in (listed if isinstance(listed, list) else ()))}
    around = {folder / name for name in MADE} | {above for path in own for above in path.parents}
    others = [path for path in files if path.is_symlink() or path not in own]
    return next(iter([*others, *(path for path in folders if path not in around)]), None)


def _in_the_way(folder: Path, strange: Path) -> ResultError:
    name = strange.name if strange == folder else strange.relative_to(folder).as_posix()
    what = f"{folder} is no earlier demo alone: it holds {name}, which no demo made"
    return ResultError("demo-in-the-way", what, Where(file=str(strange)), "name another folder: pumaid demo FOLDER")


def story(folder: Path, *, robot: str, seed: int, surprise: str | None) -> Iterator[Told]:
    """Run the commands one after the other; what a step shows decides what the next ones are.

    None of them opens ``logs/truth.json``, in which the robot's secret lies.

    Parameters
    ----------
    folder
        The experiment.
    robot
        Name of a shipped recipe.
    seed
        Of the plan and of the robot.
    surprise
        What ``simulate --surprise`` is given; none for a robot with nothing hidden.
    """
    recipe, logs, model = (str(folder / name) for name in ("recipe.yaml", "logs", "results/model.json"))
    arm = _told(["init", robot, "-o", recipe, "--force"], _arm)
    yield arm
    minutes = str(round(MINUTES * arm.step.answer["joints"]))
    yield _told(["plan", recipe, "--minutes", minutes, "--seed", str(seed), "--force"], _plan)
    secret = [] if surprise is None else ["--surprise", surprise]
    yield _told(["simulate", recipe, *secret, "--seed", str(seed), "--rate", str(RATE), "--force"], _simulated)
    yield _told(["identify", logs], _identified)
    yield _told(["compare", model, logs], _compared)
    diagnosed = _told(["diagnose", model, logs], _diagnosed)
    yield diagnosed
    wanted = additions(diagnosed.step.answer)
    if wanted:
        yield _told(["identify", logs, *(word for one in wanted for word in ("--add", one))], _identified)
        yield _told(["diagnose", model, logs], _diagnosed_again)
    yield _told(["history", str(folder)], _climbed)
    yield _told(["report", model, logs, "--format="], _reported)


def _told(words: list[str], sentence: Callable[[Document], str]) -> Told:
    step = run(words)
    try:
        return Told(step, sentence(step.answer))
    except (KeyError, TypeError, IndexError) as error:
        what = f"the document that '{step.line}' printed lacks {error}"
        raise ResultError("step-failed", what, Where(), "run the line yourself with --json") from error


def findings(answer: Document) -> list[Document]:
    """What a diagnosis says should be added, strongest first."""
    return [found for found in answer["findings"] if found["verdict"] == "add"]


def additions(answer: Document) -> list[str]:
    """Words for ``identify --add``: as the findings' own commands have them, else effect and joint."""
    out = []
    for found in findings(answer):
        words = shlex.split(found.get("command") or "")
        named = [word for before, word in itertools.pairwise(words) if before == "--add"]
        out += named or [place(found)]
    return list(dict.fromkeys(out))


def place(found: Document) -> str:
    """``stribeck@3``, or the effect alone where it is the whole arm's."""
    return str(found["effect"]) + ("" if found.get("joint") is None else f"@{found['joint']}")


def _amperes(value: float | None) -> str:
    return "unknown" if value is None else f"{1e3 * value:.3g} mA"


def _arm(answer: Document) -> str:
    return f"The recipe of a {answer['robot']} with {answer['joints']} joints: geometry and limits, nothing else."


def _plan(answer: Document) -> str:
    runs = answer["runs"]
    kept = sum(run["purpose"] == "heldout" for run in runs)
    return (
        f"{len(runs)} runs in {number(answer['duration'] / 60.0, 3)} minutes of the robot's time, in which every joint"
        f" runs alone; {kept} are kept for judging and never fitted."
    )


def _simulated(answer: Document) -> str:
    samples = sum(part["samples"] for part in answer["files"])
    return f"A robot with masses and friction of its own made the runs: {samples:,} samples, its secret sealed beside."


def _identified(answer: Document) -> str:
    added = ", ".join(place(one) for one in answer.get("effects", ()))
    joints = [joint for joint in answer["joints"] if joint.get("rmse") is not None]
    worst = max(joints, key=lambda joint: joint["rmse"] / (joint.get("noise_floor") or joint["rmse"]))
    count = sum(len(joint["parameters"]) for joint in answer["joints"])
    return (
        f"Weight and friction{f', and {added},' if added else ''} in {count} parameters; farthest above its noise is"
        f" joint {worst['joint']}: {_amperes(worst['rmse'])} where repeated runs differ by"
        f" {_amperes(worst.get('noise_floor'))}."
    )


def _compared(answer: Document) -> str:
    joints = [joint for joint in answer["joints"] if joint.get("rmse") is not None and joint.get("noise_floor")]
    above = [str(joint["joint"]) for joint in joints if joint["rmse"] > 1.15 * joint["noise_floor"]]
    where = f"joint{'s' if len(above) > 1 else ''} {', '.join(above)}" if above else "no joint"
    return f"Over all runs the model is off by {_amperes(answer['rmse'])}; clearly more than noise at {where}."


def _diagnosed(answer: Document) -> str:
    found = findings(answer)
    if found:
        told = "; ".join(_finding(one) for one in found)
        return f"Missing: {told}."
    unexplained = [str(joint["joint"]) for joint in answer["joints"] if joint["verdict"] == "unexplained"]
    if unexplained:
        return f"Something is missing at joint {', '.join(unexplained)} that no known effect explains."
    return "Nothing is missing that these data can show."


def _finding(found: Document) -> str:
    chance = found.get("p_value")
    rivals = [str(rival).replace("@", " at joint ") for rival in found.get("rivals") or ()]
    told = place(found)
    if chance is not None:
        told += f" (by chance alone: {number(max(chance, 1e-4), 2)})"
    return told + (f", which these data cannot tell from {' or '.join(rivals)}" if rivals else "")


def _diagnosed_again(answer: Document) -> str:
    more = findings(answer)
    return f"Still {_diagnosed(answer)[0].lower()}{_diagnosed(answer)[1:]}" if more else _diagnosed(answer)


def _climbed(answer: Document) -> str:
    models = answer["ladders"][0]["models"]
    parts = []
    for key, words in (("rmse", "runs that were fitted"), ("heldout", "runs that no fit saw")):
        first, last = models[0].get(key), models[-1].get(key)
        if first is not None and last is not None:
            parts.append(f"{_amperes(first)} to {_amperes(last)} on {words}")
    floor = models[-1].get("noise_floor")
    end = f"; the noise floor is {_amperes(floor)}" if floor is not None else ""
    if len(models) == 1:
        return f"One model, and no reason for another{end}."
    return f"The error went from {', and from '.join(parts)}{end}."


def _reported(answer: Document) -> str:
    page = next((file for file in answer["files"] if str(file).endswith(".html")), answer["files"][-1])
    return f"All of it on one page: {page}."


def verdict(hidden: Sequence[Document], answer: Document) -> tuple[str, str]:
    """Whether a diagnosis was right, in a word and in a sentence.

    Parameters
    ----------
    hidden
        What ``truth.json`` says was hidden: nothing, or one effect.
    answer
        The document of the first ``pumaid diagnose``.

    Returns
    -------
    word
        ``named``, ``in the set``, ``wrong`` or ``missed``; ``left alone`` or ``wrong`` where nothing was hidden.
    sentence
        The same for people, with what it named beside.
    """
    found = findings(answer)
    if not hidden:
        if found:
            return "wrong", f"Wrong: nothing was hidden, and diagnosis named {', '.join(map(place, found))}."
        return "left alone", "Right: nothing was hidden, and nothing was found."
    true = hidden[0]
    others = [place(one) for one in found if place(one) != place(true)]
    if place(true) in map(place, found):
        beside = f"; but it named {', '.join(others)} as well, which is not there" if others else ""
        return "named", f"Right: diagnosis named {place(true)}{beside}."
    alike = [one for one in found if _is_rival(true, one)]
    if alike:
        return "in the set", (
            f"In the set: diagnosis named {place(alike[0])} and said that these data cannot tell it from"
            f" {true['effect']}, which it is."
        )
    if found:
        return "wrong", f"Wrong: it is {place(true)}, and diagnosis named {', '.join(others)}."
    strange = [str(joint["joint"]) for joint in answer["joints"] if joint["verdict"] == "unexplained"]
    if strange:
        told = f"it saw that something is missing at joint {', '.join(strange)} and could not name {place(true)}"
        return "missed", f"Missed: {told}."
    return "missed", f"Missed: {place(true)} was hidden, and diagnosis found nothing."


def _is_rival(true: Document, found: Document) -> bool:
    """Whether a finding keeps the hidden effect among its rivals, at the same joint or where one is the whole arm's."""
    for rival in found.get("rivals") or ():
        name, at, joint = str(rival).partition("@")
        own = int(joint) if at else found.get("joint")
        if name == true["effect"] and (true["joint"] is None or own is None or own == true["joint"]):
            return True
    return False


def secret(folder: Path) -> list[dict[str, Any]]:
    """What was hidden, from ``logs/truth.json``: to be opened when all is said."""
    document = json.loads((folder / "logs" / "truth.json").read_text(encoding="utf-8"))
    hidden: list[dict[str, Any]] = document["hidden"]
    return hidden
