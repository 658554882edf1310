"""Parts of libraries that come along unasked are loaded when somebody uses them, not when the program starts."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import LazyLoader
from types import ModuleType

#: Parts of numpy that scipy fetches by ``from numpy import *`` and that nobody uses here, in one thread or in several.
#: With them, `scipy.special` takes 0.03 to 0.04 s more of every command to load.
UNASKED = frozenset(
    f"numpy.{name}" for name in ("char", "ctypeslib", "f2py", "polynomial", "rec", "strings", "testing")
)


class Later(MetaPathFinder):
    """Finds the modules of `UNASKED`, and leaves their loading to the first look at what is in them."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """A module as Python itself finds it, with a loader that waits; None of all others."""
        if fullname not in UNASKED:
            return None
        found = PathFinder.find_spec(fullname, path, target)
        if found is not None and found.loader is not None:
            found.loader = LazyLoader(found.loader)
        return found


def load_later() -> None:
    """Have the modules of `UNASKED` wait, and no plugins looked for: in the program, not in one that imports pumaid."""
    sys.meta_path.insert(0, Later())
    # Pydantic looks through all that is installed for code that wants to see recipes, too.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
