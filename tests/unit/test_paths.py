"""Which files a user means."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from pumaid.errors import LogError
from pumaid.io.paths import expand, natural


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An experiment's folder with logs, and with what is none."""
    for name in (
        "run_10.csv",
        "run_2.csv",
        "run_1.parquet",
        "notes.txt",
        "plan.csv",
        ".hidden.csv",
        "results/table.csv",
        ".cache/old.csv",
        "day 2/é.CSV",
        "day 2/a.csv.gz",
        "dir.csv/inner.csv",
    ):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text("t\n")
    return tmp_path


def refusal(*arguments: str | Path) -> LogError:
    """The error for these arguments."""
    with pytest.raises(LogError) as caught:
        expand(arguments)
    return caught.value


def test_a_folder_is_its_logs_in_natural_order(folder: Path) -> None:
    """Sub-folders too; hidden files, results, plans and other endings are left out."""
    found = [str(path.relative_to(folder)) for path in expand([folder])]
    expected = ["day 2/a.csv.gz", "day 2/é.CSV", "dir.csv/inner.csv", "run_1.parquet", "run_2.csv", "run_10.csv"]
    assert found == expected


def test_a_named_file_is_taken_whatever_its_name(folder: Path) -> None:
    """What a folder leaves out may be named outright; naming twice is once."""
    named = folder / "results" / "table.csv"
    assert expand([named, str(named), folder / "results"]) == [named]
    assert expand([folder / "notes.txt"]) == [folder / "notes.txt"]


def test_globs_are_taken_as_the_shell_would(folder: Path) -> None:
    """Quoted globs work, `**` crosses folders, and a glob of folders means what is in them."""
    assert [path.name for path in expand([f"{folder}/run_*.csv"])] == ["run_2.csv", "run_10.csv"]
    assert "inner.csv" in [path.name for path in expand([f"{folder}/**/*.csv"])]
    assert [path.name for path in expand([f"{folder}/day*"])] == ["a.csv.gz", "é.CSV"]


def test_brackets_in_a_name_are_no_glob(folder: Path) -> None:
    """A file whose name looks like a pattern is found as it is."""
    (folder / "run[1].csv").write_text("t\n")
    assert expand([folder / "run[1].csv"]) == [folder / "run[1].csv"]


def test_circles_of_links_end(folder: Path) -> None:
    """A link to a folder above is followed once."""
    (folder / "day 2" / "up").symlink_to("..")
    assert len(expand([folder])) == 6


def test_standard_input_is_itself() -> None:
    """`-` is kept."""
    assert expand(["-"]) == [Path("-")]


def test_a_miss_names_the_nearest(folder: Path) -> None:
    """A misspelt file, folder, glob, dead link and nothing at all each get their mend."""
    assert "run_2.csv" in refusal(folder / "rnu_2.csv").mend
    assert str(folder / "day 2") in refusal(folder / "day2" / "a.csv").mend
    assert refusal(f"{folder}/*.tdms").slug == "no-such-log"
    (folder / "dead.csv").symlink_to("gone.csv")
    assert "gone.csv" in refusal(folder / "dead.csv").what
    assert refusal().slug == "no-logs"


def test_a_folder_without_logs_says_what_it_has(folder: Path) -> None:
    """The message lists what is there and what a log ends in."""
    (folder / "other").mkdir()
    (folder / "other" / "run.bag").write_text("")
    error = refusal(folder / "other")
    assert error.slug == "no-logs" and "run.bag" in error.what and ".parquet" in error.mend


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may read everything")
def test_an_unreadable_folder_is_told(folder: Path) -> None:
    """A folder that may not be listed is refused, not passed over."""
    (folder / "day 2").chmod(0)
    try:
        assert refusal(folder).slug == "unreadable-log"
    finally:
        (folder / "day 2").chmod(0o755)


def test_natural_order() -> None:
    """Numbers in names count as numbers."""
    assert sorted(["b", "a10", "a2", "a", "10", "9"], key=natural) == ["9", "10", "a", "a2", "a10", "b"]
