"""The block `safety` of a recipe: what becomes of it, and each way to get it wrong."""

from pathlib import Path

import pytest

from pumaid.errors import Faults, PumaidError
from pumaid.io.recipe import read_recipe, shipped_recipes, started_from
from pumaid.robot import Box, Safety, Sphere

ARM = shipped_recipes()["puma560"].read_text(encoding="utf-8") + "safety:\n"
BOX = "{name: table, min: [-1, -1, -1], max: [1, 1, -0.02]}"
BALL = "{link: 3, centre: [0.2, 0, 0], radius: 0.08}"


def read(tmp_path: Path, block: str) -> Safety | None:
    path = tmp_path / "recipe.yaml"
    path.write_text(ARM + "\n".join(f"  {line}" for line in block.splitlines()), encoding="utf-8")
    return read_recipe(path).safety


def test_block_is_read(tmp_path):
    """Boxes, spheres, tool, margin and ignored links become the record, in m though the file's angles are degrees."""
    found = read(tmp_path, f"tool: [0, 0, 0.1]\nboxes: [{BOX}]\nspheres: [{BALL}]\nmargin: 0.05\nignore: [[6, 4]]")
    table, ball = Box("table", (-1, -1, -1), (1, 1, -0.02)), Sphere(3, (0.2, 0, 0), 0.08)
    assert found == Safety((table,), (ball,), (0, 0, 0.1), 0.05, ((4, 6),))


def test_defaults(tmp_path):
    """An empty block means nothing; a box without a name is told by its number; 20 mm are left."""
    assert read(tmp_path, "") is None
    found = read(tmp_path, "boxes: [{min: [0, 0, 0], max: [1, 1, 1]}]\nspheres:")
    assert found == Safety((Box("box 1", (0, 0, 0), (1, 1, 1)),), margin=0.02)


@pytest.mark.parametrize(
    ("block", "slug", "words"),
    [
        ("boxs: []", "recipe-bad-key", "did you mean boxes?"),
        ("boxes: [{min: [0, 0, 0]}]", "recipe-bad-key", "add max: [x, y, z]"),
        ("boxes: [{min: [0, 0, 1], max: [1, 1, 0]}]", "recipe-bad-value", "the box has no inside"),
        ("boxes: [{min: [0, 0], max: [1, 1, 1]}]", "recipe-bad-value", "min has too few values"),
        ("boxes: [{min: [0, 0, .nan], max: [1, 1, 1]}]", "recipe-bad-value", "finite number"),
        ("boxes: [{min: [0, 0, 0], max: [1000, 1, 1]}]", "recipe-bad-value", "m, not mm"),
        (f"boxes: [{BOX}, {BOX}]", "recipe-bad-value", "boxes 1 and 2 have the same name"),
        ("boxes: 3", "recipe-bad-value", "write [{name: table"),
        ("spheres: [{link: 7, centre: [0, 0, 0], radius: 1}]", "recipe-bad-value", "there is no link 7"),
        ("spheres: [{link: -1, centre: [0, 0, 0], radius: 1}]", "recipe-bad-value", "from 0 (the base) to 6"),
        ("spheres: [{link: 1.5, centre: [0, 0, 0], radius: 1}]", "recipe-bad-value", "integer"),
        ("spheres: [{link: 1, centre: [0, 0, 0], radius: -1}]", "recipe-bad-value", "greater than 0"),
        ("spheres: [{link: 1, centre: [0, 0, 0], radius: 80}]", "recipe-bad-value", "by 1000"),
        ("spheres: [{link: 1, center: [0, 0, 0], radius: 1}]", "recipe-bad-key", "did you mean centre?"),
        ("margin: -0.1", "recipe-bad-value", "greater than or equal to 0"),
        ("tool: [0, 0]", "recipe-bad-value", "tool has too few values"),
        ("ignore: [[1, 2]]", "recipe-bad-value", "neighbours"),
        ("ignore: [[1, 9]]", "recipe-bad-value", "there is no link 9"),
    ],
)
def test_faults(tmp_path, block, slug, words):
    """Each fault is told with its line and what would mend it."""
    with pytest.raises(PumaidError) as caught:
        read(tmp_path, block)
    found = caught.value.faults if isinstance(caught.value, Faults) else [caught.value]
    assert [fault.slug for fault in found] == [slug]
    assert words in str(found[0])
    assert found[0].where.line == len(ARM.splitlines()) + 1


def test_all_faults_at_once(tmp_path):
    """Faults of several blocks are told together, in the order of the lines."""
    with pytest.raises(Faults) as caught:
        read(tmp_path, "margin: 2\nboxes: [{min: [1, 0, 0]}]\nspheres: [{link: 9, centre: 3}]")
    lines = [fault.where.line - len(ARM.splitlines()) for fault in caught.value.faults]
    assert lines == [1, 2, 3, 3, 3]


def test_the_remarks_of_a_new_recipe_are_a_block(tmp_path):
    """What `pumaid init` writes as remarks on safety is a block that is read, once its marks are taken away."""
    text = started_from("panda")
    block = text[text.index("# safety:") :].replace("# ", "", 1).replace("\n# ", "\n").replace("    # ", " # ")
    path = tmp_path / "recipe.yaml"
    path.write_text(text + block, encoding="utf-8")
    safety = read_recipe(path).safety
    assert (len(safety.boxes), len(safety.spheres), safety.tool) == (1, 1, (0, 0, 0.1))
