"""What a pass left, kept on disk: the same to the bit, for these logs only, and nobody else's files are touched."""

from __future__ import annotations

import os
import pickle
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from motion_worlds import World, make, robot

from pumaid.errors import Note, Where
from pumaid.io import evidence_cache
from pumaid.io.evidence_cache import EvidenceCache, evidence_shelf
from pumaid.io.evidence_npz import is_evidence
from pumaid.io.table import LogReader, write_log
from pumaid.robot import EffectChoice
from pumaid.verbs.segment import segment

WORLD = World(motions=4, rate=200.0)
ARM = robot(WORLD)


@pytest.fixture
def logs(tmp_path) -> list[Path]:
    """Two logs of a small arm."""
    paths = [tmp_path / "a.parquet", tmp_path / "b.csv"]
    for seed, path in enumerate(paths):
        write_log(path, make(WORLD, seed).logs, ARM)
    return paths


@pytest.fixture
def folder(tmp_path) -> Path:
    """Where things are kept."""
    return tmp_path / "cache"


def cache(logs, folder, arm=ARM, options="usual") -> EvidenceCache:
    """The cache of some logs."""
    return EvidenceCache(logs, arm, options=options, folder=folder)


def told(thing):
    """All fields of a record, arrays by their bytes, down to the last."""
    if hasattr(thing, "__dataclass_fields__"):
        return {item.name: told(getattr(thing, item.name)) for item in fields(thing)}
    if isinstance(thing, np.ndarray):
        return thing.dtype, thing.shape, np.ascontiguousarray(thing).tobytes()
    if isinstance(thing, tuple):
        return tuple(map(told, thing))
    return repr(thing)


def kept(logs, folder):
    """Evidence of the logs, now in the cache."""
    dataset = segment(LogReader(logs, ARM, extra=["t"]), ARM)
    note = Note("gaps", "a gap", Where(file="a", row=3))
    dataset = replace(dataset, notes=(*dataset.notes, note))
    cache(logs, folder).put(dataset)
    return dataset


def test_what_was_kept_comes_back_to_the_bit(logs, folder):
    """Runs, rejects, bins, triangles, facts and notes are those that were put."""
    dataset = kept(logs, folder)
    assert dataset.runs
    assert any(reject.bins is not None for reject in dataset.rejects)
    assert told(cache(logs, folder).get()) == told(dataset)


def test_there_is_a_meanwhile_only_where_something_may_fit(logs, folder):
    """What is done while logs are hashed is left to the pass where nothing is kept of them."""
    called = []
    assert cache(logs, folder).get(meanwhile=lambda: called.append(True)) is None
    assert not called
    dataset = kept(logs, folder)
    assert told(cache(logs, folder).get(meanwhile=lambda: called.append(True))) == told(dataset)
    assert called == [True]


def test_other_content_is_not_found(logs, folder):
    """A log of the same name, size and times with one digit changed is another log."""
    kept(logs, folder)
    state, data = logs[1].stat(), bytearray(logs[1].read_bytes())
    data[-3] ^= 1
    logs[1].write_bytes(data)
    os.utime(logs[1], ns=(state.st_atime_ns, state.st_mtime_ns))
    assert cache(logs, folder).get() is None


def test_a_log_that_changed_during_the_pass_is_not_kept(logs, folder):
    """What was read may be neither the old content nor the new one."""
    dataset = segment(LogReader(logs, ARM), ARM)
    one = cache(logs, folder)
    logs[1].write_bytes(logs[1].read_bytes() + b"\n")
    one.put(dataset)
    assert not folder.exists()


def test_the_recipe_counts_where_the_pass_sees_it(logs, folder):
    """Another sign of a current is another pass; another effect is not, so that --add finds what was kept."""
    kept(logs, folder)
    turned = replace(ARM, log=replace(ARM.log, signs={"current": (-1,) * ARM.n_joints}))
    assert cache(logs, folder, turned).get() is None
    more = replace(ARM, effects=(EffectChoice("stribeck", 1),), digest="0", gravity=(0.0, 0.0, 9.8))
    assert cache(logs, folder, more).get() is not None


def test_options_and_order_count(logs, folder):
    """Other thresholds and another order of the files are other passes."""
    kept(logs, folder)
    assert cache(logs, folder, options="others").get() is None
    assert cache(logs[::-1], folder).get() is None


def test_another_version_is_not_trusted(logs, folder, monkeypatch):
    """What another pumaid kept is made anew."""
    kept(logs, folder)
    monkeypatch.setattr(evidence_cache, "__version__", "999")
    assert cache(logs, folder).get() is None


@pytest.mark.parametrize("share", [0.0, 0.001, 0.1, 0.5, 0.9, 0.999])
@pytest.mark.parametrize("fault", ["cut", "flipped"])
def test_damage_is_seen(logs, folder, share, fault):
    """A file that was cut or altered anywhere is as good as none."""
    kept(logs, folder)
    (path,) = folder.iterdir()
    data = bytearray(path.read_bytes())
    at = int(share * len(data))
    data = data[:at] if fault == "cut" else data[:at] + bytes([data[at] ^ 0x55]) + data[at + 1 :]
    path.write_bytes(data)
    found = cache(logs, folder).get()
    assert found is None or told(found) == told(segment(LogReader(logs, ARM, extra=["t"]), ARM)) | {
        "notes": told(found.notes)
    }


def test_no_code_is_run_from_a_kept_file(logs, folder, tmp_path):
    """Objects that would be unpickled are refused unseen."""
    kept(logs, folder)
    (path,) = folder.iterdir()

    class Trap:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "trapped"),)

    pickle.loads(pickle.dumps(Trap()))
    (tmp_path / "trapped").rmdir()
    np.savez(path, pumaid_evidence=np.array([Trap()], dtype=object))
    assert cache(logs, folder).get() is None
    assert not (tmp_path / "trapped").exists()


def test_only_own_files_are_removed_oldest_first(logs, folder, monkeypatch):
    """Beyond the bound the ones longest unused go; others' files stay, whatever they are called."""
    kept(logs, folder)
    (first,) = folder.iterdir()
    os.utime(first, (1.0, 1.0))
    strange = folder / f"{'0' * 16}-{'1' * 32}.npz"
    strange.write_bytes(b"not pumaid's")
    (folder / "notes.txt").write_text("mine")
    monkeypatch.setattr(evidence_cache, "MOST_BYTES", first.stat().st_size + 10)
    cache(logs, folder, options="others").put(segment(LogReader(logs, ARM), ARM))
    assert not first.exists()
    assert strange.exists()
    assert (folder / "notes.txt").exists()
    assert len(list(folder.iterdir())) == 3
    assert evidence_shelf(folder).size() == sum(path.stat().st_size for path in folder.iterdir() if is_evidence(path))


def test_a_folder_that_refuses_is_no_error(logs, tmp_path):
    """Where nothing can be kept, nothing is."""
    (tmp_path / "file").write_text("in the way")
    kept(logs, tmp_path / "file")
    assert cache(logs, tmp_path / "file").get() is None


def test_pipes_are_not_kept(logs, folder):
    """What can be read only once has no content that could be looked up."""
    assert cache([Path("-")], folder).get() is None
    cache([Path("-")], folder).put(segment(LogReader(logs[:1], ARM), ARM))
    assert not folder.exists()
