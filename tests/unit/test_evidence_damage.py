"""A kept pass that was edited, or is no such file at all: it counts as none, and nothing is waited for."""

from __future__ import annotations

import json
import os
import zipfile
from pathlib import Path

import numpy as np
import pytest
from motion_worlds import World, make, robot

from pumaid.io import evidence_npz
from pumaid.io.evidence_cache import EvidenceCache
from pumaid.io.evidence_npz import FIRST
from pumaid.io.kept import cache_fault, cache_folder
from pumaid.io.table import LogReader, write_log
from pumaid.verbs.segment import segment

WORLD = World(motions=4, rate=200.0)
ARM = robot(WORLD)


@pytest.fixture(scope="module")
def log(tmp_path_factory) -> Path:
    """One log of a small arm."""
    path = tmp_path_factory.mktemp("logs") / "a.parquet"
    write_log(path, make(WORLD, 0).logs, ARM)
    return path


@pytest.fixture(scope="module")
def dataset(log):
    """Its runs."""
    return segment(LogReader([log], ARM), ARM)


@pytest.fixture
def cache(log, dataset, tmp_path) -> EvidenceCache:
    """A cache that has them."""
    made = EvidenceCache([log], ARM, options="usual", folder=tmp_path / "cache")
    made.put(dataset)
    assert made.get() is not None
    return made


@pytest.fixture
def path(cache, tmp_path) -> Path:
    """Its one file."""
    (found,) = (tmp_path / "cache").iterdir()
    return found


def members(path: Path) -> dict[str, np.ndarray]:
    """All arrays of a kept file."""
    with np.load(path) as stored:
        return {name: stored[name] for name in stored.files}


def edit(path: Path, *steps: object, to: object, redone: bool = True) -> None:
    """A kept file with another value in its JSON part, or another array; with the digest that belongs to it or not."""
    arrays = members(path)
    digest = arrays.pop("digest")
    if steps[0] in arrays:
        arrays[str(steps[0])] = to(arrays[str(steps[0])])
    else:
        told = json.loads(arrays[FIRST].tobytes())
        place = told
        for step in steps[:-1]:
            place = place[step]
        place[steps[-1]] = to
        arrays[FIRST] = np.frombuffer(json.dumps(told).encode(), dtype=np.uint8)
    np.savez(path, **arrays, digest=evidence_npz.digest_of(arrays, path.name) if redone else digest)


def test_an_edit_that_leaves_the_digest_is_seen(cache, path):
    """Half of all that was measured is still a pass by its form."""
    edit(path, "factor", to=lambda values: values * 0.5, redone=False)
    assert cache.get() is None


def test_a_file_under_the_name_of_another_is_seen(cache, path):
    """What was kept for other options is whole, and not what is asked for."""
    path.rename(path.with_name("0" * 16 + "-" + "1" * 32 + ".npz"))
    assert evidence_npz.read_dataset(next(path.parent.iterdir()), ARM.n_joints) is None


JSON = {
    "another log": (("files", 0, "digest"), "0" * 64),
    "no logs": (("files",), []),
    "a count below zero": (("triangles", 0, 1), -1),
    "a count that is not that of the cells": (("triangles", 0, 1), 7),
    "other regressors": (("triangles", 0, 0), ["cos", "sin"]),
    "a joint beyond": (("runs", "joint", 0), 99),
    "a joint in words": (("runs", "joint", 0), "a"),
    "a joint that is true": (("runs", "joint", 0), True),
    "a kind of run that is none": (("runs", "kind", 0), "odd"),
    "a start that is no number": (("runs", "start", 0), float("nan")),
    "a row too large": (("runs", "first_row", 0), 10**400),
    "fewer columns": (("runs", "speed"), []),
    "a missing column": (("runs",), {}),
    "a reject of no joint": (("rejects", "joints", 0), [0]),
    "a note without text": (("notes",), [{"slug": "a", "text": None, "where": {}}]),
    "rows in words": (("files", 0, "rows"), "many"),
    "an extra column": (("extra",), ["t"]),
}


@pytest.mark.parametrize("name", JSON)
def test_entries_that_no_pass_leaves(cache, path, name):
    """Even where the digest was redone, nothing goes on that would end somewhere else."""
    steps, to = JSON[name]
    edit(path, *steps, to=to)
    assert cache.get() is None


ARRAYS = {
    "shorter": lambda values: values[:-1],
    "single": lambda values: values.astype("f4"),
    "complex": lambda values: values.astype(complex),
    "big endian": lambda values: values.astype(">f8"),
    "text": lambda values: values.astype("U9"),
    "dates": lambda values: np.zeros(len(values), dtype="M8[s]"),
    "void": lambda values: np.zeros(len(values), dtype="V0"),
    "records": lambda values: np.zeros(len(values), dtype=[("a", "f8")]),
    "square": lambda values: values[:4].reshape(2, 2),
    "no numbers": lambda values: np.where(np.arange(len(values)) == 0, np.nan, values),
}


@pytest.mark.parametrize("name", ARRAYS)
def test_arrays_that_no_pass_leaves(cache, path, monkeypatch, name):
    """Other types, shapes and lengths."""
    with monkeypatch.context() as patched:
        patched.setattr(evidence_npz, "digest_of", lambda *_: np.zeros(32, dtype=np.uint8))
        edit(path, "factor", to=ARRAYS[name])
        assert cache.get() is None


HEADERS = (
    b"{'descr': '<f8', 'fortran_order': False, 'shape': (" + b"1" + b"0" * 27 + b",), }",
    b"{'descr': '<f8', 'fortran_order': False, 'shape': " + b"[" * 60,
    b"{'descr': '|V0', 'fortran_order': False, 'shape': (9,), }",
)


@pytest.mark.parametrize("header", HEADERS)
def test_headers_of_arrays_are_not_believed(cache, path, header):
    """A header is the one that numpy writes, or the file counts as none; no length is taken from it."""
    data, at = bytearray(path.read_bytes()), path.read_bytes().index(b"factor.npy") + 20
    at = data.index(b"{", at)
    data[at : at + 117] = header.ljust(117)[:117]
    path.write_bytes(data)
    assert cache.get() is None


@pytest.mark.parametrize(("offset", "value"), [(8, 1), (6, 99)])
def test_members_that_zip_cannot_read(cache, path, offset, value):
    """Encrypted, or of a version to come."""
    data = bytearray(path.read_bytes())
    data[data.index(b"PK\x01\x02") + offset] = value
    path.write_bytes(data)
    with pytest.raises((RuntimeError, NotImplementedError)), zipfile.ZipFile(path) as archive:
        archive.read(archive.infolist()[0])
    assert cache.get() is None


def test_lists_without_end(cache, path):
    """JSON that nests deeper than Python goes."""
    arrays = members(path) | {FIRST: np.frombuffer(b"[" * 200_000, dtype=np.uint8)}
    del arrays["digest"]
    np.savez(path, **arrays, digest=evidence_npz.digest_of(arrays, path.name))
    assert cache.get() is None


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no pipes with names")
def test_pipes_and_devices_are_not_opened(cache, path):
    """In place of the file: a pipe nobody writes to, a device without end."""
    path.unlink()
    os.mkfifo(path)
    assert cache.get() is None
    path.unlink()
    path.symlink_to("/dev/zero")
    assert cache.get() is None


def test_what_was_damaged_is_made_anew(cache, path, dataset):
    """The next pass takes its place."""
    path.write_bytes(b"")
    assert cache.get() is None
    cache.put(dataset)
    assert cache.get() is not None


def test_no_home_no_cache(log, dataset, monkeypatch):
    """A user whom the system does not know has no folder; nothing is kept, and it is said why."""
    monkeypatch.delenv("PUMAID_CACHE")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", lambda: (_ for _ in ()).throw(RuntimeError("no home")))
    assert cache_folder() is None
    cache = EvidenceCache([log], ARM, options="usual")
    cache.put(dataset)
    assert cache.get() is None
    assert "PUMAID_CACHE" in str(cache_fault(None))


def test_folders_that_keep_nothing_are_told(tmp_path):
    """A file in the way, a link to nowhere; a folder that is not there yet is none."""
    (tmp_path / "file").write_text("mine")
    (tmp_path / "link").symlink_to("nowhere")
    assert "no folder" in str(cache_fault(tmp_path / "file" / "evidence"))
    assert "leads nowhere" in str(cache_fault(tmp_path / "link" / "evidence"))
    assert cache_fault(tmp_path / "new" / "evidence") is None
