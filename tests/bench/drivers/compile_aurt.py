"""aurt's symbolic model of an arm: `compile-rbd` and `compile-rd`, once for every arm."""

import os

from stopwatch import Stopwatch

watch = Stopwatch()
from aurt import api  # noqa: E402
from aurt.caching import PersistentPickleCache  # noqa: E402

if __name__ == "__main__":  # aurt starts processes of its own
    watch.loaded()
    watch.folder = watch.folder.resolve()
    os.chdir(watch.folder)
    cache = PersistentPickleCache("cache")
    api.compile_rbd("arm.csv", "rigid_body_dynamics", False, cache)
    api.compile_rd("rigid_body_dynamics", "none", [1], "robot_dynamics", cache)
    watch.done("aurt", "sympy", "numpy")
