"""Files that people write: YAML with the line of each value, checked by pydantic, every fault told at once."""

import json
import re
import reprlib
import sys
from collections.abc import Callable, Iterable
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, cast, get_args

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, model_validator
from pydantic_core import PydanticCustomError
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.nodes import MappingNode, SequenceNode

from pumaid.errors import Faults, PumaidError, RecipeError, Where, meant

#: Most bytes of a recipe.
MAX_BYTES = 200_000
#: Significant digits of numbers on a line: whole degrees stay whole.
DIGITS = 10
#: Most faults of one file that are listed; the others are counted.
MOST_FAULTS = 20
#: A value as a message shows it: two levels of what aliases may expand without end.
_SHOWN = reprlib.Repr()
_SHOWN.maxlevel = 2
_MEND = (
    "write keys and values in UTF-8, each key once, indented by spaces, with quotes and brackets closed and no tags;"
    " pumaid init writes a recipe, pumaid plan a plan"
)

KeyPath = tuple[str | int, ...]
#: Path of a fault, sentence, mend.
Fault = tuple[KeyPath, str, str]
AngleUnit = Literal["rad", "deg"]
Form = TypeVar("Form", bound=BaseModel)
Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
#: Tuples are lists in a file.
AS_LIST = Field(strict=False)
Words = Annotated[str, Field(strict=True, max_length=200, pattern=r"\S")]


class StrictForm(BaseModel):
    """What a mapping may hold: unknown keys are faults, and types are not converted."""

    model_config = ConfigDict(extra="forbid", strict=True)

    @model_validator(mode="before")
    @classmethod
    def _leave_out_empty(cls, data: Any) -> Any:
        """What is empty, as a block whose lines are all commented out, means its default; some values may be null."""
        if not isinstance(data, dict):
            return data
        used = {*cls.model_fields} - {"velocity", "temperature", "floor"}
        return {str(key): value for key, value in data.items() if value is not None or key not in used}


@dataclass(frozen=True, slots=True)
class Document:
    """A YAML document: `data` in plain values, the `root` of its nodes, its file, and the `kind` of its faults."""

    data: dict[Any, Any]
    root: MappingNode
    file: str
    kind: type[PumaidError]

    def line_of(self, path: KeyPath) -> int:
        """Line (from 1) of the value at `path` (keys and 0-based indices), or of its nearest ancestor that exists."""
        place = node = cast(Any, self.root)
        for step in path:
            if isinstance(node, MappingNode):
                place, node = next((pair for pair in node.value if pair[0].value == step), (place, None))
            elif isinstance(node, SequenceNode):
                place = node = node.value[step]
        return int(place.start_mark.line) + 1


def yaml_text(text: str) -> str:
    """A text as YAML: bare where that is safe, else in JSON's quotes, which YAML reads too."""
    is_plain = re.fullmatch(r"[A-Za-z][\w./()-]*(?: [\w./()-]+)*", text, re.ASCII) is not None
    words = {"true", "false", "yes", "no", "on", "off", "null", "y", "n"}
    return text if is_plain and text.lower() not in words else json.dumps(text, ensure_ascii=False)


def yaml_line(value: Any) -> str:
    """A value in YAML's flow style, numbers to `DIGITS`."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {yaml_line(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(yaml_line, value)) + "]"
    if isinstance(value, str):
        return yaml_text(value)
    return "null" if value is None else f"{value + 0.0:.{DIGITS}g}"  # never -0


def yaml_number(value: float, decimals: int = 12) -> str:
    """A number with a point and without exponent: YAML 1.1 would read 1 as an integer and 1e-9 as text."""
    return np.format_float_positional(round(value, decimals) + 0.0, trim="0")


def yaml_vector(values: Iterable[float], decimals: int = 12) -> str:
    """Such numbers as a list."""
    return f"[{', '.join(yaml_number(value, decimals) for value in values)}]"


def file_name(path: Path) -> str:
    """A path as messages show it."""
    return "standard input" if str(path) == "-" else str(path)


def read_bytes(
    path: Path, *, kind: type[PumaidError], most: int, mend: str = "check the path and its permissions"
) -> bytes:
    """The content of a file of at most `most` bytes; ``-`` is standard input, `mend` the advice where it is not there.

    Raises
    ------
    PumaidError [file-not-readable]
        Of type `kind`: there is no such file, it may not be read, or it is larger.
    """
    name = file_name(path)
    try:
        with nullcontext(sys.stdin.buffer) if str(path) == "-" else Path(path).open("rb") as file:
            content = file.read(most + 1)
    except (OSError, ValueError) as error:
        what = f"{name} cannot be read: {getattr(error, 'strerror', None) or error}"
        raise kind("file-not-readable", what, Where(file=name), mend) from error
    if len(content) > most:
        raise kind(
            "file-not-readable",
            f"{name} has more than {most} bytes, which no such file has",
            Where(file=name),
            "is this a log?",
        )
    return content


def parsed_yaml(content: bytes, file: str, *, kind: type[PumaidError] = RecipeError) -> Document:
    """The one YAML document of a file with this content; `file` is for messages.

    Raises
    ------
    PumaidError [file-not-readable]
        Of type `kind`: it is not UTF-8 or UTF-16 text, not YAML, no mapping, or has keys given twice, tags, several
        documents or too many levels.
    """
    line = None
    try:
        text = content.decode("utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
        yaml = YAML(typ="safe", pure=True)
        root = yaml.compose(text.replace("\r\n", "\n").replace("\r", "\n"))
        if isinstance(root, MappingNode):
            return Document(yaml.constructor.construct_document(root), root, file, kind)
        what = "the file holds no keys and values"
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        what = f"byte 0x{content[error.start]:02x} is not UTF-8 text"
    except YAMLError as error:
        mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
        problem = getattr(error, "problem", None) or str(error).splitlines()[0]
        line = mark.line + 1 if mark is not None else text[: getattr(error, "position", 0)].count("\n") + 1
        what = f"this is not YAML: {problem}"
    except RecursionError:
        what = "brackets or blocks are nested too deep"
    except (ValueError, LookupError, TypeError) as error:
        what = f"a number or date is impossible: {error}"
    raise kind("file-not-readable", what, Where(file=file, line=line), _MEND)


def refusal(what: str, mend: str = "") -> Exception:
    """A pydantic error with our sentence and mend."""
    return PydanticCustomError("pumaid", "{what}", {"what": what, "mend": mend})


def validated(
    form: type[Form],
    document: Document,
    slug: str,
    *,
    context: Any = None,
    between: Callable[[Form], Iterable[Fault]] = lambda form: (),
    once: str = "",
) -> Form:
    """A document's data as a form whose fields' ``examples`` show what they look like.

    A misspelt key is not told as missing too, and of faults with the mend `once` the first; of many the first are told.

    Raises
    ------
    PumaidError [slug], or Faults of several
        Of the document's kind, every fault in the order of the lines; those `between` several values where each is
        good.
    """
    try:
        out = form.model_validate(document.data, context=context)
        faults = list(between(out))
    except ValidationError as error:
        faults = [_fault(dict(entry), form) for entry in error.errors(include_url=False)]
    if not faults:
        return out
    alike = [fault for fault in faults if fault[2] == once]
    slips = {(path[:-1], mend) for path, _, mend in faults}
    errors = [
        document.kind(
            slug, what, Where(file=document.file, line=document.line_of(path), field=dotted(path) or None), mend
        )
        for path, what, mend in faults
        if not (what.endswith("is missing") and (path[:-1], f"did you mean {path[-1]}?") in slips)
        and (path, what, mend) not in alike[1:]
    ]
    errors.sort(key=lambda error: error.where.line or 0)
    if len(errors) > MOST_FAULTS:
        last, more = errors[MOST_FAULTS - 1], len(errors) - MOST_FAULTS
        what = f"{last.what} (and {more} more faults)"
        errors[MOST_FAULTS - 1 :] = [document.kind(slug, what, last.where, last.mend)]
    raise errors[0] if len(errors) == 1 else Faults(errors)


def dotted(path: KeyPath) -> str:
    """``joints[3].alpha`` for ("joints", 2, "alpha"): people count from 1."""
    return "".join(f"[{step + 1}]" if isinstance(step, int) else f".{step}" for step in path).removeprefix(".")


def _fault(entry: dict[str, Any], form: type[BaseModel]) -> Fault:
    path: KeyPath = tuple(step for step in entry["loc"] if step != "[key]")
    kind, context = entry["type"], entry.get("ctx", {})
    if kind == "pumaid":
        return path, context["what"], context["mend"]
    steps = path
    while isinstance(steps[-1], int):  # an entry of a list looks like what the list shows
        steps = steps[:-1]
    fields, key = _fields(form, steps[:-1]), str(steps[-1])
    if kind == "extra_forbidden":
        return path, f"there is no key {key[:60]}", meant(key, list(fields))
    example = next(iter((fields[key].examples if key in fields else None) or []), "")
    if kind == "missing":
        return (
            steps,
            f"the key {key} is missing" if steps == path else f"{dotted(steps)} has too few values",
            f"add {key}: {example or '...'}",
        )
    shown = _SHOWN.repr(entry["input"])[:80]
    message = re.sub("^Input", "it", entry["msg"].partition(" or instance of")[0]).replace("dictionary", "mapping")
    wanted = re.sub("^it should be (?=greater|less)", "a number ", message).removeprefix("it should be ")
    mend = f"write {example or wanted}"
    if kind == "literal_error":
        mend = meant(shown.strip("'"), context["expected"].replace("'", "").split(" or "))
    return path, f"{dotted(path)} is {shown}: {message}", mend


def _fields(form: Any, path: KeyPath) -> dict[str, Any]:
    for step in (*path, None):
        while not hasattr(form, "model_fields") and get_args(form):
            form = get_args(form)[0]
        fields = {field.alias or name: field for name, field in getattr(form, "model_fields", {}).items()}
        if isinstance(step, str):
            form = fields[step].annotation if step in fields else None
    return fields


class ArmForm:
    """What a value is checked against, by a recipe's plain data, whatever it holds.

    These are the joints' `names` and types (`kinds`), the `unit` of angles and whether it is stated.
    """

    def __init__(self, data: dict[str, Any]) -> None:
        entries, units = data.get("joints"), data.get("units")
        joints = [joint if isinstance(joint, dict) else {} for joint in (entries if isinstance(entries, list) else [])]
        names = [joint.get("name") for joint in joints]
        angle = units.get("angle") if isinstance(units, dict) else None
        self.names = tuple(name if isinstance(name, str) else f"joint{k}" for k, name in enumerate(names, start=1))
        self.kinds = {str(joint.get("type")) for joint in joints}
        self.unit, self.is_stated = "deg" if angle == "deg" else "rad", angle is not None


def arm_of(info: ValidationInfo) -> ArmForm:
    """What a value that is being validated is checked against."""
    return cast(ArmForm, info.context)


def check(is_good: Callable[[Any, ArmForm], bool], what: str, mend: str) -> AfterValidator:
    """Refuses a value; ``{}`` in `what` stands for it, ``{n}`` in `mend` for the number of joints."""

    def checked(value: Any, info: ValidationInfo) -> Any:
        arm = arm_of(info)
        if not is_good(value, arm):
            shown = f"{value:g}" if isinstance(value, float) else str(value)[:60]
            raise refusal(what.replace("{}", shown), mend.replace("{n}", str(len(arm.names))))
        return value

    return AfterValidator(checked)


def like(*examples: str, default: Any = ..., **more: Any) -> Any:
    """A field with what its value looks like."""
    return Field(default, examples=list(examples), **more)


#: Three numbers.
Vector = Annotated[tuple[Finite, Finite, Finite], AS_LIST]


class PayloadForm(StrictForm):
    """A known load on the last link."""

    mass: Annotated[Finite, Field(ge=0.0, le=1e5)] = like("0.5   (kg)")
    at: Vector = like("[0.1, 0, 0]   (m, its centre of mass in the last link's frame)")
