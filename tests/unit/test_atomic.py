"""Files appear whole or not at all."""

from __future__ import annotations

import errno
import os
import signal
import threading
from pathlib import Path

import pytest

from pumaid.errors import ResultError
from pumaid.io import atomic
from pumaid.io.alone import alone
from pumaid.io.atomic import whole_file, write_together, write_whole


def names(folder: Path) -> list[str]:
    """All names in a folder, hidden ones too."""
    return sorted(path.name for path in folder.iterdir())


def test_content_is_written_and_nothing_else_is_left(tmp_path: Path) -> None:
    """Text arrives as UTF-8 with its line ends, bytes as they are, and no temporary stays."""
    write_whole(tmp_path / "new" / "a.txt", "é\n")
    write_whole(tmp_path / "new" / "b.bin", b"\x00\r\n")
    assert (tmp_path / "new" / "a.txt").read_bytes() == b"\xc3\xa9\n"
    assert (tmp_path / "new" / "b.bin").read_bytes() == b"\x00\r\n"
    assert names(tmp_path / "new") == ["a.txt", "b.bin"]


def test_a_full_disk_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """When forcing to disk fails the old content stands and the message says what to do."""
    path = tmp_path / "a.txt"
    write_whole(path, "old")

    def full(handle: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ResultError, match="No space left") as caught:
        write_whole(path, "new")
    assert caught.value.slug == "cannot-write" and "free some space" in caught.value.mend
    assert path.read_text() == "old" and names(tmp_path) == ["a.txt"]


def test_an_error_in_the_block_leaves_nothing(tmp_path: Path) -> None:
    """A stream that breaks half way leaves neither a part nor a temporary."""
    with pytest.raises(ValueError, match="half way"), whole_file(tmp_path / "a.txt") as temporary:
        temporary.write_text("part")
        raise ValueError("half way")
    assert names(tmp_path) == []


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    """The file behind a symbolic link is replaced, not the link."""
    (tmp_path / "real.txt").write_text("old")
    (tmp_path / "link.txt").symlink_to("real.txt")
    write_whole(tmp_path / "link.txt", "new")
    assert (tmp_path / "link.txt").is_symlink() and (tmp_path / "real.txt").read_text() == "new"


def test_a_replaced_file_keeps_its_mode(tmp_path: Path) -> None:
    """A file that only its owner may read stays so."""
    path = tmp_path / "a.txt"
    write_whole(path, "old")
    path.chmod(0o600)
    write_whole(path, "new")
    assert path.stat().st_mode & 0o777 == 0o600


def test_a_pipe_is_written_directly(capfd: pytest.CaptureFixture[str]) -> None:
    """`-o /dev/stdout` works in a pipeline."""
    write_whole(Path("/dev/stdout"), "through")
    assert capfd.readouterr().out == "through"


@pytest.mark.parametrize("name", ["folder", "file/below", "loop", "n" * 300])
def test_what_cannot_be_written_is_told(tmp_path: Path, name: str) -> None:
    """A folder in the way, a file as folder, a circle of links and a long name are refused with a mend."""
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("old")
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(ResultError) as caught:
        write_whole(tmp_path / name, "new")
    assert caught.value.slug == "cannot-write" and caught.value.mend and len(caught.value.what) < 200
    assert names(tmp_path) == ["file", "folder", "loop"]


def test_files_that_belong_together_are_replaced_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C at the first renaming comes when all of them are done; they come in the order given."""
    files = [(tmp_path / "sub" / f"{n}.txt", b"new") for n in range(5)]
    for path, _ in files:
        write_whole(path, "old")
    replace, order = Path.replace, []

    def interrupted(path: Path, target: Path) -> Path:
        order.append(target.name)
        signal.raise_signal(signal.SIGINT)
        return replace(path, target)

    monkeypatch.setattr(Path, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_together(files)
    assert order == [path.name for path, _ in files]
    assert [path.read_bytes() for path, _ in files] == [b"new"] * 5 and len(names(tmp_path / "sub")) == 5


@pytest.mark.parametrize("failing", range(5))
def test_one_that_cannot_be_written_leaves_all_the_old(tmp_path: Path, failing: int) -> None:
    """Whichever it is, nothing is replaced, and no hidden file stays."""
    files = [(tmp_path / f"{n}.txt", b"new") for n in range(5)]
    for number, (path, _) in enumerate(files):
        path.mkdir() if number == failing else write_whole(path, "old")
    with pytest.raises(ResultError):
        write_together(files)
    assert {path.read_bytes() for path, _ in files if path.is_file()} == {b"old"} and len(names(tmp_path)) == 5


def test_another_run_is_waited_for(tmp_path: Path) -> None:
    """While one run replaces its files another waits, so that no folder holds parts of both."""
    done = threading.Event()

    def other() -> None:
        write_together([(tmp_path / "a.txt", b"second")])
        done.set()

    with alone(tmp_path):
        thread = threading.Thread(target=other)
        thread.start()
        assert not done.wait(0.3) and not (tmp_path / "a.txt").exists()
    thread.join()
    assert (tmp_path / "a.txt").read_bytes() == b"second"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with names are of POSIX")
def test_a_pipe_that_nobody_reads_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is not waited for without end; one that is read gets everything."""
    monkeypatch.setattr(atomic, "PATIENCE", 0.2)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ResultError, match="nobody reads"):
        write_whole(tmp_path / "pipe", "text")
    heard: list[str] = []
    reader = threading.Thread(target=lambda: heard.append((tmp_path / "pipe").read_text()))
    reader.start()
    write_whole(tmp_path / "pipe", "text")
    reader.join(10)
    assert heard == ["text"]
