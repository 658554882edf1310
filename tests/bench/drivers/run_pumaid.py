"""`pumaid identify` on a CSV log. Run twice: what the first run loads, the second loads before its clock starts."""

import importlib
import json
import shutil
import sys
from contextlib import suppress

from stopwatch import Stopwatch

watch = Stopwatch()
modules = watch.folder / "modules.json"
if modules.exists():
    for name in json.loads(modules.read_text(encoding="utf-8")):
        with suppress(ImportError):
            importlib.import_module(name)
from pumaid.cli import group  # noqa: E402

watch.loaded()
model = watch.folder / "model.json"
shutil.rmtree(watch.folder / "results", ignore_errors=True)
words = [str(watch.folder / "pumaid"), "--recipe", str(watch.folder / "recipe.yaml"), "-o", str(model)]
group.main(["identify", *words], standalone_mode=False)
watch.done("pumaid", "numpy", "pyarrow")
modules.write_text(json.dumps([name for name in sys.modules if name != "__main__"]), encoding="utf-8")

from pumaid import read_model  # noqa: E402
from pumaid.exports.formulas import Formulas  # noqa: E402
from pumaid.io.recipe import read_recipe  # noqa: E402

asked = watch.questions()
told = Formulas.of(read_model(model), read_recipe(watch.folder / "recipe.yaml"))
gravity, whole = told.weight(asked["position"]), told.predicted(asked["position"], asked["velocity"])
watch.answer(gravity / asked["gain"], whole / asked["gain"])
