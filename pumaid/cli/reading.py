"""The first step of every command that reads logs: the recipe, one pass over the logs, the held-out runs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pumaid.cli.options import Pass
from pumaid.cli.output import remark
from pumaid.cli.progress import progress
from pumaid.errors import LogError, Where

if TYPE_CHECKING:
    from pumaid.files.table import LogPath
    from pumaid.motion.options import SegmentOptions
    from pumaid.records import Estimate, Evidence, Robot

#: malloc.h: M_MMAP_THRESHOLD (the largest that it knows) and M_TRIM_THRESHOLD, in bytes.
_MALLOC = {-3: 32 << 20, -1: 256 << 20}
#: What ``--heldout`` is given for postures instead of files.
POSTURE = "posture"


def read_robot(recipe: Path | None, logs: Sequence[str] = ()) -> Robot:
    """The arm of some logs.

    Parameters
    ----------
    recipe
        ``--recipe``, or none: the recipe is looked for near the logs.
    logs
        As the user typed them.
    """
    from pumaid.files.recipe import read_recipe

    return read_recipe(recipe_path(recipe, logs))


def read_known_model(path: Path) -> Estimate:
    """A model, refused before any log is read where the catalogue lacks one of its effects."""
    from pumaid.choices import check_known
    from pumaid.files.result import read_model

    estimate = read_model(path)
    check_known(estimate.effects)
    return estimate


def check_model(estimate: Estimate, robot: Robot) -> None:
    """Refuse a model of another recipe, or whose effects are no longer what they were."""
    from pumaid.chosen import check_parameters
    from pumaid.files.result import check_same_recipe

    check_same_recipe(estimate, robot)
    check_parameters(estimate, robot)


def check_logs(estimate: Estimate, evidence: Evidence, *, trust: bool = False) -> None:
    """Refuse logs that a model was not fitted to; `trust` lets them pass, for a user who knows better."""
    from pumaid.errors import ModelError, Where

    known = set(estimate.logs.values())
    others = [facts for facts in evidence.files if facts.digest not in known]
    if trust or not known or not others:
        return
    shown = ", ".join(facts.name for facts in others[:3]) + (" ..." if len(others) > 3 else "")
    digests = f"(SHA-256 {others[0].digest[:12]}; it knows {', '.join(sorted(digest[:12] for digest in known)[:3])})"
    what = f"the model was not fitted to {len(others)} of these logs: {shown} {digests}"
    mend = "identify with these logs first, or give those of the model; --trust takes them all the same"
    raise ModelError("model-other-logs", what, Where(file=others[0].name), mend)


def read_evidence(
    logs: Sequence[str],
    recipe: Path | None,
    *,
    trust: bool = False,
    heldout: Sequence[str] = (),
    extra: Sequence[str] = (),
    options: SegmentOptions | None = None,
    how: Pass | None = None,
) -> tuple[Robot, Evidence]:
    """All that later steps know of some logs, read in one pass.

    Logs that cannot mean what the recipe says are refused once the pass has shown it.

    Parameters
    ----------
    logs
        As the user typed them: files, folders, globs, ``-``.
    recipe
        ``--recipe``, or none.
    trust
        Turn these refusals into notes.
    heldout
        ``--heldout``: files, folders or globs of logs, or ``posture``.
    extra
        Columns of the logs that the user suspects; they arrive in the runs' cells.
    options
        Thresholds of the segmentation; else its own.
    how
        ``--no-cache`` and ``--jobs``; without it on all cores, and nothing is kept.

    Returns
    -------
    robot, evidence
        Runs that the plan beside the recipe or the user keeps for judging are marked as held out.
    """
    from pumaid.files.evidence_cache import EvidenceCache
    from pumaid.files.paths import expand
    from pumaid.motion.options import DEFAULTS

    how, options = how or Pass(cached=False), options or DEFAULTS
    paths = expand(logs)
    robot = read_robot(recipe, logs)
    kept = EvidenceCache(paths, robot, options=repr((options, trust, tuple(extra)))) if how.cached else None
    evidence = kept.get() if kept is not None else None
    if evidence is None:
        if how.dask:
            evidence = _on_cluster(paths, robot, trust=trust, options=options, how=how)
        else:
            evidence = _one_pass(paths, robot, trust=trust, extra=extra, options=options, jobs=how.jobs)
        if kept is not None:
            kept.put(evidence)
    planned = _with_plan(evidence, robot, experiment_folder(recipe, logs))
    return robot, _with_heldout(planned, heldout) if heldout else planned


def _one_pass(
    paths: Sequence[LogPath], robot: Robot, *, trust: bool, extra: Sequence[str], options: SegmentOptions, jobs: int
) -> Evidence:
    """Read, watch and segment logs; on more than one core where there is enough to read."""
    _keep_memory()
    if others := _others(paths, jobs):
        return _on_cores(paths, robot, others=others, trust=trust, extra=extra, options=options)

    from pumaid.files.ahead import Ahead
    from pumaid.files.table import LogReader
    from pumaid.motion.suspicion import Watch
    from pumaid.verbs.segment import segment

    watched = Watch(LogReader(paths, robot, extra=extra), robot, refuse=not trust)
    # Who waits for a pipe cannot be told to stop.
    ahead = jobs != 1 and all(path.is_file() for path in paths)
    with progress("reading logs") as step:
        return segment(
            Ahead(watched) if ahead else watched,
            robot,
            options=options,
            progress=lambda rows: step(rows, f"{rows:,} rows"),
        )


def _keep_memory() -> None:
    """Have the C library of Linux keep what is freed for the next batch; fresh pages cost a quarter of a short pass."""
    import ctypes
    from contextlib import suppress

    with suppress(OSError, AttributeError, TypeError):
        library = ctypes.CDLL(None)
        for option, size in _MALLOC.items():
            library.mallopt(option, size)


def _others(paths: Sequence[LogPath], jobs: int) -> int:
    """How many more processes are worth while."""
    if jobs == 1:
        return 0
    from pumaid.cluster.cores import others

    return others(paths, jobs)


def _on_cores(
    paths: Sequence[LogPath], robot: Robot, *, others: int, trust: bool, extra: Sequence[str], options: SegmentOptions
) -> Evidence:
    """The same by several processes."""
    from pumaid.cluster.cores import spread, started
    from pumaid.cluster.pieces import Reading
    from pumaid.files.table import LogReader

    LogReader(paths, robot, extra=extra).check_extra()
    reading = Reading(robot, options, tuple(dict.fromkeys(extra)))
    with started(reading, others) as mates, progress("reading logs") as step:
        return spread(
            paths,
            reading,
            mates,
            refuse=not trust,
            progress=lambda done, count: step(done, f"{done} of {count} files or parts of files"),
        )


@contextmanager
def one_cluster(how: Pass) -> Iterator[Pass]:
    """The same way to read, with one cluster for all experiments that are read meanwhile, from the first on.

    Parameters
    ----------
    how
        With ``--dask`` or without.
    """
    with ExitStack() as stack:

        @cache
        def client() -> Any:
            from pumaid.cluster.connect import connected

            found = stack.enter_context(connected(how.dask, workers=how.jobs or None))
            if not found.scheduler_info()["workers"]:
                remark(f"no worker has come to {how.dask} yet; reading begins with the first (dask worker {how.dask})")
            return found

        yield replace(how, client=how.client or client)


def _on_cluster(paths: Sequence[LogPath], robot: Robot, *, trust: bool, options: SegmentOptions, how: Pass) -> Evidence:
    """The same on the workers of a cluster, a file each."""
    from pumaid.cluster.gather import gather
    from pumaid.files.paths import STDIN

    if STDIN in paths:
        what = "standard input cannot be read by the workers of a cluster"
        raise LogError("no-cluster", what, Where(field=f"--dask {how.dask}"), "name files, or leave --dask away")
    with one_cluster(how) as known, progress("reading logs", total=len(paths)) as step:
        assert known.client is not None
        return gather(
            paths,
            robot,
            known.client(),
            options=options,
            refuse=not trust,
            progress=lambda done, count: step(done, f"{done} of {count} files"),
        )


def experiment_folder(recipe: Path | None, logs: Sequence[str] = ()) -> Path:
    """The folder that holds the recipe, and so the plan and the results.

    A recipe that ships with pumaid has no experiment around it; then it is the working folder.

    Parameters
    ----------
    recipe
        ``--recipe``, or none.
    logs
        As the user typed them.
    """
    from pumaid.files.recipe import shipped_recipes

    path = recipe_path(recipe, logs)
    shipped = {one.resolve() for one in shipped_recipes().values()}
    return Path() if path.resolve() in shipped else path.parent


def results_folder(results: Path | None, recipe: Path | None, logs: Sequence[str] = ()) -> Path:
    """Where results go: what ``--results`` says, else ``results`` beside the recipe.

    Parameters
    ----------
    results
        ``--results``, or none.
    recipe
        ``--recipe``, or none.
    logs
        As the user typed them.
    """
    return results or experiment_folder(recipe, logs) / "results"


def recipe_path(recipe: Path | None, logs: Sequence[str] = ()) -> Path:
    """Where the recipe is: what ``--recipe`` says, else near the logs."""
    from pumaid.files.recipe import find_recipe

    return find_recipe(recipe, [Path(log) for log in logs])


def _with_heldout(evidence: Evidence, wanted: Sequence[str]) -> Evidence:
    """Runs of the files that the user names marked as held out; the word ``posture`` means each joint's last one."""
    from pumaid.files.paths import meant
    from pumaid.motion.heldout import hold_out

    names = [facts.name for facts in evidence.files]
    files = dict.fromkeys(name for word in wanted if word != POSTURE for name in meant(word, names))
    return hold_out(evidence, files=files, postures=POSTURE in wanted)


def _with_plan(evidence: Evidence, robot: Robot, folder: Path) -> Evidence:
    from pumaid.files.plan import find_plan, read_plan

    path = find_plan([folder])
    if path is None:
        return evidence
    from pumaid.motion.planned import mark_heldout

    return mark_heldout(evidence, read_plan(path, robot))
