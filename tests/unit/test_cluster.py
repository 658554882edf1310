"""Logs read in parts and joined, by a cluster's workers or one after the other: the same as in one pass."""

from __future__ import annotations

import os
import pickle
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from concurrent.futures import CancelledError
from contextlib import nullcontext, suppress
from functools import reduce
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np
import pyarrow.parquet as pq
import pytest
from sessions import Eager, make_session, same

from pumaid import __version__
from pumaid.cluster import connect
from pumaid.cluster import gather as gathering
from pumaid.cluster.connect import connected
from pumaid.cluster.gather import gather
from pumaid.cluster.part import joined
from pumaid.cluster.pieces import Reading
from pumaid.cluster.whole import Whole
from pumaid.dataset import Dataset
from pumaid.errors import Faults, LogError, Where
from pumaid.io.recipe import read_recipe
from pumaid.io.table import LogReader, expand
from pumaid.preprocessing.options import DEFAULTS
from pumaid.preprocessing.suspicion import Watch
from pumaid.verbs.identify import identify
from pumaid.verbs.segment import segment


@pytest.fixture(scope="module")
def logs(tmp_path_factory) -> Path:
    """A pendulum's session in one Parquet file, and its recipe."""
    return make_session(tmp_path_factory.mktemp("cluster"))


def cut(logs: Path, folder: Path, rows: int) -> list[Path]:
    """The session's files cut into files of `rows` rows, wherever that falls, and one more of another session."""
    folder.mkdir()
    number = 0
    for path in expand([logs / "logs"]):
        table = pq.read_table(path)
        for start in range(0, len(table), rows):
            pq.write_table(table.slice(start, rows), folder / f"part_{number:03d}.parquet")
            number += 1
    shutil.copy(folder / "part_000.parquet", folder / "part_999.parquet")
    return expand([folder])


def one_pass(paths, robot) -> Dataset:
    """What one process leaves."""
    return segment(Watch(LogReader(paths, robot), robot), robot)


def taken(parts, robot) -> Dataset:
    """What parts leave together."""
    whole = Whole(robot, DEFAULTS)
    for part in parts:
        whole.add(part)
    return whole.dataset(refuse=True)


@pytest.mark.parametrize("rows", [700, 2500, 10**6])
def test_parts_are_the_whole(logs, tmp_path, rows):
    """However files cut the session, in motion or at rest, gathered parts have the runs of one pass, to the bit."""
    robot = read_recipe(logs / "recipe.yaml")
    paths, client = cut(logs, tmp_path / "parts", rows), Eager()
    assert same(gather(paths, robot, client), one_pass(paths, robot))
    assert client.calls.count("_tried") == len(paths)


def test_joining_is_associative(logs, tmp_path):
    """Parts joined from the left or from the right are the same."""
    robot = read_recipe(logs / "recipe.yaml")
    parts = [Reading(robot, DEFAULTS).piece(path) for path in cut(logs, tmp_path / "parts", 3000)]
    left = reduce(lambda early, late: joined(early, late, robot=robot, options=DEFAULTS), parts)
    right = reduce(lambda late, early: joined(early, late, robot=robot, options=DEFAULTS), parts[::-1])
    assert same(*(taken([part], robot) for part in (left, right))) and left.clocks == right.clocks


def test_what_only_all_files_show_is_judged_for_all(logs, tmp_path):
    """Degrees that are read as radians are refused as in one pass, with the same message."""
    robot = read_recipe(logs / "recipe.yaml")
    (tmp_path / "degrees").mkdir()
    for path in expand([logs / "logs"]):
        table = pq.read_table(path)
        for name in ("q1", "q2"):
            place = table.column_names.index(name)
            table = table.set_column(place, name, [np.degrees(table[name].to_numpy())])
        pq.write_table(table, tmp_path / "degrees" / path.name)
    paths = expand([tmp_path / "degrees"])
    with pytest.raises(LogError) as alone:
        one_pass(paths, robot)
    with pytest.raises(LogError) as together:
        gather(paths, robot, Eager())
    assert (str(together.value), together.value.slug) == (str(alone.value), "looks-like-degrees")


def test_a_refusal_comes_whole_from_another_process():
    """Pickled and back, an error says the same, several told together too."""
    one = LogError("empty-log", "no row", Where(file="a.csv", row=3), "record again")
    for error in (one, Faults([one, one])):
        back = pickle.loads(pickle.dumps(error))
        assert (type(back), str(back), back.slug) == (type(error), str(error), error.slug)


def test_a_part_comes_whole_from_another_process(logs):
    """Pickled and back, a part has the same runs to the bit and the same doubts."""
    robot = read_recipe(logs / "recipe.yaml")
    part = Reading(robot, DEFAULTS).piece(expand([logs / "logs"])[0])
    back = pickle.loads(pickle.dumps(part))
    assert same(back.dataset, part.dataset) and back.clocks == part.clocks
    assert back.sums.judged(refuse=True) == part.sums.judged(refuse=True)


@pytest.mark.slow
def test_a_worker_that_is_killed_loses_nothing(logs, tmp_path):
    """One of two worker processes is killed while files are read: the model is that of one process, to 1e-10."""
    distributed = pytest.importorskip("distributed", reason="pip install pumaid[dask]")
    robot = read_recipe(logs / "recipe.yaml")
    paths = cut(logs, tmp_path / "parts", 1000)
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        victim = next(iter(cluster.workers.values())).pid
        killed = []

        def progress(done: int, _: int) -> None:
            if done >= 2 and not killed:
                os.kill(victim, signal.SIGKILL)
                killed.append(victim)

        found = gather(paths, robot, client, progress=progress)
    assert killed
    alone = one_pass(paths, robot)
    values = [[value.value for value in identify(one, robot).values] for one in (found, alone)]
    np.testing.assert_allclose(*(np.array(one, dtype=float) for one in values), rtol=1e-10)


@pytest.mark.slow
def test_logs_in_a_store_are_read_by_a_cluster(logs, tmp_path):
    """Logs in fsspec's memory and local stores, read by workers in threads: the runs of the files themselves."""
    distributed = pytest.importorskip("distributed", reason="pip install pumaid[dask]")
    fsspec = pytest.importorskip("fsspec")
    robot = read_recipe(logs / "recipe.yaml")
    store = fsspec.filesystem("memory")
    plain = expand([logs / "logs"])
    for path in plain:
        store.pipe(f"/bucket/logs/{path.name}", path.read_bytes())
    wanted = one_pass(plain, robot)
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        for argument in ("memory://bucket/logs", f"file://{logs / 'logs'}"):
            found = gather(expand([argument]), robot, client)
            assert [facts.digest for facts in found.files] == [facts.digest for facts in wanted.files]
            assert all(
                np.array_equal(a.triangle.factor, b.triangle.factor)
                for a, b in zip(found.runs, wanted.runs, strict=True)
            )


@pytest.mark.slow
def test_a_cluster_from_the_command_line(logs, tmp_path):
    """``--dask local`` writes the bytes of one process; a file that is refused is told in one message."""
    pytest.importorskip("distributed", reason="pip install pumaid[dask]")
    folder = tmp_path / "experiment"
    cut(logs, tmp_path / "parts", 2000)
    shutil.copytree(tmp_path / "parts", folder / "logs")
    shutil.copy(logs / "recipe.yaml", folder)

    def pumaid(*more: str) -> subprocess.CompletedProcess[str]:
        line = [sys.executable, "-m", "pumaid", "identify", "logs", "--no-cache", "--trust", *more]
        return subprocess.run(line, cwd=folder, capture_output=True, text=True, check=False)

    done = pumaid("-o", "far.json", "--dask", "local", "--jobs", "1")
    assert done.returncode == 0 and "Traceback" not in done.stderr, done.stderr
    assert pumaid("-o", "here.json").returncode == 0
    assert (folder / "far.json").read_bytes() == (folder / "here.json").read_bytes()
    (folder / "logs" / "part_001.parquet").write_bytes((folder / "logs" / "part_000.parquet").read_bytes()[:3000])
    refused = pumaid("-o", "none.json", "--dask", "local", "--jobs", "1")
    assert refused.returncode == 3 and refused.stderr == pumaid("-o", "none.json").stderr
    assert (
        refused.stderr.startswith("error[damaged-log]: logs/part_001.parquet") and not (folder / "none.json").exists()
    )


@pytest.mark.slow
@pytest.mark.parametrize("ends", [nullcontext(), pytest.raises(LogError)], ids=["done", "refused"])
def test_a_guest_leaves_no_memory_on_workers(monkeypatch, tmp_path, ends):
    """Workers that somebody else started keep freed memory while they read, and give it back at the end."""
    distributed = pytest.importorskip("distributed", reason="pip install pumaid[dask]")
    told = tmp_path / "left.txt"
    monkeypatch.setattr(connect, "leave_memory", lambda: told.write_text(str(os.getpid())))
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster:
        with ends, connected(cluster.scheduler_address) as client:
            assert client.submit(int, "7").result() == 7
            if not isinstance(ends, nullcontext):
                raise LogError("empty-log", "it has no row", Where(), "record again")
        assert int(told.read_text()) == next(iter(cluster.workers.values())).pid


def test_a_worker_keeps_memory_while_it_reads(monkeypatch, logs):
    """Before a piece is read, so that its batches take no fresh pages."""
    done = []
    monkeypatch.setattr(gathering, "keep_memory", lambda: done.append("kept"))
    reading = MagicMock()
    reading.tried.side_effect = lambda piece: done.append(piece)
    gathering._tried(reading, logs)
    assert done == ["kept", logs]


@pytest.mark.parametrize("log", ["-", "pipe"])
def test_what_flows_is_not_for_a_cluster(logs, tmp_path, log):
    """Standard input and named pipes are refused before any worker waits for them."""
    os.mkfifo(tmp_path / "pipe")
    line = [sys.executable, "-m", "pumaid", "identify", log, "--dask", "local", "--recipe", str(logs / "recipe.yaml")]
    done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 3 and done.stderr.startswith("error[no-cluster]") and not done.stdout


@pytest.mark.parametrize(("place", "version"), [("scheduler", None), ("workers", "0.0.9")])
def test_a_cluster_with_another_pumaid_is_refused(monkeypatch, place, version):
    """Before any log is read: who has none, or another one, is named with what to install."""
    distributed = pytest.importorskip("distributed", reason="pip install pumaid[dask]")
    seen = {"scheduler": {"packages": {"pumaid": __version__}}, "workers": {}}
    other = {"packages": {"pumaid": version}}
    seen |= {"scheduler": other} if place == "scheduler" else {"workers": {"tcp://10.0.0.7:1": other}}
    client = MagicMock()
    client.get_versions.return_value = seen
    client.__enter__.return_value = client
    monkeypatch.setattr(distributed, "Client", lambda *_, **__: client)
    with pytest.raises(LogError) as refused, connected("tcp://10.0.0.5:8786"):
        pass
    assert refused.value.slug == "cluster-differs"
    assert ("no pumaid" if version is None else "10.0.0.7:1 has pumaid 0.0.9") in str(refused.value)
    assert f"=={__version__}" in refused.value.mend


@pytest.mark.parametrize("error", ["CancelledError", "nothing said", "KilledWorker", "CommClosedError"])
def test_a_cluster_that_goes_away_is_told(monkeypatch, error):
    """Its own errors become one refusal, none of pumaid's bugs."""
    distributed = pytest.importorskip("distributed", reason="pip install pumaid[dask]")
    from distributed.comm import CommClosedError

    raised = {
        "CancelledError": CancelledError("tried-1 cancelled for reason: scheduler-connection-lost"),
        "nothing said": CancelledError(),
        "KilledWorker": distributed.KilledWorker("tried-1", MagicMock(), 3),
        "CommClosedError": CommClosedError("in <TCP>: ended"),
    }[error]
    monkeypatch.setattr(connect, "_local", lambda _: nullcontext(MagicMock()))
    with pytest.raises(LogError) as told, connected("local"):
        raise raised
    assert told.value.slug == "cluster-lost" and "went away" in str(told.value)


@pytest.mark.slow
@pytest.mark.parametrize("moment", [0.8, 1.3, 1.8])
def test_ctrl_c_ends_a_local_cluster_quietly(logs, tmp_path, moment):
    """While workers start or read, Ctrl-C (to all of them, as a terminal sends it) leaves one line and no process."""
    pytest.importorskip("distributed", reason="pip install pumaid[dask]")
    cut(logs, tmp_path / "logs", 200)
    line = [sys.executable, "-m", "pumaid", "identify", "logs", "--no-cache", "--trust", "--dask", "local", "--recipe"]
    process = subprocess.Popen(
        [*line, str(logs / "recipe.yaml")], cwd=tmp_path, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    time.sleep(moment)
    os.killpg(process.pid, signal.SIGINT)
    told = process.communicate(timeout=60)[1]
    assert process.returncode in (130, 0) and "Traceback" not in told and "KeyboardInterrupt" not in told, told
    with pytest.raises(ProcessLookupError):
        for _ in range(100):
            os.killpg(process.pid, 0)
            time.sleep(0.1)


@pytest.mark.parametrize("answer", [b"", b"HTTP/1.0 400 Bad Request\r\n\r\n" * 9, b"\x01" + bytes(200)])
def test_a_stranger_in_place_of_a_scheduler(monkeypatch, answer):
    """Who says nothing, speaks HTTP or sends anything is no scheduler: one message, and no waiting without end."""
    pytest.importorskip("distributed", reason="pip install pumaid[dask]")

    monkeypatch.setattr(connect, "PATIENCE", 1)
    heard: list[socket.socket] = []

    def serve() -> None:
        with suppress(OSError):
            while True:
                heard.append(server.accept()[0])
                heard[-1].sendall(answer)

    with socket.create_server(("127.0.0.1", 0)) as server:
        threading.Thread(target=serve, daemon=True).start()
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        begun = time.monotonic()
        with pytest.raises(LogError) as refused, connected(address):
            pass
        assert refused.value.slug == "no-cluster" and address in refused.value.what and time.monotonic() - begun < 20
    for one in heard:
        one.close()
