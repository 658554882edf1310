"""Files are written atomically, folders can be locked, a session replaces only sessions; how paths are found."""

import os
import threading
from itertools import islice
from pathlib import Path

import fsspec
import pytest
from faulty import contents

from pumaid.errors import LogError, ResultError
from pumaid.io.paths import expand, local_copy
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


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An experiment's folder with logs, and with what is none."""
    folder = tmp_path / "results" / "robot 7" / "ü %41 #x?[1]"
    logs = "run_10.csv|run_2.csv|run_1.parquet|day 2/é.CSV|day 2/a.csv.gz|dir.csv/inner.csv"
    for name in (
        *logs.split("|"),
        *["notes.txt", "plan.csv", "dataset.npz", ".hidden.csv", "results/table.csv", ".cache/old.csv"],
    ):
        (folder / name).parent.mkdir(exist_ok=True, parents=True)
        (folder / name).write_text("t\n")
    return folder


@pytest.mark.parametrize(
    ("argument", "wanted"),
    [
        ("", "day 2/a.csv.gz|day 2/é.CSV|dir.csv/inner.csv|run_1.parquet|run_2.csv|run_10.csv"),
        ("results/table.csv", "results/table.csv"),
        ("results", "results/table.csv"),
        ("notes.txt", "notes.txt"),
        ("../*/run_*.csv", "run_2.csv|run_10.csv"),
        ("../**/é.CSV", "day 2/é.CSV"),
        ("../*/day*", "day 2/a.csv.gz|day 2/é.CSV"),
    ],
)
def test_files_folders_and_globs(folder: Path, argument: str, wanted: str) -> None:
    """A folder is its logs in natural order, without hidden files, results and plans; what is named is taken."""
    # A URL of the same place means the same, whatever letters and folders lead there.
    place = f"{folder.parent}/{argument[3:]}" if argument.startswith("..") else f"{folder}/{argument}".rstrip("/")
    paths = expand([place, place])
    assert "|".join(str(path.relative_to(folder)) for path in paths) == wanted
    for scheme in ("file", "local"):
        assert expand([f"{scheme}://{place}"]) == [f"{scheme}://{path}" for path in paths]


@pytest.mark.parametrize(
    ("argument", "slug", "said"),
    [
        ("rnu_2.csv", "no-such-log", "run_2.csv"),
        ("day2/a.csv", "no-such-log", "day 2"),
        ("*.tdms", "no-such-log", "day 2, dir.csv"),
        ("dead.csv", "no-such-log", "dead.csv"),
        ("empty", "no-such-log", ".parquet"),
    ],
)
def test_a_miss_names_the_nearest(folder: Path, argument: str, slug: str, said: str) -> None:
    """A misspelt file or folder, a glob, a dead link and a folder without logs each get their mend."""
    (folder / "dead.csv").symlink_to("gone.csv")
    (folder / "empty").mkdir()
    with pytest.raises(LogError) as refused:
        expand([folder / argument])
    assert refused.value.slug == slug and said in f"{refused.value.what} {refused.value.mend}"


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may read everything")
def test_an_unreadable_folder_is_told(folder: Path) -> None:
    """A folder that may not be listed is refused, not passed over."""
    (folder / "day 2").chmod(0)
    try:
        with pytest.raises(LogError, match="file-not-readable"):
            expand([folder])
    finally:
        (folder / "day 2").chmod(0o755)


def test_a_store_that_keeps_things_in_memory_is_like_a_folder(monkeypatch) -> None:
    """Paths of a store do not begin with a slash; what its library raises is told as ours."""
    store = fsspec.filesystem("memory")
    for name in ("run_10.csv", "run_9.csv", ".run_1.csv", "results/run_2.csv"):
        store.pipe(f"/stores/logs/{name}", b"t\n")
    paths = expand(["memory://stores/logs"])
    assert paths == [f"memory://stores/logs/run_{n}.csv" for n in (9, 10)]

    def refused(*_, **__):
        raise RuntimeError("AccessDenied")

    monkeypatch.setattr(type(store), "open", refused)
    with pytest.raises(LogError, match="AccessDenied") as error, local_copy(paths[0]):
        pass
    assert error.value.slug == "file-not-readable"


@pytest.mark.parametrize(
    ("argument", "slug"),
    [
        ("memory://nothing/here", "no-such-log"),
        ("file:///nothing/here/*.csv", "no-such-log"),
        ("data://x", "file-not-readable"),
        ("foo://x", "file-not-readable"),
        ("FILE:///tmp", "file-not-readable"),
        ("zip:///tmp/x.zip", "file-not-readable"),
        ("simplecache::file:///tmp/x", "file-not-readable"),
    ],
)
def test_what_leads_nowhere_is_one_message(argument, slug) -> None:
    """Whatever the store's own library raises is told as ours, with the address."""
    with pytest.raises(LogError) as refused:
        expand([argument])
    assert (refused.value.slug, refused.value.where.file) == (slug, argument) and refused.value.mend
