"""What every effect owes the rest of the program, over the whole catalogue."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from worlds import CRANE, STANFORD

import pumaid.effects
from pumaid.effects import Effect, Scope, Trace, catalogue
from pumaid.records import Samples

NAMES = sorted(catalogue())
#: What units are made of; powers follow their letter.
WORD = re.compile(r"(A|s|m|N|kg|rad|degC|\{unit\}|1)\d?")


def samples(joint: int, *, seed: int = 0, count: int = 60) -> Samples:
    """Instants of an arm in all its postures, every field filled."""
    rng = np.random.default_rng(seed)
    position = rng.uniform(-2.0, 2.0, (count, STANFORD.n_joints))
    velocity = np.zeros_like(position)
    velocity[:, joint - 1] = rng.uniform(0.1, 1.0, count) * rng.choice([-1.0, 1.0], count)
    return Samples(
        joint,
        position,
        velocity,
        acceleration=rng.uniform(-1.0, 1.0, count),
        direction=np.sign(velocity[:, joint - 1]),
        time=np.sort(rng.uniform(0.0, 900.0, count)),
        travel=rng.uniform(0.0, 3.0, count),
        temperature=rng.uniform(20.0, 45.0, count),
        run=np.repeat(np.arange(count // 10), 10),
    )


def acting() -> list[tuple[Effect, int]]:
    """Every effect at every joint where it applies."""
    return [(e, joint) for e in catalogue().values() for joint in range(1, 7) if e.applies(STANFORD, joint) is None]


@pytest.mark.parametrize("name", NAMES)
def test_name_is_the_files(name):
    """An effect is called as its file."""
    assert catalogue()[name].name == name
    assert (Path(pumaid.effects.__file__).parent / f"{name}.py").is_file()


@pytest.mark.parametrize("name", NAMES)
def test_states_what_people_read(name):
    """Title, source and trace are there, and of the right kinds."""
    effect = catalogue()[name]
    assert effect.title and len(effect.source) > 20 and isinstance(effect.scope, Scope)
    assert effect.trace and all(isinstance(trace, Trace) for trace in effect.trace)


@pytest.mark.parametrize("name", NAMES)
def test_parameters_are_well_told(name):
    """Names are words, units are known, meanings are told, examples are not zero."""
    for joint in (1, 3):
        for parameter in catalogue()[name].parameters(STANFORD, joint):
            assert re.fullmatch(r"[A-Za-z]\w*", parameter.name) and parameter.meaning
            assert all(WORD.fullmatch(word) for word in re.split(r"[ /]", parameter.unit) if word), parameter.unit
            assert parameter.symbol.format(n=joint) and np.isfinite(parameter.example) and parameter.example != 0.0


def test_catalogue_cannot_be_changed():
    """The catalogue is what the folder holds, and no one's to edit."""
    with pytest.raises(TypeError):
        catalogue()["mine"] = catalogue()["gravity"]


@pytest.mark.parametrize("name", NAMES)
def test_columns_have_the_parameters_shape(name):
    """One finite column a parameter, one row an instant."""
    for effect, joint in acting():
        if effect.name == name:
            columns = effect.columns(STANFORD, samples(joint))
            assert columns.shape == (60, len(effect.parameters(STANFORD, joint)))
            assert np.isfinite(columns).all()


@pytest.mark.parametrize("name", NAMES)
def test_example_is_recovered(name):
    """Currents made from an effect's own example give it back, where its columns can tell its parameters apart."""
    recovered = 0
    for effect, joint in acting():
        if effect.name != name:
            continue
        columns = effect.columns(STANFORD, samples(joint, seed=joint))
        example = np.array([parameter.example for parameter in effect.parameters(STANFORD, joint)])
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
