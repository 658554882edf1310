"""The lines of a text log, block by block, from its beginning or from where a part of it begins."""

from __future__ import annotations

import codecs
import io
import sys
from collections.abc import Iterator
from itertools import islice
from typing import BinaryIO, cast

from pumaid.errors import LogError, Where
from pumaid.io.parts import HEAD_BYTES, text_step

#: Bytes read at a time. Small enough to be flat, large enough that a block's fixed cost (about 1 ms) does not count.
BLOCK_BYTES = 4 << 20
#: A longer line is no row of a log; it would fill the memory.
MOST_LINE_BYTES = 32 << 20
#: Bytes of comments and empty lines behind which no header is looked for.
MOST_HEAD_BYTES = 4 << 20


class TextBlocks:
    """Whole lines that end in a line feed, whether a part begins with them, and whether no more follow.

    No block reaches from a part into the next, as `pumaid.io.parts.file_parts` cuts them. Memory is that of a block.

    Parameters
    ----------
    stream
        Binary, at the file's beginning; read once, and sought only for a part that lies behind.
    name
        For messages.
    part
        Bytes at which the lines begin that are wanted, borders of parts; None for all lines.

    Attributes
    ----------
    head
        The file's first lines, whichever part is wanted: a header line of 10 000 columns to its end.

    Raises
    ------
    LogError [not-a-log]
        A line is too long to be one, now or while iterating.
    """

    def __init__(self, stream: BinaryIO, name: str, part: range | None = None) -> None:
        self._stream, self._name, self._part, self._is_at_end = stream, name, part, False
        head = stream.read(HEAD_BYTES)
        self._step = text_step(head)
        if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            self._stream = cast(BinaryIO, _FromUtf16(head, stream))
            head = self._stream.read(HEAD_BYTES)
        read, head = len(head), head.removeprefix(codecs.BOM_UTF8)
        self._at = read - len(head)
        while (is_line := _n_ends(head) < 2) or (len(head) < MOST_HEAD_BYTES and not _is_telling(head)):
            if not (more := self._stream.read(len(head))):
                break
            head += more
            self._check_line(head if is_line else b"")
        self._rest, lines = head, _one_line_end(head)
        # A cut last line would mislead who looks at it.
        self.head = lines[: lines.rfind(b"\n") + 1] if _n_ends(head) > 1 else lines
        if part is not None and part.start:
            self._rest, self._at = b"", part.start - 1
            stream.seek(self._at)

    def __iter__(self) -> Iterator[tuple[bytes, bool, bool]]:
        ready: tuple[bytes, bool] | None = None  # the next block, which is the last one if nothing follows
        pending = held_back = b""
        begins_part = False
        for more, is_new in self._read():
            begins_part = begins_part or is_new
            pending = pending + held_back + more
            # A carriage return at the end may be half of a line end.
            held_back = b"\r" if more and pending.endswith(b"\r") else b""
            pending = _one_line_end(pending[: len(pending) - len(held_back)])
            if not more and not pending.strip():
                break
            cut = pending.rfind(b"\n") + 1 if more else len(pending)
            if cut:
                if ready is not None:
                    yield *ready, False
                ready, pending, begins_part = (pending[:cut], begins_part), pending[cut:], False
            self._check_line(pending)
        if ready is not None:
            yield *ready, self._is_at_end

    def _read(self) -> Iterator[tuple[bytes, bool]]:
        """The bytes as the file has them, and whether a part begins with them; at the file's end none."""
        at, start, begins = self._at, self._at, False
        is_wanted = self._part is None or self._part.start == 0
        block, self._rest = self._rest, b""
        while block or (block := self._stream.read(BLOCK_BYTES)):
            border = start - start % self._step + self._step if self._step else sys.maxsize
            end = block.find(b"\n", max(0, border - 1 - at)) + 1 if border <= at + len(block) else 0
            if is_wanted:
                yield block[:end] if end else block, begins
            begins = end > 0
            at += end or len(block)
            block = block[end:] if end else b""
            if begins:
                start, is_wanted = at, True
                if self._part is not None and start >= self._part.stop:
                    return
        self._is_at_end = True
        yield b"", False

    def _check_line(self, line: bytes) -> None:
        if len(line) > MOST_LINE_BYTES:
            what = f"{self._name} has a line of more than {MOST_LINE_BYTES >> 20} MiB: it is no table in lines"
            where = Where(file=self._name)
            raise LogError("not-a-log", what, where, "export it as CSV, a line a sample, or as Parquet")


def _n_ends(head: bytes) -> int:
    return max(head.count(b"\n"), head.count(b"\r"))


def _is_telling(head: bytes) -> bool:
    """Whether there are a header and a row among whole lines, behind comments and empty ones."""
    lines = _one_line_end(head).split(b"\n")[:-1]
    telling = (line for line in lines if line.strip() and not line.startswith((b"#", b"%")))
    return len(list(islice(telling, 2))) == 2


def _one_line_end(block: bytes) -> bytes:
    """Line ends of Windows and of old Macs become line feeds."""
    return block.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in block else block


class _FromUtf16(io.RawIOBase):
    """UTF-16 (Excel's "Unicode text") as UTF-8."""

    def __init__(self, head: bytes, stream: BinaryIO) -> None:
        self._head, self._stream = head, stream
        self._decoder = codecs.getincrementaldecoder("utf-16")("replace")

    def read(self, size: int = -1) -> bytes:
        head, self._head = self._head, b""
        raw = head or self._stream.read(size)
        text = self._decoder.decode(raw, final=not raw)
        return text.encode("utf-8") or (self.read(size) if raw else b"")
