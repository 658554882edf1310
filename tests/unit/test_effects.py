"""What every effect owes the rest of the program, over the whole catalogue."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from worlds import CRANE, PENDULUM, STANFORD

import pumaid.effects
from pumaid.effects import Effect, Scope, catalogue
from pumaid.robot import Joint, Robot
from pumaid.samples import Extent, Loads, Samples

NAMES = sorted(catalogue())
#: What units are made of; powers follow their letter.
WORD = re.compile(r"(A|s|m|N|kg|rad|degC|\{unit\}|1)\d?")
JOINTS = range(1, STANFORD.n_joints + 1)


def samples(joint: int, *, seed: int = 0, count: int = 60) -> Samples:
    """Instants of an arm in all its postures, every field filled."""
    rng = np.random.default_rng(seed)
    n = STANFORD.n_joints
    position = rng.uniform(-2.0, 2.0, (count, n))
    velocity = np.zeros_like(position)
    velocity[:, joint - 1] = rng.uniform(0.1, 1.0, count) * rng.choice([-1.0, 1.0], count)
    own, across, drawn = rng.normal(size=(3, count))
    others, slopes = rng.normal(size=(2, count, n))
    others[:, 4], gains = np.nan, rng.uniform(0.5, 2.0, n)
    return Samples(
        joint,
        position,
        velocity,
        acceleration=rng.uniform(-1.0, 1.0, count),
        direction=np.sign(velocity[:, joint - 1]),
        time=np.sort(rng.uniform(0.0, 900.0, count)),
        elapsed=np.sort(rng.uniform(0.0, 900.0, count)),
        travel=rng.uniform(0.0, 3.0, count),
        temperature=rng.uniform(20.0, 45.0, count),
        run=np.repeat(np.arange(count // 10), 10),
        loads=Loads(own, others, slopes, rng.normal(size=(count, 2)), np.abs(across), 3.0 * drawn, gains),
    )


def extent(joint: int | None, *, scale: float = 1.0) -> Extent:
    """What a campaign of 60 runs at four speeds covers."""
    starts = tuple(20.0 * k for k in range(60))
    speeds = tuple(scale * v for v in (0.1, 0.25, 0.5, 1.0))
    return Extent(joint, speeds, (-1.2 * scale, 1.3 * scale), 0.04 * scale, 2.5 * scale, starts, 1200.0, 4.0, 4)


def owners(effect: Effect) -> list[int]:
    """Joints (or 0: the whole arm) that can own the effect."""
    numbers = [0] if effect.scope is Scope.ARM else JOINTS
    return [number for number in numbers if effect.applies(STANFORD, number) is None]


def example_shape(effect: Effect, number: int) -> dict[str, float]:
    """The examples of an effect's shapes."""
    return {shape.name: shape.example for shape in effect.shapes(STANFORD, number)}


def acting(name: str) -> list[tuple[int, Samples, np.ndarray]]:
    """(owner, samples, columns) of an effect wherever it can act, at the examples of its shapes."""
    effect, found = catalogue()[name], []
    for number in owners(effect):
        everywhere = effect.scope in (Scope.ARM, Scope.CAUSE)
        for joint in JOINTS if everywhere else [number]:
            seen = samples(joint, seed=joint)
            shape = example_shape(effect, number)
            found.append((number, seen, effect.columns(STANFORD, seen, number=number, shape=shape)))
    return found


@pytest.mark.parametrize("name", NAMES)
def test_states_what_people_read(name):
    """An effect is called as its file, with a source that has a year or a section, known units and real look-alikes."""
    effect = catalogue()[name]
    assert effect.name == name and (Path(pumaid.effects.__file__).parent / f"{name}.py").is_file()
    assert effect.title and effect.equation and effect.family and effect.trace
    assert re.search(r"\d", effect.source) and len(effect.source) > 20
    assert not any(other == name or catalogue()[other].base for other in effect.look_alikes)
    for number in owners(effect):
        parameters, shapes = effect.parameters(STANFORD, number), effect.shapes(STANFORD, number)
        assert parameters and all(entry.meaning for entry in (*parameters, *shapes))
        for entry in (*parameters, *shapes):
            assert all(WORD.fullmatch(word) for word in re.split(r"[ /]", entry.unit) if word), entry.unit
        for entry in parameters:
            assert entry.symbol.format(n=number) and entry.example != 0.0 and entry.low < entry.example < entry.high
        for entry in shapes:
            assert np.isfinite([entry.low, entry.high]).all() and entry.low <= entry.example <= entry.high


@pytest.mark.parametrize("scale", [1e-2, 1.0, 30.0])
@pytest.mark.parametrize("name", NAMES)
def test_grid_starts_within_bounds(name, scale):
    """A search begins somewhere, with every shape named and within its bounds, for small motions and large ones."""
    effect = catalogue()[name]
    for number in owners(effect):
        shapes = {shape.name: shape for shape in effect.shapes(STANFORD, number)}
        starts = effect.grid(STANFORD, extent(number or None, scale=scale))
        assert starts
        for start in starts:
            assert set(start) == set(shapes)
            assert all(shapes[key].low <= value <= shapes[key].high for key, value in start.items()), start


def test_catalogue_cannot_be_changed():
    """The catalogue is what the folder holds, and no one's to edit."""
    with pytest.raises(TypeError):
        catalogue()["mine"] = catalogue()["gravity"]


@pytest.mark.parametrize("name", NAMES)
def test_example_is_recovered(name):
    """Currents made from an effect's own example give it back, where its columns can tell its parameters apart."""
    recovered = 0
    for number, _, columns in acting(name):
        example = np.array([parameter.example for parameter in catalogue()[name].parameters(STANFORD, number)])
        if np.linalg.matrix_rank(columns) == len(example):
            found = np.linalg.lstsq(columns, columns @ example, rcond=None)[0]
            assert found == pytest.approx(example, rel=1e-9)
            recovered += 1
    assert recovered > 0


def test_links_act_inward_only():
    """A link's effect acts on joints at or inside it; a slide's weight is nothing to another slide."""
    gravity, seen = catalogue()["gravity"], samples(3)
    assert gravity.columns(STANFORD, seen, number=3).any()
    assert not gravity.columns(STANFORD, seen, number=5).any()


def test_prismatic_load_on_a_turning_joint():
    """The mass beyond a slide presses the turning joint before it by its displacement, offset included."""
    # The crane's first axis is level; with both turning joints at 0 the slide points along its link.
    position = np.array([[0.3, 0.2, 0.0], [0.3, 0.5, 0.0]])
    columns = catalogue()["gravity"].columns(CRANE, Samples(1, position, np.zeros((2, 3))), number=2)
    assert columns[1, 0] / columns[0, 0] == pytest.approx((0.5 + 0.1) / (0.2 + 0.1))


#: A turning joint and a slide, both upright: the one feels no weight, the other always the same.
UPRIGHT = Robot("upright", (Joint(1, "turn", "revolute"), Joint(2, "slide", "prismatic")))


@pytest.mark.parametrize(
    ("name", "joint", "word"),
    [
        ("load_friction", 1, "gravity"),
        ("load_friction", 2, "Coulomb"),
        ("delay", 1, "gravity"),
        ("flexibility", 2, "slides"),
        ("counterbalance", 2, "Coulomb"),
        ("zero_offset", 1, "gravity"),
        ("zero_offset", 2, "lever"),
        ("coupling", 1, "before"),
    ],
)
def test_refuses_where_it_cannot_act(name, joint, word):
    """An effect says why it cannot act at a joint."""
    assert word in str(catalogue()[name].applies(UPRIGHT, joint))


@pytest.mark.parametrize("name", ["load_friction", "flexibility", "delay", "payload", "side_load_friction"])
def test_acts_where_gravity_does(name):
    """Effects of the load act on a joint whose axis is level."""
    assert catalogue()[name].applies(PENDULUM, 1) is None
