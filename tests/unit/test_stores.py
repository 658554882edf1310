"""Which logs a path with a scheme means: the same as the local path to the same files, or one message."""

from __future__ import annotations

from pathlib import Path

import pytest

from pumaid.errors import LogError
from pumaid.io.paths import Remote, expand, local_copy

fsspec = pytest.importorskip("fsspec")


def meant(argument: str | Path) -> list[str]:
    """Paths without the scheme."""
    return [str(path).removeprefix("file://").removeprefix("local://") for path in expand([str(argument)])]


@pytest.fixture
def logs(tmp_path) -> Path:
    """A folder with logs, and with what is none."""
    folder = tmp_path / "results" / "robot 7" / "ü %41 #x?[1]"
    names = ["run_10.csv", "run_2.parquet", "day 2/run_1.csv.gz", "plan.csv", ".run_3.csv", ".trash/run_4.csv"]
    for name in [*names, "results/run_5.csv", "notes.txt"]:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("t\n")
    return folder


@pytest.mark.parametrize("scheme", ["file", "local"])
def test_a_folder_means_what_it_means_on_disk(logs, scheme):
    """Neither hidden files nor plans nor results; run_2 before run_10; whatever letters and folders lead there."""
    assert meant(f"{scheme}://{logs}") == meant(logs)
    assert [Path(name).name for name in meant(logs)] == ["run_1.csv.gz", "run_2.parquet", "run_10.csv"]


def test_a_file_and_a_glob_mean_what_they_mean_on_disk(logs):
    """A file by its name, even a strange one; a glob of files, and one of folders."""
    assert meant(f"file://{logs}/run_10.csv") == [f"{logs}/run_10.csv"]
    assert meant(f"file://{logs.parent}/*/run_*") == meant(logs.parent / "*" / "run_*") != []
    assert meant(f"file://{logs.parent.parent}/*") == meant(logs.parent.parent / "*") != []


def test_a_store_that_keeps_things_in_memory_is_like_a_folder():
    """Paths of a store do not begin with a slash."""
    store = fsspec.filesystem("memory")
    for name in ("run_10.csv", "run_9.csv", ".run_1.csv", "results/run_2.csv"):
        store.pipe(f"/stores/logs/{name}", b"t\n")
    assert expand(["memory://stores/logs"]) == [Remote(f"memory://stores/logs/run_{n}.csv") for n in (9, 10)]


@pytest.mark.parametrize(
    ("argument", "slug"),
    [
        ("memory://nothing/here", "no-such-log"),
        ("file:///nothing/here/*.csv", "no-such-log"),
        ("data://x", "no-store"),
        ("foo://x", "no-store"),
        ("FILE:///tmp", "no-store"),
        ("zip:///tmp/x.zip", "no-store"),
        ("simplecache::file:///tmp/x", "no-store"),
        ("zip://*.csv::file:///tmp/z.zip", "no-store"),
    ],
)
def test_what_leads_nowhere_is_one_message(argument, slug):
    """Whatever the store's own library raises is told as ours, with the address."""
    with pytest.raises(LogError) as refused:
        expand([argument])
    assert (refused.value.slug, refused.value.where.file) == (slug, argument) and refused.value.mend


def test_a_store_that_refuses_to_open_is_one_message(monkeypatch):
    """Libraries of stores have errors of their own."""
    store = fsspec.filesystem("memory")
    store.pipe("/stores/one.csv", b"t\n")
    (path,) = expand(["memory://stores/one.csv"])

    def refused(*_, **__):
        raise RuntimeError("AccessDenied")

    monkeypatch.setattr(type(store), "open", refused)
    with pytest.raises(LogError, match="AccessDenied") as error, local_copy(path):
        pass
    assert error.value.slug == "unreadable-log"
