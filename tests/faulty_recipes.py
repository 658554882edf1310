"""Mutations of a good recipe: slips of the pen, wrong units, and YAML that means harm, by class."""

from collections.abc import Callable, Iterator
from pathlib import Path

from faulty import RECIPE, Fault

#: A joint of the recipe, to be changed.
KNEE = "- {name: knee, type: revolute, theta: 0,   alpha: 0,  a: 0.3, d: 0.0, limits: [-170, 170], max_velocity: 180}"
GRAVITY = "gravity: [0.0, 0.0, -9.80665]"


def recipe(content: str | bytes) -> Callable[[Path], None]:
    """Another content of recipe.yaml."""
    data = content.encode() if isinstance(content, str) else content
    return lambda folder: (folder / "recipe.yaml").write_bytes(data) and None


def with_line(line: str, *, top: bool = False) -> Callable[[Path], None]:
    """The recipe with one line more."""
    return recipe(f"{line}\n{RECIPE}" if top else f"{RECIPE}{line}\n")


def edited(old: str, new: str) -> Callable[[Path], None]:
    """The recipe with something in place of something that is there."""
    assert old in RECIPE
    return recipe(RECIPE.replace(old, new))


def knee(**entries: str) -> Callable[[Path], None]:
    """The recipe with other values at joint 2; an empty one takes the key away."""
    text = KNEE
    for key, value in entries.items():
        parts = [part.strip() for part in text[3:-1].replace("[-170, 170]", "[-170 170]").split(",")]
        parts = [f"{key}: {value}" if part.startswith(f"{key}:") else part for part in parts]
        parts = [part for part in parts if value or not part.startswith(f"{key}:")]
        text = "- {" + ", ".join(parts).replace("[-170 170]", "[-170, 170]") + "}"
    return edited(KNEE, text)


def yaml_faults() -> Iterator[Fault]:
    """Text that is no recipe, or no YAML, or YAML that could harm."""
    laughs = "\n".join(f"l{k}: &l{k} [{', '.join([f'*l{k - 1}'] * 10)}]" for k in range(1, 10))
    for name, line in {
        "lists 1000 deep": "deep: " + "[" * 1_000,
        "maps 30 deep": "deep: " + "{a: " * 30 + "1" + "}" * 30,
        "blocks 200 deep": "deep:\n" + "\n".join("  " * k + f"k{k}:" for k in range(1, 200)),
    }.items():
        yield Fault("deep YAML", name, with_line(line))
    yield Fault("YAML bombs", "a billion laughs", with_line(f"l0: &l0 lol\n{laughs}", top=True))
    yield Fault("YAML bombs", "an alias of itself", with_line("me: &me [*me]"))
    yield Fault("YAML bombs", "an alias of nothing", with_line("me: *nobody"))
    yield Fault("YAML bombs", "1000 anchors", with_line("\n".join(f"k{k}: &a{k} 1" for k in range(1000))))
    yield Fault("YAML bombs", "merge keys", edited(KNEE, "- {<<: {name: knee}, type: revolute, alpha: 0}"))
    yield Fault("YAML bombs", "three megabytes", with_line("# " + "x" * 3_000_000))
    yield Fault("YAML bombs", "a key of 100 kB", with_line("k" * 100_000 + ": 1"))
    for tag in ("!!python/object/apply:os.system ['true']", "!!binary aGk=", "!mine 3", "!!float '1'"):
        yield Fault("YAML tags", tag.split()[0], with_line(f"log: {tag}"))
    yield Fault(
        "YAML tags", "on the name", edited("name: two-link pendulum", "name: !!python/object:os.stat_result {}")
    )
    yield Fault("YAML tags", "a directive", recipe("%YAML 1.1\n%TAG ! tag:evil,2000:\n---\n" + RECIPE))
    yield Fault("duplicate keys", "name", with_line("name: other"))
    yield Fault("duplicate keys", "joints", with_line("joints: []"))
    yield Fault("duplicate keys", "in a joint", edited("{name: knee,", "{name: knee, a: 0.4,"))
    yield Fault("duplicate keys", "two joints of one name", knee(name="hip"))
    yield Fault("duplicate keys", "two documents", with_line("---\nname: other"))
    for name, content in {
        "a log": b"t,q1,q2\n0,1,2\n",
        "JSON of a model": b'{"kind": "model", "format": 1}',
        "control letters": RECIPE.encode().replace(b"knee", b"kn\x07ee"),
        "a surrogate": RECIPE.encode().replace(b"knee", b"\xed\xa0\x80"),
        "cut in the middle": RECIPE.encode()[: len(RECIPE) * 2 // 3],
        "tabs": RECIPE.replace("  - {", "\t- {").encode(),
    }.items():
        yield Fault("recipe is none", name, recipe(content))


def value_faults() -> Iterator[Fault]:
    """Keys and values that cannot be meant."""
    for word in ("name", "type", "alpha", "a", "limits"):
        yield Fault("recipe keys", f"{word} missing at a joint", knee(**{word: ""}))
        yield Fault("recipe keys", f"{word} misspelt at a joint", edited(f"{word}: ", f"{word}s: "))
    for word in ("name: two-link pendulum", GRAVITY, "units: {angle: deg}", "joints:"):
        key = word.split(":")[0]
        yield Fault("recipe keys", f"{key} misspelt", edited(word, word.replace(key, key[:-1] + "x")))
    yield Fault("recipe keys", "joints missing", recipe(RECIPE.split("joints:")[0]))
    for key, values in {
        "alpha": (".nan", ".inf", "'ninety'", "null", "[0]", "1e999", "1" + "0" * 400, "1:30", "2020-01-01", "yes"),
        "a": ("300", "-.inf", "0,3", "{}"),
        "type": ("rotary", "7", "prismatic", "Revolute", "''"),
        "limits": ("[170, -170]", "[0, 0]", "[1]", "[.nan, 1]", "170", "[-1e9, 1e9]"),
        "max_velocity": ("0", "-5", "1e12", "fast"),
    }.items():
        for value in values:
            yield Fault("recipe values", f"{key}: {value[:20]}", knee(**{key: value}))
    for value in ("[0, 0, 0]", "[0, 0]", "9.81", "[0, 0, -981]", "[.nan, 0, -9.8]", "[0, 0, -9.8e300]", "down"):
        yield Fault("recipe values", f"gravity: {value}", edited(GRAVITY, f"gravity: {value}"))
    yield Fault("degrees for radians", "a recipe in degrees without its unit", edited("units: {angle: deg}\n", ""))
    yield Fault("degrees for radians", "limits in radians", knee(limits="[-2.97, 2.97]"))
    yield Fault("degrees for radians", "an unknown unit", edited("angle: deg", "angle: gon"))
    yield Fault("wrong joint count", "a recipe of one joint", recipe(RECIPE.replace(f"  {KNEE}\n", "")))
    yield Fault("wrong joint count", "a recipe of three", with_line(f"  {KNEE.replace('knee', 'ankle')}"))
    yield Fault(
        "wrong joint count",
        "a recipe of 500",
        with_line("\n".join(f"  {KNEE.replace('knee', f'k{k}')}" for k in range(498))),
    )
    yield Fault(
        "wrong joint count", "a recipe of none", edited("joints:\n" + RECIPE.split("joints:\n")[1], "joints: []\n")
    )
    yield Fault("other robot's log", "the axis of joint 1 upright in the recipe", edited("alpha: 90,", "alpha: 0, "))


def log_faults() -> Iterator[Fault]:
    """The block that says how logs are written."""
    for name, block in {
        "a column that is not there": "{current: 'amps{joint}'}",
        "one column for two quantities": "{current: 'q{joint}'}",
        "one column for two joints": "{current: i1}",
        "a hole for nothing": "{current: 'i{axis}'}",
        "code in a hole": "{current: 'i{joint.__class__.__mro__}'}",
        "a hole that is not closed": "{current: 'i{joint'}",
        "an unknown unit": "{units: {current: hp}}",
        "a unit of something else": "{units: {current: m}}",
        "degrees where radians are": "{units: {position: deg, velocity: deg/s}}",
        "milliamperes where amperes are": "{units: {current: mA}}",
        "milliseconds where seconds are": "{units: {time: ms}}",
        "a sign of zero": "{signs: {current: [0, 1]}}",
        "signs of three joints": "{signs: {current: [1, 1, 1]}}",
        "position signs turned at joint 2": "{signs: {position: [1, -1]}}",
        "no position": "{position: null}",
        "time as current": "{current: t}",
        "a list": "[1, 2]",
    }.items():
        yield Fault("recipe's log block", name, with_line(f"log: {block}"))
    for name, entry in {
        "that is unknown": "{effect: warp}",
        "at no joint": "{effect: stribeck, joint: 9}",
        "of a file": "{effect: ../../etc/passwd}",
        "with a wrong shape": "{effect: stribeck, joint: 1, shape: {velocity: -1}}",
        "twice": "{effect: stribeck, joint: 1}, {effect: stribeck, joint: 1}",
        "that is a number": "7",
    }.items():
        yield Fault("recipe's effects", name, with_line(f"effects: [{entry}]"))


def all_recipes() -> list[Fault]:
    """Every mutation of the recipe."""
    return [*yaml_faults(), *value_faults(), *log_faults()]
