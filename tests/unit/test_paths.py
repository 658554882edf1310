"""Which files a user means, on disk and, by a path with a scheme, in a store."""

import os
from pathlib import Path

import fsspec
import pytest

from pumaid.errors import LogError
from pumaid.io.paths import expand, local_copy


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An experiment's folder with logs, and with what is none."""
    folder = tmp_path / "results" / "robot 7" / "ü %41 #x?[1]"
    logs = "run_10.csv|run_2.csv|run_1.parquet|day 2/é.CSV|day 2/a.csv.gz|dir.csv/inner.csv"
    for name in (*logs.split("|"), *["notes.txt", "plan.csv", ".hidden.csv", "results/table.csv", ".cache/old.csv"]):
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


def test_circles_of_links_end(folder: Path) -> None:
    """A link to a folder above is followed once."""
    (folder / "day 2" / "up").symlink_to("..")
    assert len(expand([folder])) == 6


def test_standard_input_is_itself() -> None:
    """`-` is kept."""
    assert expand(["-"]) == [Path("-")]


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
