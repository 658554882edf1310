"""Logs in an object store: paths with a scheme, such as ``s3://bucket/logs``, through fsspec."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any, BinaryIO

from pumaid.errors import LogError, Where

SCHEME, CHAIN = "://", "::"
#: Schemes of this machine's own files.
_LOCAL = ("file", "local")


@dataclass(frozen=True, slots=True)
class Remote:
    """A file in a store, as a path: it can be opened for reading, and nothing else."""

    url: str

    def __str__(self) -> str:
        return self.url

    @property
    def name(self) -> str:
        """The part behind the last slash."""
        return self.url.rpartition("/")[2]

    def open(self, mode: str = "rb") -> BinaryIO:
        """The file's bytes.

        Raises
        ------
        OSError
            The store refuses.
        """
        store, path = _store(self.url)
        with _told():
            opened: BinaryIO = store.open(path, mode)
        return opened

    @property
    def size(self) -> int:
        """Bytes, as the store says.

        Raises
        ------
        OSError
            The store refuses.
        """
        store, path = _store(self.url)
        with _told():
            return int(store.size(path) or 0)

    def is_file(self) -> bool:
        """Whether the system can open it by its name: never."""
        return False

    def stat(self) -> Any:
        """The system knows nothing of it.

        Raises
        ------
        OSError
            Always.
        """
        raise OSError(f"{self.url} is in a store")


def is_remote(argument: str) -> bool:
    """Whether an argument has a scheme."""
    return SCHEME in argument


def found_below(
    argument: str, *, is_log: Callable[[PurePosixPath], bool], order: Callable[[PurePosixPath], Any]
) -> list[Remote]:
    """The logs that an argument with a scheme means: one file, a folder, or a glob.

    Parameters
    ----------
    argument
        ``s3://bucket/logs``, ``s3://bucket/logs/*.parquet`` ...
    is_log, order
        Which files of a folder are logs, and what they are sorted by; both of paths in that folder.

    Raises
    ------
    LogError [no-such-log, no-store]
        Nothing is there; or the store cannot be reached.
    """
    if CHAIN in argument:
        mend = "copy the files to a folder first"
        raise LogError(
            "no-store", f"{argument}: addresses of several stores in one are not read", Where(argument), mend
        )
    store, path = _store(argument)
    try:
        with _told():
            names = _named(store, path, is_log=is_log, order=order)
    except OSError as error:
        what = f"{argument} cannot be listed: {error}"
        raise LogError("no-store", what, Where(file=argument), "check the address and the access rights") from error
    if not names:
        raise LogError("no-such-log", f"no log is at {argument}", Where(file=argument), "check the path")
    scheme = argument.partition(SCHEME)[0]
    # Only in a machine's own file system does a path begin at its root.
    return [Remote(scheme + SCHEME + (name if scheme in _LOCAL else name.lstrip("/"))) for name in names]


def _named(
    store: Any, path: str, *, is_log: Callable[[PurePosixPath], bool], order: Callable[[PurePosixPath], Any]
) -> list[str]:
    """Names of files in a store; a path that is there is taken as it stands, with whatever letters."""
    if store.isfile(path):
        return [path]
    folders = [path]
    if not store.isdir(path) and any(letter in path for letter in "*?["):
        matches = sorted(store.glob(path), key=lambda name: order(PurePosixPath(name)))
        files = [name for name in matches if store.isfile(name) and not PurePosixPath(name).name.startswith(".")]
        if files:
            return files
        folders = matches
    out = []
    for folder in folders:
        inside = {PurePosixPath(name).relative_to(PurePosixPath(folder)): name for name in store.find(folder)}
        out += [inside[one] for one in sorted(filter(is_log, inside), key=order)]
    return out


@contextmanager
def _told() -> Iterator[None]:
    """Whatever a store's own library raises, as a refusal of the system."""
    try:
        yield
    except (OSError, MemoryError):
        raise
    except Exception as error:
        raise OSError(f"{error} ({type(error).__name__})" if str(error) else type(error).__name__) from error


def _store(url: str) -> tuple[Any, str]:
    """The file system of a URL, and the path in it."""
    try:
        import fsspec
    except ImportError as error:
        what = f"{url} is in a store, and fsspec is not installed"
        raise LogError("no-store", what, Where(file=url), "pip install 'pumaid[dask]'") from error
    try:
        with _told():
            store, path = fsspec.core.url_to_fs(url)
    except OSError as error:
        mend = f"is {url.partition(SCHEME)[0]} the right scheme? Some need a package of their own"
        raise LogError("no-store", f"{url}: {error}", Where(file=url), mend) from error
    return store, str(path)
