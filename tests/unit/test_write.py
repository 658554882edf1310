"""Files are written atomically, folders can be locked, and a session replaces nothing but sessions."""

import threading
from itertools import islice
from pathlib import Path

import pytest

from pumaid.errors import ResultError
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.io.write import locked, read_truth, write_file, write_session
from pumaid.simulation import simulate
from pumaid.trajectory import Motion, Plan


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


ARM = read_recipe(shipped_recipes()["pendulum2"])
MOTION = Motion(1, (0.0, 0.3), -0.5, 0.5, 0.5)


def logs(seed: int):
    """Two files, as they are simulated."""
    return simulate(ARM, Plan(ARM.name, (MOTION,) * 2), seed=seed, rate=20.0, runs_per_file=1)


def write(folder: Path, seed: int, made=None, **more):
    """A session with the truth that a test needs of it."""
    more = {"form": "csv", **more}
    return write_session(folder, made or logs(seed), ARM, truth={"kind": "truth", "seed": seed}, **more)


def contents(folder: Path) -> dict[str, bytes]:
    """All files, hidden ones too."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def old(tmp_path) -> Path:
    """A folder with a session of seed 1."""
    write(tmp_path / "logs", 1)
    return tmp_path / "logs"


def test_an_interrupted_session_leaves_whole_files(old):
    """Ctrl-C while the second file is made: the first is whole, and --force replaces what is there."""

    def failing():
        yield from islice(logs(2), 1)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write(old, 2, failing(), force=True)
    assert {path.name for path in old.iterdir()} <= {"session_01.csv", "truth.json"}
    write(old, 3, force=True)
    assert set(contents(old)) == {"session_01.csv", "session_02.csv", "truth.json"}
    assert read_truth(old / "truth.json")["seed"] == 3


def test_another_form_and_fewer_files_leave_nothing_of_the_old(old):
    """A new session's folder holds that session alone."""
    plan = Plan(ARM.name, (MOTION,))
    write(old, 2, simulate(ARM, plan, seed=2, rate=20.0), force=True, form="parquet")
    assert set(contents(old)) == {"session_01.parquet", "truth.json"}


@pytest.mark.parametrize("truth", [None, "[]", '{"kind": "model"}'])
def test_logs_without_a_truth_are_not_ours(old, truth):
    """A name alone proves nothing: without a truth beside them --force replaces no logs."""
    (old / "truth.json").unlink()
    if truth is not None:
        (old / "truth.json").write_text(truth)
    before = contents(old)
    with pytest.raises(ResultError) as told:
        write(old, 2, force=True)
    assert told.value.slug == "file-exists" and contents(old) == before


@pytest.mark.parametrize("name", ["session_notes.csv", "old.csv.gz", "more/session_01.csv"])
def test_other_logs_beside_a_truth_are_not_ours(old, name):
    """What a simulation does not write is left, whatever stands beside it."""
    (old / name).parent.mkdir(exist_ok=True)
    (old / name).write_text("mine")
    with pytest.raises(ResultError, match=r"holds logs already"):
        write(old, 2, force=True)
    assert (old / name).read_text() == "mine"
