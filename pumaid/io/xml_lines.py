"""XML text to elements that remember their lines; no document types, no entities, nothing fetched."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from pumaid.errors import RecipeError, Where

#: Bytes a description may have; the largest of a hundred published ones has 0.2 MB.
MAX_BYTES = 20_000_000
#: Levels of nesting; a URDF has six.
MAX_DEPTH = 200


@dataclass(slots=True)
class Element:
    """An element with its attributes, the elements in it, and the line (from 1) on which it starts."""

    tag: str
    attributes: Mapping[str, str]
    line: int
    children: list[Element] = field(default_factory=list)

    def all(self, tag: str) -> list[Element]:
        """The elements of that name directly below."""
        return [child for child in self.children if child.tag == tag]

    def first(self, tag: str) -> Element | None:
        """The first element of that name directly below, or none."""
        return next(iter(self.all(tag)), None)

    def everything(self) -> Iterator[Element]:
        """This element and every one below it, in the order of the file."""
        waiting = [self]
        while waiting:
            element = waiting.pop()
            yield element
            waiting += reversed(element.children)


def read_bytes(path: Path) -> bytes:
    """The content of a description.

    Parameters
    ----------
    path
        The file; ``-`` is standard input.

    Raises
    ------
    RecipeError [file-not-readable]
        There is no such file, or it may not be read.
    RecipeError [urdf-refused]
        It is larger than any description.
    """
    try:
        if str(path) == "-":
            content = sys.stdin.buffer.read(MAX_BYTES + 1)
        else:
            with path.open("rb") as file:
                content = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        mend = "check the path and its permissions"
        raise RecipeError(
            "file-not-readable", f"{path} cannot be read: {reason}", Where(file=str(path)), mend
        ) from None
    if len(content) > MAX_BYTES:
        what, mend = f"the file has more than {MAX_BYTES} bytes", "a URDF names its meshes, it does not hold them"
        raise RecipeError("urdf-refused", what, Where(file=str(path)), mend)
    return content


def read_xml(content: bytes, file: str) -> Element:
    """The outermost element of XML text.

    Parameters
    ----------
    content
        The file's bytes.
    file
        Its name, for messages.

    Raises
    ------
    RecipeError [urdf-refused]
        It is no XML, or XML with what a description has no need of (a document type, entities, hundreds of levels).
    """
    return _Reader(file).read(content)


class _Reader:
    """Builds elements from expat's calls."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.top = Element("", {}, 0)
        self.open = [self.top]
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.StartDoctypeDeclHandler = self._document_type

    def read(self, content: bytes) -> Element:
        if not content.strip():
            raise self._refusal("the file is empty", None, "give the arm's URDF")
        try:
            self.parser.Parse(content, True)
        except expat.ExpatError as error:
            what = f"this is not XML: {expat.ErrorString(error.code)}"
            raise self._refusal(what, error.lineno, "see the line; every tag must be closed and quoted") from error
        except (LookupError, ValueError) as error:  # an encoding that Python lacks, or that does not fit the bytes
            raise self._refusal(f"the text cannot be read: {error}", 1, "save the file as UTF-8") from error
        return self.top.children[0]

    def _refusal(self, what: str, line: int | None, mend: str) -> RecipeError:
        return RecipeError("urdf-refused", what, Where(file=self.file, line=line), mend)

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        line = self.parser.CurrentLineNumber
        if len(self.open) > MAX_DEPTH:
            raise self._refusal(f"nested more than {MAX_DEPTH} deep", line, "a URDF nests six deep")
        element = Element(tag, attributes, line)
        self.open[-1].children.append(element)
        self.open.append(element)

    def _end(self, _: str) -> None:
        self.open.pop()

    def _document_type(self, *_: object) -> None:
        mend = "take the line <!DOCTYPE ...> away, and write entities out"
        raise self._refusal("the file has a document type", self.parser.CurrentLineNumber, mend)
