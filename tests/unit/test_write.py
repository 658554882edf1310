"""Files are written atomically, and folders can be locked."""

import threading
from pathlib import Path

import pytest

from pumaid.errors import ResultError
from pumaid.io.write import locked, write_file


def names(folder: Path) -> list[str]:
    """All names in a folder, hidden ones too."""
    return sorted(path.name for path in folder.iterdir())


def test_content_is_written_and_nothing_else_is_left(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Text arrives as UTF-8 with its line ends, bytes as they are, also in a pipe; no temporary stays."""
    write_file(tmp_path / "new" / "a.txt", "é\n")
    write_file(tmp_path / "new" / "b.bin", b"\x00\r\n")
    assert (tmp_path / "new" / "a.txt").read_bytes() == b"\xc3\xa9\n"
    assert (tmp_path / "new" / "b.bin").read_bytes() == b"\x00\r\n"
    assert names(tmp_path / "new") == ["a.txt", "b.bin"]
    write_file(Path("/dev/stdout"), "through")
    assert capfd.readouterr().out == "through"


def test_links_and_modes_stay(tmp_path: Path) -> None:
    """The file behind a symbolic link is replaced, not the link; what only its owner may read stays so."""
    (tmp_path / "real.txt").write_text("old")
    (tmp_path / "real.txt").chmod(0o600)
    (tmp_path / "link.txt").symlink_to("real.txt")
    write_file(tmp_path / "link.txt", "new")
    assert (tmp_path / "link.txt").is_symlink() and (tmp_path / "real.txt").read_text() == "new"
    assert (tmp_path / "real.txt").stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize("name", ["folder", "file/below", "n" * 300])
def test_what_cannot_be_written_is_told(tmp_path: Path, name: str) -> None:
    """A folder in the way, a file as folder and a long name are refused with a mend."""
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("old")
    with pytest.raises(ResultError) as caught:
        write_file(tmp_path / name, "new")
    assert caught.value.slug == "cannot-write" and caught.value.mend and len(caught.value.what) < 200
    assert names(tmp_path) == ["file", "folder"]


def test_another_run_is_waited_for(tmp_path: Path) -> None:
    """While one run has a folder's lock another waits for it."""
    done = threading.Event()

    def other() -> None:
        with locked(tmp_path):
            done.set()

    with locked(tmp_path):
        thread = threading.Thread(target=other)
        thread.start()
        assert not done.wait(0.1)
    thread.join()
    assert done.is_set()
