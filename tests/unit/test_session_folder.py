"""A simulated session takes its folder whole, or leaves it as it was."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

from pumaid.errors import LogError, ResultError
from pumaid.io.paths import expand
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.io.session import read_truth, write_session
from pumaid.records import Motion, Plan
from pumaid.verbs.simulate import simulate

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


@pytest.mark.parametrize("failure", [KeyboardInterrupt, ResultError("simulation-diverged", "it ran away")])
def test_what_fails_on_the_way_leaves_the_old_logs(old, failure):
    """Ctrl-C and failures while the second file is made: every old file stands, and nothing else."""
    before = contents(old)

    def failing():
        yield from logs(2)
        raise failure

    with pytest.raises((KeyboardInterrupt, ResultError)):
        write(old, 2, failing(), force=True)
    assert contents(old) == before


def test_a_failure_leaves_no_new_folder(tmp_path):
    """Where there was none before, there is none after it."""
    with pytest.raises(KeyboardInterrupt):
        write(tmp_path / "logs", 2, (one for one in [*logs(2), 0] if one or signal.raise_signal(signal.SIGINT)))
    assert not (tmp_path / "logs").exists()


@pytest.mark.parametrize("number", range(6))
def test_a_disk_that_refuses_the_swap_leaves_the_old_logs(old, monkeypatch, number):
    """Whichever of the renamings is refused, those before it are undone."""
    before, rename, count = contents(old), Path.rename, iter(range(99))

    def refusing(path, target):
        if next(count) == number:
            raise PermissionError(13, "Permission denied")
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", refusing)
    with pytest.raises(ResultError) as told:
        write(old, 2, force=True)
    assert told.value.slug == "cannot-write" and contents(old) == before


@pytest.mark.parametrize("kind", ["SIGINT", "SIGTERM"])
def test_ctrl_c_waits_for_the_swap(old, monkeypatch, kind):
    """A signal between two renamings comes when the new session stands whole."""
    rename = Path.rename

    def interrupted(path, target):
        signal.raise_signal(getattr(signal, kind))
        return rename(path, target)

    def end(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "rename", interrupted)
    before = signal.signal(getattr(signal, kind), end)
    try:
        with pytest.raises(KeyboardInterrupt):
            write(old, 2, force=True)
    finally:
        signal.signal(getattr(signal, kind), before)
    assert set(contents(old)) == {"session_01.csv", "session_02.csv", "truth.json"}
    assert read_truth(old / "truth.json")["seed"] == 2


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
    assert told.value.slug == "logs-in-the-way" and contents(old) == before


@pytest.mark.parametrize("name", ["session_notes.csv", "old.csv.gz", "more/session_01.csv"])
def test_other_logs_beside_a_truth_are_not_ours(old, name):
    """What a simulation does not write is left, whatever stands beside it."""
    (old / name).parent.mkdir(exist_ok=True)
    (old / name).write_text("mine")
    with pytest.raises(ResultError, match=r"holds logs already"):
        write(old, 2, force=True)
    assert (old / name).read_text() == "mine"


@pytest.mark.parametrize(("force", "seed"), [(True, 2), (False, 3)])
def test_two_sessions_at_once_do_not_mix(tmp_path, force, seed):
    """Another session that is over first is replaced whole, or the later one is refused."""
    folder = tmp_path / "logs"

    def overtaken():
        yield from logs(2)
        write(folder, 3, form="parquet")

    if force:
        write(folder, 2, overtaken(), force=True)
    else:
        with pytest.raises(ResultError, match="holds logs already"):
            write(folder, 2, overtaken())
    ending = {2: "csv", 3: "parquet"}[seed]
    assert set(contents(folder)) == {f"session_01.{ending}", f"session_02.{ending}", "truth.json"}
    assert read_truth(folder / "truth.json")["seed"] == seed


def test_a_file_in_place_of_the_folder_is_told(tmp_path):
    """The message names no hidden folder."""
    (tmp_path / "logs").write_text("mine")
    with pytest.raises(ResultError) as told:
        write(tmp_path / "logs", 2)
    assert told.value.slug == "cannot-write" and ".simulation" not in str(told.value)


class Killed(BaseException):
    """The process is gone: nothing that it would have done afterwards is done."""


@pytest.fixture
def killed(old, monkeypatch):
    """Leaves a folder as a kill before the given renaming of the swap does."""

    def kill(number: int) -> None:
        rename, count = Path.rename, iter(range(99))

        def dying(path, target):
            if next(count) == number:
                raise Killed
            return rename(path, target)

        with monkeypatch.context() as patched, pytest.raises(Killed):
            patched.setattr(Path, "rename", dying)
            patched.setattr("shutil.rmtree", lambda *_, **__: None)
            write(old, 2, force=True)

    return kill


@pytest.mark.parametrize("number", range(6))
def test_a_kill_within_the_swap_loses_nothing(old, killed, number):
    """Readers refuse the folder, whatever way it is named; the next simulation finishes the swap before it begins."""
    killed(number)
    left = sorted(old.glob("*.csv"))
    for argument in (old, *([old / "*.csv", left[0]] if left else [])):
        with pytest.raises(LogError) as refused:
            expand([argument])
        assert refused.value.slug == "logs-half-replaced"
    with pytest.raises(ResultError) as told:
        write(old, 3)
    assert told.value.slug == "logs-in-the-way"
    assert set(contents(old)) == {"session_01.csv", "session_02.csv", "truth.json"}
    assert read_truth(old / "truth.json")["seed"] == 2 and len(expand([old])) == 2
    whole = contents(old)
    write(old, 2, force=True)
    assert contents(old) == whole


def test_a_file_that_came_meanwhile_is_not_replaced(old, killed):
    """What a user put in the place of a file that is still to come stays, and so does that file."""
    killed(4)
    (old / "session_02.csv").write_text("mine")
    before = contents(old)
    with pytest.raises(ResultError, match="is in the way"):
        write(old, 3, force=True)
    assert contents(old).items() >= {"session_02.csv": b"mine"}.items() and len(contents(old)) == len(before)


def test_only_own_leftovers_are_removed(tmp_path):
    """A hidden folder that looks like ours, but holds what no simulation writes, stays however old it is."""
    kept = [".simulation-notes/a.txt", f".simulation-{'0' * 12}/a.txt", f".simulation-{'1' * 12}/old/sub/truth.json"]
    gone = [f".simulation-{'2' * 12}/session_01.csv", f".simulation-{'3' * 12}/.session_01.csv.{'a' * 12}.part"]
    for name in kept + gone:
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).write_text("precious")
        os.utime(tmp_path / Path(name).parts[0], (1.0, 1.0))
    write(tmp_path, 1)
    assert {name for name in contents(tmp_path) if name.startswith(".")} == set(kept)
