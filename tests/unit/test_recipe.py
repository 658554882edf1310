"""A recipe: where it is looked for, what becomes of it, and what is said of each way to get it wrong."""

import hashlib
import math
from pathlib import Path

import numpy as np
import pytest

from pumaid.errors import Faults, PumaidError, RecipeError
from pumaid.io.recipe import blank, find_recipe, read_recipe, shipped_recipes
from pumaid.robot import Box, Capsule, Safety

GOOD = """\
name: arm
units: {angle: deg}
gravity: [0, 0, -9.80665]
joints:
  - {name: waist, type: revolute, alpha: 0, a: 0, d: 0.1, limits: [-160, 160], max_velocity: 100}
  - {name: boom, type: prismatic, alpha: 90, a: 0.2, theta: 180, d: 0.3, limits: [0, 0.5], max_velocity: 1}
  - {name: hand, type: revolute, alpha: -90, a: 0, d: 0, theta: 45, gear_ratio: -50}
log:
  position: "p{joint0}"
  units: {position: deg}
  signs: {current: [1, -1, 1]}
effects:
  - {effect: stribeck, joint: hand, shape: {velocity: 0.1}}
  - {effect: cogging, joint: 1}
  - {effect: load_friction}
source: a test
"""


#: Ten levels of nine aliases each.
LAUGHS = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
LAUGHS += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 10)]


@pytest.fixture
def recipe(tmp_path: Path):
    """A function that writes a text and reads it as a recipe."""

    def read(text: str | bytes):
        path = tmp_path / "recipe.yaml"
        path.write_bytes(text.encode() if isinstance(text, str) else text)
        return read_recipe(path)

    return read


def faults_of(read, text: str | bytes) -> list[PumaidError]:
    with pytest.raises(PumaidError) as caught:
        read(text)
    return list(caught.value.faults) if isinstance(caught.value, Faults) else [caught.value]


def test_a_file_of_degrees_becomes_si(recipe) -> None:
    """Angles and speeds of a revolute joint become rad; a slide has m and m/s, and a constant turn."""
    robot = recipe(GOOD)
    assert robot.joint(3).alpha == pytest.approx(-math.pi / 2)
    assert robot.joint(3).theta == pytest.approx(math.pi / 4)
    assert robot.joint(1).limits == pytest.approx((-math.radians(160), math.radians(160)))
    assert robot.joint(1).max_velocity == pytest.approx(math.radians(100))
    boom = robot.joint(2)
    assert (boom.d, boom.limits, boom.max_velocity) == (0.3, (0.0, 0.5), 1.0)
    assert (boom.theta, boom.alpha) == pytest.approx((math.pi, math.pi / 2))
    assert robot.digest == hashlib.sha256(GOOD.encode()).hexdigest()


def test_a_short_file_of_radians(recipe) -> None:
    """Angles are as they stand; a key whose lines are all commented out reads as if it were absent."""
    joint = "{type: revolute, alpha: -1.5707963, a: 0, d: 0, theta: 2.3561945}"
    robot = recipe(f"name: x\ngravity: [0, 0, -9.8]\njoints:\n  - {joint}\nlog:\neffects:\nunits:\n")
    assert (robot.joint(1).alpha, robot.joint(1).theta) == pytest.approx((-math.pi / 2, 0.75 * math.pi))
    assert robot.log.position == "q{joint}"
    assert robot.effects == ()


def test_units_and_columns_of_logs(recipe) -> None:
    """Velocity follows position if not given; {joint} counts from 1, {joint0} from 0, {name} is the joint's."""
    units = recipe(GOOD).log.units
    assert (units["position"], units["velocity"]) == ("deg", "deg/s")
    assert (units["prismatic_position"], units.get("current"), units["time"]) == ("m", None, "s")
    text = GOOD.replace('"p{joint0}"', '"p_{name}"\n  velocity: "v{joint0}"\n  current: "i{joint:02d}"')
    log = recipe(text).log
    assert [log.column(quantity, 2) for quantity in ("position", "velocity", "current")] == ["p_boom", "v1", "i02"]
    assert "t twice" in faults_of(recipe, GOOD.replace("log:\n", "log:\n  time: [t, t]\n"))[0].what


def test_effects_are_kept_with_their_joint_as_a_number(recipe) -> None:
    """A joint's name becomes its number, and no joint means all."""
    choices = recipe(GOOD).effects
    assert [(choice.effect, choice.joint) for choice in choices] == [
        ("stribeck", 3),
        ("cogging", 1),
        ("load_friction", None),
    ]
    assert choices[0].shape == {"velocity": 0.1}


@pytest.mark.parametrize(
    "content",
    [GOOD.encode("utf-16"), b"\xef\xbb\xbf" + GOOD.encode(), GOOD.replace("\n", "\r\n").encode()],
    ids=["utf-16", "byte-order mark", "windows line ends"],
)
def test_other_peoples_editors(recipe, content: bytes) -> None:
    """UTF-16, a byte-order mark and Windows line ends read like plain text."""
    assert recipe(content).joints == recipe(GOOD).joints


def test_every_fault_is_told_with_its_line(recipe) -> None:
    """Six faults of one file come together, in the file's order, each with line, joint and path; a slip as one."""
    assert [fault.slug for fault in faults_of(recipe, GOOD.replace("gravity:", "gravty:"))] == ["recipe-wrong"]
    text = (
        GOOD.replace("name: arm", "name: 7")
        .replace("-9.80665", "0")
        .replace("revolute, alpha: 0", "revolut, alpha: 0")
        .replace("theta: 180", "tetha: 180")
        .replace("theta: 45", "theta: .nan")
        .replace("[1, -1, 1]", "[1, -1]")
    )
    told = {fault.where.field: fault.where.line for fault in faults_of(recipe, text)}
    assert [*told.values()] == [1, 3, 5, 6, 7, 11]
    assert " ".join(told) == "name gravity joints[1].type joints[2].tetha joints[3].theta log.signs.current"


@pytest.mark.parametrize(
    ("wrong", "mend"),
    [
        (("limits: [-160", "limit: [-160"), "did you mean limits?"),
        (("type: prismatic", "type: prismatc"), "did you mean prismatic?"),
        (("{position: deg}", "{position: degs}"), "did you mean deg?"),
        (("{position: deg}", "{current: Amp}"), "A"),
        (("{position: deg}", "{position: m}"), "prismatic_position"),
        (("joint: hand", "joint: hnad"), "did you mean hand?"),
        (("joint: 1", "joint: 4"), "from 1 to 3"),
        (("joint: 1", "jiont: 1"), "did you mean joint?"),
        (("alpha: 90,", ""), "alpha"),
        (("d: 0.1, ", ""), "d: 0"),
        (("theta: 180, ", ""), "theta: 0"),
        (("[-160, 160]", "[160, -160]"), "lower one first"),
        (("max_velocity: 100", "max_velocity: 0"), ""),
        (("max_velocity: 100", "gear_ratio: 0"), "motor turns"),
        (("max_velocity: 100", "max_velocity: 1e9"), "above 0"),
        (("[-160, 160]", "[-160, 1e9]"), "without end"),
        (("a: 0.2", "a: 200"), "by 1000"),
        (("a: 0.2", 'a: "0,2"'), "by 1000"),
        (("a: 0.2", "a: 0,2"), "alpha"),
        (("a: 0.2", "a: .inf"), ""),
        (("-9.80665", "-1"), "-9.80665"),
        (("name: boom", "name: waist"), "own name"),
        (("max_velocity: 1", "max_velocity: -1"), "a number greater than 0"),
        (("name: hand", "name: '3'"), "word"),
        (("alpha: -90", "alpha: -1.5708"), "{angle: deg}"),
        (("units: {angle: deg}\n", ""), "{angle: deg}"),
        (('"p{joint0}"', '"p"'), "{joint}"),
        (('"p{joint0}"', '"p{jont}"'), "{joint}"),
        (('"p{joint0}"', '"p{joint.real}"'), "{joint}"),
        (('"p{joint0}"', '"qd{joint}"'), "own columns"),
        (("[1, -1, 1]", "[1, -1, 2]"), "1 or -1"),
        (("source: a test", "kind: plan"), "recipe"),
        (("source: a test", "name: again"), "each key once"),
    ],
    ids=lambda value: value if isinstance(value, str) else "->".join(value).strip(),
)
def test_a_single_fault_has_its_mend(recipe, wrong: tuple[str, str], mend: str) -> None:
    assert wrong[0] in GOOD
    text = GOOD.replace(*wrong, 1)
    assert any(mend in fault.mend for fault in faults_of(recipe, text))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "keys and values"),
        (b"# only a remark\n", "keys and values"),
        (b"- 1\n- 2\n", "keys and values"),
        (b"name: \xe9\n", "UTF-8"),
        (b"\x89PNG\r\n\x1a\n", "UTF-8"),
        (b"name: a\0b\n", "not YAML"),
        (b"name: [1, 2\n", "not YAML"),
        (b"name: x\n\tjoints: 3\n", "not YAML"),
        (b"name: x\n---\nname: y\n", "another document"),
        (b'name: !!python/object/apply:os.system ["echo"]\n', "tag"),
        (b"name: !degrees 3\n", "tag"),
        (b"name: *missing\n", "undefined alias"),
        (b"a: &a [*a]\n", "there is no key a"),
        (b"a: " + b"[" * 1000, "deep"),
        (b"a: " + b"9" * 6000, "number"),
        (b"#" * 300_000, "bytes"),
        (b"? [1, 2]\n: 3\n", "the key name is missing"),
        ("\n".join(LAUGHS).encode(), "there is no key a0"),
    ],
)
def test_what_is_no_recipe_at_all_is_refused(recipe, content: bytes, said: str) -> None:
    """Empty, binary, broken, tagged, bottomless and huge files are refused in a sentence."""
    assert any(said in fault.what for fault in faults_of(recipe, content))


@pytest.mark.parametrize("name", sorted(shipped_recipes()))
def test_shipped_recipes_are_good_and_cite_their_source(name: str) -> None:
    """Every recipe that comes with pumaid reads, names its robot and says where its numbers are from."""
    path = shipped_recipes()[name]
    assert read_recipe(path).n_joints >= 2
    assert "\nsource:" in path.read_text(encoding="utf-8")


def test_puma_is_the_papers() -> None:
    """The PUMA's twists, lengths and offsets are those of the paper's table."""
    robot = read_recipe(shipped_recipes()["puma560"])
    assert np.rad2deg([joint.alpha for joint in robot.joints]) == pytest.approx([0, -90, 0, 90, -90, 90])
    assert [joint.a for joint in robot.joints] == pytest.approx([0, 0, 0.4318, -0.0203, 0, 0])
    assert [joint.d for joint in robot.joints] == pytest.approx([0, 0.2435, -0.0934, 0.4331, 0, 0])
    assert [joint.theta for joint in robot.joints] == [0.0] * 6


DOCUMENT = (Path(__file__).parents[2] / "docs" / "recipes.md").read_text(encoding="utf-8")


def test_the_documents_example_is_a_recipe(recipe) -> None:
    assert recipe(DOCUMENT.split("```yaml\n")[1].split("```")[0]).n_joints == 3


BOX = "{name: table, min: [-1, -1, -1], max: [1, 1, -0.02]}"
ROD = "{link: 3, start: [0, 0, 0], end: [0.2, 0, 0], radius: 0.08}"
JOINT = "  - {type: revolute, theta: 0, alpha: 0, a: 0, d: 0}\n"
GEARED = "  - {type: revolute, theta: 0, alpha: 0, a: 0, d: 0, gear_ratio: 50}\n"
SIX = "name: six\ngravity: [0, 0, -9.8]\njoints:\n"
#: A recipe up to the line of a block.
HEADS = {
    "safety": shipped_recipes()["puma560"].read_text(encoding="utf-8").split("safety:")[0] + "safety:\n  ",
    "coupling": f"{SIX}{GEARED * 6}coupling: ",
}


@pytest.mark.parametrize(
    ("kind", "block", "words"),
    [
        ("safety", "boxs: []", "did you mean boxes?"),
        ("safety", "boxes: [{min: [0, 0, 0]}]", "add max: [x, y, z]"),
        ("safety", "boxes: [{min: [0, 0, 1], max: [1, 1, 0]}]", "the box has no inside"),
        ("safety", "boxes: [{min: [0, 0], max: [1, 1, 1]}]", "min has too few values"),
        ("safety", "boxes: [{min: [0, 0, .nan], max: [1, 1, 1]}]", "finite number"),
        ("safety", "boxes: [{min: [0, 0, 0], max: [1000, 1, 1]}]", "m, not mm"),
        ("safety", "boxes: 3", "write [{name: table"),
        ("safety", "capsules: [{link: 7, start: [0, 0, 0], end: [0, 0, 0], radius: 1}]", "there is no link 7"),
        ("safety", "capsules: [{link: -1, start: [0, 0, 0], end: [0, 0, 0], radius: 1}]", "from 0 (the base) to 6"),
        ("safety", "capsules: [{link: 1.5, start: [0, 0, 0], end: [0, 0, 0], radius: 1}]", "integer"),
        ("safety", "capsules: [{link: 1, start: [0, 0, 0], end: [0, 0, 0], radius: -1}]", "greater than 0"),
        ("safety", "capsules: [{link: 1, start: [0, 0, 0], end: [0, 0, 0], radius: 80}]", "by 1000"),
        ("safety", "capsules: [{link: 1, strat: [0, 0, 0], end: [0, 0, 0], radius: 1}]", "did you mean start?"),
        ("safety", "margin: -0.1", "greater than or equal to 0"),
        ("safety", "tool: [0, 0]", "tool has too few values"),
        ("safety", "ignore: [[1, 9]]", "there is no link 9"),
        ("coupling", "{r45: 0.1}", "one nearer to the base"),
        ("coupling", "{r55: 0.1}", "one nearer to the base"),
        ("coupling", "{r74: 0.1}", "r74 does not name two of the 6 joints"),
        ("coupling", "{wrist: 0.1}", "does not name two of the 6 joints"),
        ("coupling", "{r1210: 0.1}", "does not name two of the 6 joints"),
        ("coupling", "{r54: 0.1, r5_4: 0.1}", "does not name two of the 6 joints"),
        ("coupling", "{r54: fast}", "should be a valid number"),
    ],
)
def test_a_wrong_block_is_told_with_its_line(recipe, kind: str, block: str, words: str) -> None:
    """What is forbidden and what gears couple: each fault has its line and what would mend it."""
    text = HEADS[kind] + block
    (fault,) = faults_of(recipe, text)
    assert (fault.slug, fault.where.line) == ("recipe-wrong", len(text.splitlines())) and words in str(fault)


def safety(recipe, block: str) -> Safety | None:
    """What becomes of a block `safety`."""
    return recipe(HEADS["safety"] + "\n  ".join(block.splitlines())).safety


def test_safety_is_read(recipe) -> None:
    """Boxes, capsules, tool, margin and ignored links become the record, in m though the file's angles are degrees."""
    # An empty block means nothing; a box without a name is told by its number; 20 mm are left.
    found = safety(recipe, f"tool: [0, 0, 0.1]\nboxes: [{BOX}]\ncapsules: [{ROD}]\nmargin: 0.05\nignore: [[6, 4]]")
    table, rod = Box("table", (-1, -1, -1), (1, 1, -0.02)), Capsule(3, (0, 0, 0), (0.2, 0, 0), 0.08)
    assert found == Safety((table,), (0, 0, 0.1), 0.05, ((4, 6),), capsules=(rod,))
    assert safety(recipe, "") is None
    found = safety(recipe, "boxes: [{min: [0, 0, 0], max: [1, 1, 1]}]\ncapsules:")
    assert found == Safety((Box("box 1", (0, 0, 0), (1, 1, 1)),), margin=0.02)


def test_faults_of_several_blocks_come_together(recipe) -> None:
    """In the order of the lines; joints that take part in a coupling need their gear ratios."""
    block = "margin: 2\n  boxes: [{min: [1, 0, 0]}]\n  capsules: [{link: 9, start: 3}]"
    first = len(HEADS["safety"].splitlines())
    assert [fault.where.line - first for fault in faults_of(recipe, HEADS["safety"] + block)] == [0, 1, 2, 2, 2, 2]
    found = faults_of(recipe, f"{SIX}{GEARED * 4}{JOINT * 2}coupling: {{r65: 0.1}}\n")
    told = [(fault.where.field, fault.where.line) for fault in found]
    assert told == [("joints[5].gear_ratio", 8), ("joints[6].gear_ratio", 9)]


def test_the_remarks_of_a_new_recipe_are_a_block(recipe) -> None:
    """What `pumaid init` writes as remarks on safety is a block that is read, once its marks are taken away."""
    text = blank(3)
    block = text[text.index("# safety:") :].replace("# ", "", 1).replace("\n# ", "\n").replace("    # ", " # ")
    found = recipe(text + block).safety
    assert (len(found.boxes), len(found.capsules), found.tool) == (1, 1, (0, 0, 0.1))
    assert found.floor == 0.0 and found.links == ((0, 0.06), (1, 0.06))


def test_a_recipe_states_the_coupling(recipe) -> None:
    """Names of one digit run together, longer ones are parted by a bar."""
    robot = recipe(f"{SIX}{GEARED * 12}coupling: {{r54: 0.0139, r65: -0.18, r12_9: 0.5}}\n")
    assert robot.coupling == {(5, 4): 0.0139, (6, 5): -0.18, (12, 9): 0.5}
    assert recipe(HEADS["coupling"] + "\n").coupling == {}


@pytest.fixture
def arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An experiment's folder with a log, the working folder elsewhere."""
    (tmp_path / "my_arm" / "logs").mkdir(parents=True)
    (tmp_path / "my_arm" / "logs" / "run.csv").write_text("t,q1,i1\n")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    return tmp_path / "my_arm"


def put(folder: Path, text: str = "name: x\n") -> Path:
    path = folder / "recipe.yaml"
    path.write_text(text)
    return path


def test_order_of_places(arm: Path) -> None:
    """The working folder, overruled by beside the logs, overruled by the logs' folder, overruled by what is named."""
    logs, named = [arm / "logs" / "run.csv"], arm / "other.yaml"
    named.write_text("name: y\n")
    here = put(Path())
    assert find_recipe(None, logs) == here
    beside = put(arm)
    assert find_recipe(None, logs).resolve() == beside
    inside = put(arm / "logs")
    assert find_recipe(None, logs) == inside
    assert find_recipe(named, logs) == named


@pytest.mark.parametrize("given", ["logs", "logs/run.csv", "logs/*.csv", "logs/**/*.csv", "lo*/run.csv"])
def test_folders_files_and_globs_lead_to_the_same_recipe(arm: Path, given: str) -> None:
    """A folder, a file in it or a glob over it find the recipe beside the folder."""
    beside = put(arm)
    assert find_recipe(None, [arm / given]).resolve() == beside


def test_a_miss_lists_the_places(arm: Path) -> None:
    """The message of a miss names every path that was tried, and a recipe under another name nearby."""
    (arm / "recipe.yml").write_text("name: x\n")
    with pytest.raises(RecipeError) as caught:
        find_recipe(None, [arm / "logs"])
    for place in (arm / "logs" / "recipe.yaml", arm / "recipe.yaml"):
        assert str(place) in caught.value.what
    assert "recipe.yml" in caught.value.mend


def test_two_robots_at_once_are_refused(arm: Path) -> None:
    """Logs whose folders hold different recipes are not mixed; equal copies are fine."""
    second = arm / "logs2"
    second.mkdir()
    first = put(arm / "logs")
    put(second)
    assert find_recipe(None, [arm / "logs", second]) == first
    put(second, "name: y\n")
    with pytest.raises(RecipeError, match="different recipes"):
        find_recipe(None, [arm / "logs", second])


def test_a_shipped_recipe_goes_by_its_name(arm: Path) -> None:
    """``--recipe puma560`` is the shipped one, unless a file of that name stands here; a slip gets the nearest."""
    assert find_recipe(Path("puma560"), []) == shipped_recipes()["puma560"]
    Path("puma560").write_text("name: mine\n")
    assert find_recipe(Path("puma560"), []) == Path("puma560")
    with pytest.raises(RecipeError) as caught:
        find_recipe(Path("puma650"), [])
    assert "puma560" in caught.value.mend
