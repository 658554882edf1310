"""Logs in an object store: paths with a scheme, such as ``s3://bucket/logs``, through fsspec."""

from __future__ import annotations

import fnmatch
from dataclasses import dataclass
from typing import Any, BinaryIO

from pumaid.errors import LogError, Where

SCHEME = "://"


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


def found_below(argument: str, endings: tuple[str, ...]) -> list[Remote]:
    """The logs that an argument with a scheme means, in order of their names: one file, a folder, or a glob.

    Parameters
    ----------
    argument
        ``s3://bucket/logs``, ``s3://bucket/logs/*.parquet`` ...
    endings
        Of logs in a folder.

    Raises
    ------
    LogError [no-such-log, no-store]
        Nothing is there; or the store cannot be reached.
    """
    store, path = _store(argument)
    scheme = argument.partition(SCHEME)[0]
    try:
        if any(letter in path for letter in "*?["):
            names = [name for name in store.glob(path) if store.isfile(name)]
        elif store.isfile(path):
            names = [path]
        else:
            names = [name for name in store.find(path) if name.lower().endswith(endings)]
            names = [name for name in names if not fnmatch.fnmatch(name, "*/results/*")]
    except OSError as error:
        what = f"{argument} cannot be listed: {error}"
        raise LogError("no-store", what, Where(file=argument), "check the address and the access rights") from error
    if not names:
        raise LogError("no-such-log", f"nothing is at {argument}", Where(file=argument), "check the path")
    return [Remote(f"{scheme}{SCHEME}{name.lstrip('/') if scheme != 'file' else name}") for name in sorted(names)]


def _store(url: str) -> tuple[Any, str]:
    """The file system of a URL, and the path in it."""
    try:
        import fsspec
    except ImportError as error:
        what = f"{url} is in a store, and fsspec is not installed"
        raise LogError("no-store", what, Where(file=url), "pip install 'pumaid[dask]'") from error
    try:
        store, path = fsspec.core.url_to_fs(url)
    except (ImportError, ValueError) as error:
        raise LogError("no-store", f"{url}: {error}", Where(file=url), "install the package that it names") from error
    return store, str(path)
