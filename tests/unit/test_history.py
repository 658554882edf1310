"""Kept models: nothing is lost, nothing is kept twice, every model knows what it was made from."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from ladders import ARM, RIPPLE, STRIBECK, model

from pumaid.errors import ResultError
from pumaid.results.documents import read_model, write_model
from pumaid.results.history import keep, read_history
from pumaid.robot import EffectChoice

ROTTEN = {"notes.txt": "mine", "009-broken.json": "{", "010-other.json": '{"kind": "comparison"}', "best.json": "{}"}


@pytest.fixture
def path(tmp_path) -> Path:
    """The current model's file."""
    return tmp_path / "results" / "model.json"


def names(path: Path) -> list[str]:
    """What the archive beside a model holds."""
    return sorted(kept.name for kept in (path.parent / "models").iterdir())


def parents(path: Path) -> dict[int, int | None]:
    """Number -> number of the model that it was made from, over all ladders."""
    return {rung.number: rung.parent for ladder in read_history(path.parent).ladders for rung in ladder.rungs}


def test_every_model_is_kept_once_under_its_number_and_effects(path):
    """The current model is the last, each stays readable, and fitting anew what was fitted before adds no file."""
    keep(path, model())
    keep(path, model(STRIBECK, RIPPLE, replace(STRIBECK, joint=2), rmse=0.01))
    assert names(path) == ["001-base.json", "002-stribeck@1,2+ripple@2.json"]
    assert read_model(path).effects == read_model(path.parent / "models" / names(path)[1]).effects
    assert read_model(path.parent / "models" / names(path)[0]).effects == ()
    assert keep(path, model()).name == "001-base.json"
    assert len(names(path)) == 2 and read_history(path.parent).current == 1


@pytest.mark.parametrize(
    ("effects", "expected"),
    [
        ([(), (STRIBECK,), (STRIBECK, RIPPLE), (RIPPLE,)], (3, (), (STRIBECK,))),  # a removal
        ([(), (STRIBECK,), (STRIBECK, RIPPLE)], (2, (RIPPLE,), ())),
        ([(), (STRIBECK,), (RIPPLE,)], (1, (RIPPLE,), ())),  # it lacks an effect of the one before
        ([(), (STRIBECK,), ()], (1, (), ())),  # the base fitted again
    ],
)
def test_what_a_model_is_made_from(path, effects, expected):
    """From the earlier model with the fewest effects more or less, of several the latest."""
    for number, chosen in enumerate(effects):
        keep(path, model(*chosen, rmse=0.03 - 0.001 * number))
    last = read_history(path.parent).ladders[0].rungs[-1]
    assert (last.parent, last.added, last.removed) == expected


def test_undo_brings_the_earlier_file_back(path):
    """A kept model that is copied back is the current one, and the later one is still kept."""
    keep(path, model())
    keep(path, model(STRIBECK, rmse=0.02))
    shutil.copy(path.parent / "models" / "001-base.json", path)
    assert read_history(path.parent).current == 1 and len(names(path)) == 2
    keep(path, model(RIPPLE, rmse=0.02))
    assert parents(path)[3] == 1  # what is fitted next was made from the model that was brought back


def test_a_model_from_before_the_archive_is_kept_too(path):
    """The next model does not destroy a current model that was in no archive."""
    write_model(path, model())
    keep(path, model(STRIBECK, rmse=0.02))
    assert names(path) == ["001-base.json", "002-stribeck@1.json"] and parents(path)[2] == 1


def test_models_that_are_not_there_are_refused(path):
    """Without an archive the message names the command that makes one."""
    with pytest.raises(ResultError, match="pumaid identify") as refused:
        read_history(path.parent)
    assert refused.value.slug == "no-history"


def test_whole_arm_weighs_samples(path):
    """Squares of 0.03 A over 300 and 0.06 A over 100 samples: the root of 0.001575 A2; no joint has held-out runs."""
    keep(path, model())
    whole = read_history(path.parent).ladders[0].rungs[0].whole
    assert whole["rmse"] == pytest.approx(0.001575**0.5)
    assert (whole["heldout"], whole["noise_floor"]) == (None, pytest.approx(0.01))


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"geometry": replace(ARM, gravity=(0.0, 0.0, 9.8)).geometry}, "another recipe"),
        ({"logs": {"a.csv": "cd" * 32, "b.csv": "ef" * 32}}, "fitted to other logs"),
        ({"samples": 210}, "other runs"),
    ],
)
def test_what_cannot_be_compared_stands_apart(path, changes, why):
    """Models of another arm, other logs or other runs of them are a ladder of their own, which says why."""
    keep(path, model())
    keep(path, model(STRIBECK, rmse=0.02, **changes))
    own, other = read_history(path.parent).ladders
    assert [rung.number for rung in own.rungs] == [2] and own.rungs[0].parent is None
    assert own.apart == "" and why in other.apart


def test_effects_in_the_recipe_do_not_part_the_ladder(path):
    keep(path, model())
    geometry = replace(ARM, effects=(STRIBECK,), digest="bb" * 32).geometry
    keep(path, model(STRIBECK, rmse=0.02, recipe_digest="bb" * 32, geometry=geometry))
    assert len(read_history(path.parent).ladders) == 1 and parents(path) == {1: None, 2: 1}


def test_foreign_broken_and_changed_files_are_told(path):
    """Each is named with what is wrong with it; the rest is used, and the next number stays clear of them."""
    keep(path, model())
    for name, text in ROTTEN.items():
        (path.parent / "models" / name).write_text(text, encoding="utf-8")
    history = read_history(path.parent)
    assert sorted(Path(note.where.file).name for note in history.notes) == sorted(ROTTEN)
    assert {note.slug for note in history.notes} == {"model-not-kept"}
    archived = keep(path, model(STRIBECK, rmse=0.02))
    assert archived.name.startswith("011")
    archived.write_text(archived.read_text().replace('"rmse": 0.02,', '"rmse": 0.0002,'), encoding="utf-8")
    history = read_history(path.parent)
    assert [note.slug for note in history.notes[-2:]] == ["model-not-kept", "model-not-kept"]
    assert "was changed" in history.notes[-2].text and len(history.ladders[0].rungs) == 1


def test_a_lost_parent_leaves_a_ladder(path):
    """Where the model before was deleted, what follows stands as a first one with all that is in it."""
    first = keep(path, model())
    keep(path, model(STRIBECK, rmse=0.02))
    first.unlink()
    (rung,) = read_history(path.parent).ladders[0].rungs
    assert (rung.parent, rung.added, rung.is_current) == (None, (STRIBECK,), True)


@pytest.mark.parametrize(("text", "why"), [(None, "missing"), ("{", "damaged")])
def test_a_current_model_that_is_gone_is_told(path, text, why):
    keep(path, model())
    path.unlink() if text is None else path.write_text(text, encoding="utf-8")
    history = read_history(path.parent)
    assert history.current is None and why in history.notes[0].text
    assert [rung.number for rung in history.ladders[0].path] == [1]


def test_a_long_list_of_effects_is_counted_in_the_name(path):
    many = [EffectChoice(f"effect_of_a_long_name_{k}", 1) for k in range(40)]
    assert keep(path, model(*many)).name == "001-40-effects.json"
