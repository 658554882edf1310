"""Model files under attack: whatever stands in one, reading it gives an estimate or a refusal of ours, nothing else."""

import json

import report_contexts
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pumaid.errors import PumaidError
from pumaid.estimate import Estimate
from pumaid.results.documents import as_text, model_document, read_model

ESTIMATE = report_contexts.small().estimate
SCALARS = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5)
JSON = st.recursive(SCALARS, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner))


def spoilt(document: object, data: st.DataObject) -> object:
    """`document` with one entry, at any depth, replaced by any JSON value or taken out."""
    if not isinstance(document, dict | list) or not document or data.draw(st.integers(0, 9)) == 0:
        return data.draw(JSON)
    keys = sorted(document) if isinstance(document, dict) else range(len(document))
    key = data.draw(st.sampled_from(keys))
    copy = dict(document) if isinstance(document, dict) else list(document)
    if data.draw(st.integers(0, 9)) == 0:
        del copy[key]
    else:
        copy[key] = spoilt(copy[key], data)
    return copy


def is_read_or_refused(path, content: bytes) -> bool:
    """Whether reading a file with this content gives an estimate, or a refusal with a slug."""
    path.write_bytes(content)
    try:
        return isinstance(read_model(path), Estimate)
    except PumaidError as refusal:
        return refusal.slug in ("file-damaged", "model-other-recipe")


SEEDED = settings(deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])


@settings(SEEDED, max_examples=150)
@given(data=st.data())
def test_spoilt_files_are_read_or_refused(tmp_path, data):
    assert is_read_or_refused(tmp_path / "model.json", json.dumps(spoilt(model_document(ESTIMATE), data)).encode())


@settings(SEEDED, max_examples=100)
@given(place=st.integers(min_value=0), byte=st.binary(min_size=1, max_size=3))
def test_spoilt_bytes_are_read_or_refused(tmp_path, place, byte):
    content = as_text(model_document(ESTIMATE)).encode()
    at = place % len(content)
    assert is_read_or_refused(tmp_path / "model.json", content[:at] + byte + content[at + len(byte) :])
