"""A model for other programs; a form of export is listed by a file under ``formats``, and found by looking there."""

import functools
import importlib
import keyword
import pkgutil
import re
import textwrap
import unicodedata
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jinja2

from pumaid.effect_spec import check_parameters
from pumaid.estimate import Estimate
from pumaid.exports import formats
from pumaid.exports.equivalent_bodies import Bodies, bodies
from pumaid.exports.formulas import Formulas, Lack
from pumaid.results.documents import check_same_recipe
from pumaid.robot import Robot

#: Width of text in comments.
WIDTH = 108


@dataclass(frozen=True, eq=False, slots=True)
class Subject:
    """What is exported: the model, a name for files and functions, and bodies of its weight for forms with masses."""

    formulas: Formulas
    name: str
    bodies: Bodies | None


@dataclass(frozen=True, eq=False, slots=True)
class Exported:
    """A model in another form: its files' texts by suffix, in the order in which they are written.

    `left_out` is what the form does not hold (effects, and what the format has no place for), `undetermined` are
    parameters that the data did not tell.
    """

    form: str
    name: str
    files: Mapping[str, str]
    left_out: tuple[Lack, ...]
    undetermined: tuple[Lack, ...]
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Form:
    """A way to write a model down for another program; a module of ``formats`` lists its own, by name, in ``FORMS``.

    `write` returns suffix -> text of each file, and what is not in the files. A form that `has_bodies` writes masses,
    and so needs torque constants; it may have a way to `write_into` a file that is there.
    """

    write: Callable[[Subject], tuple[dict[str, str], tuple[Lack, ...]]]
    has_bodies: bool = False
    write_into: Callable[..., Exported] = Exported


@functools.cache
def every_form() -> Mapping[str, Form]:
    """Every form by its name, as ``--format`` takes it."""
    names = [module.name for module in pkgutil.iter_modules(formats.__path__, f"{formats.__name__}.")]
    return {form: write for name in names for form, write in importlib.import_module(name).FORMS.items()}


def export(
    estimate: Estimate,
    robot: Robot,
    *,
    form: str = "",
    name: str = "",
    torque_constants: Mapping[int, float] | None = None,
    into: str | None = None,
) -> Exported:
    """Write a model down for another program, or its friction into a URDF or MJCF; nothing is written to disk.

    Parameters
    ----------
    estimate, robot
        The model, and the arm by the recipe that the model was made with.
    form
        ``c``, ``python``, ``json``, ``matlab``, ``urdf`` or ``mjcf``.
    name
        For functions and files; made from the robot's name where not given.
    torque_constants
        Joint (from 1) -> N m/A, or N/A of a slide, for forms with masses; where not given, those that known loads
        showed. Others follow from the ratios of gains.
    into
        Instead of a form: the text of a URDF or MJCF, of which the joints' friction, damping and armature are changed.

    Raises
    ------
    ModelError [model-other-recipe], [unknown-effect], [effect-changed]
        The model is of another recipe, or holds an effect that is not here.
    ModelError [torque-constants]
        No masses have the weight that the model says; or, of a text, a joint's current cannot be turned into a torque.
    RecipeError [into-refused]
        The text does not have the recipe's joints.
    """
    check_same_recipe(estimate, robot)
    check_parameters(estimate, robot)
    formulas = Formulas.of(estimate, robot)
    if into is not None:
        return every_form()["urdf"].write_into(formulas, into, identifier(name or robot.name), given=torque_constants)
    chosen = every_form()[form]
    chain = bodies(formulas, torque_constants) if chosen.has_bodies else None
    subject = Subject(formulas, identifier(name or robot.name), chain)
    files, left_out = chosen.write(subject)
    return Exported(
        form=form,
        name=subject.name,
        files=files,
        left_out=left_out,
        undetermined=formulas.undetermined,
        remarks=chain.remarks if chain else (),
    )


def rendered(
    templates: Sequence[str],
    values: Mapping[str, Any],
    *,
    filters: Mapping[str, Callable[..., str]] | None = None,
    is_xml: bool = False,
) -> dict[str, str]:
    """Texts of files by suffix, what a template is called behind ``model``; XML is escaped."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("pumaid.exports"),
        autoescape=is_xml,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters |= filters or {}
    return {
        name.removeprefix("model").removesuffix(".txt"): environment.get_template(name).render(values)
        for name in templates
    }


# Names and heads of files

#: Words that are no name in C or MATLAB; Python's own are asked of Python.
RESERVED = frozenset(
    re.findall(
        r"\w+",
        "auto break case char const continue default do double else enum extern float for goto if inline int long"
        " register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while"
        " end function otherwise parfor persistent global spmd elseif classdef catch main",
    )
)

#: MATLAB cuts names at 63 characters; what is put behind one has room.
LONGEST = 40


def identifier(text: str) -> str:
    """A lower-case name of letters, digits and underscores, close to `text`; ``arm`` where nothing is left of it."""
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    name = re.sub(r"[^a-z0-9]+", "_", plain.lower()).strip("_")[:LONGEST].strip("_") or "arm"
    name = f"arm_{name}" if name[0].isdigit() else name
    return f"{name}_model" if name in RESERVED or keyword.iskeyword(name) else name


def commented(text: str) -> str:
    """`text` on one line, without what ends or begins a comment in C, XML, MATLAB or Python, quotes and braces kept."""
    line = "".join(letter if letter.isprintable() else " " for letter in " ".join(text.split())).replace("*/", "* /")
    line = line.replace("/*", "/ *").replace("??", "? ?").replace("\\", "/")
    return line.replace('"""', "'''").replace("--", "- -").replace("--", "- -")


def title(formulas: Formulas) -> str:
    """A line: which arm, by which program."""
    parts = "gravity, inertia and friction" if formulas.is_dynamic else "gravity and friction"
    return commented(f"{formulas.robot.name}: motor currents of {parts}, by pumaid {formulas.estimate.version}.")


def head(subject: Subject, left_out: tuple[Lack, ...], remarks: Sequence[str] = ()) -> list[str]:
    """Lines for the head of a file: the model, its joints, what is left out, what the data did not tell, remarks."""
    formulas, digest = subject.formulas, subject.formulas.estimate.recipe_digest
    joints = [f"{n} {commented(joint.name)}" for n, joint in enumerate(formulas.robot.joints, 1)]
    effects = ", ".join(dict.fromkeys(term.effect for term in formulas.terms)) or "nothing"
    lines = [
        title(formulas),
        f"Recipe {commented(formulas.robot.origin)} (SHA-256 {digest[:12]})." if digest else "",
        "",
        f"Joints: {', '.join(joints)}.",
        f"Beyond gravity, Coulomb and viscous friction: {effects}.",
        "",
        "Left out:" if left_out else "Nothing of the model is left out.",
        *_listed(left_out),
        "",
        "Not determined by the data, and so of the size that disturbs least:"
        if formulas.undetermined
        else "Every parameter was determined.",
        *_listed(formulas.undetermined),
        *(["", *map(commented, remarks)] if remarks else []),
    ]
    return [part for line in lines for part in (textwrap.wrap(line, WIDTH, subsequent_indent="    ") or [""])]


def _listed(lacks: tuple[Lack, ...]) -> list[str]:
    return [f"  {commented(lack.name)}: {commented(lack.reason)}" for lack in lacks]
