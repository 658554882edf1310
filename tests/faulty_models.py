"""Mutations of a good model file, by class: what editors, disks and other programs make of it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from faulty import Fault


def content(change: Callable[[bytes], bytes]) -> Callable[[Path], None]:
    """The model file with its bytes changed."""

    def apply(folder: Path) -> None:
        path = folder / "results" / "model.json"
        path.write_bytes(change(path.read_bytes()))

    return apply


def entry(*steps: str | int, value: Any = ...) -> Callable[[Path], None]:
    """The model with another value at a path; without a value the entry is taken away."""

    def change(data: bytes) -> bytes:
        document = json.loads(data)
        place: Any = document
        for step in steps[:-1]:
            place = place[step]
        if value is ...:
            del place[steps[-1]]
        else:
            place[steps[-1]] = value
        return json.dumps(document).encode()

    return content(change)


def all_models() -> Iterator[Fault]:
    """Every mutation of the model."""
    for name, data in {
        "no byte": b"",
        "blanks": b" \n ",
        "a list": b"[]",
        "a number": b"1",
        "null": b"null",
        "no JSON": b"kind: model\n",
        "a log": b"t,q1,q2\n0,1,2\n",
        "binary": bytes(range(256)),
        "a pickle": b"\x80\x04\x95\x0f\0\0\0\0\0\0\0\x8c\x05posix\x8c\x06system\x93\x8c\x04true\x85R.",
        "nested 100 000 deep": b'{"a":' * 100_000,
        "a list 100 000 deep": b"[" * 100_000 + b"]" * 100_000,
        "a number of 10 000 digits": b'{"kind": "model", "format": ' + b"1" * 10_000 + b"}",
        "another kind": b'{"kind": "comparison", "format": 1}',
        "another format": b'{"kind": "model", "format": 99, "pumaid": "9"}',
    }.items():
        yield Fault("model is none", name, content(lambda _, data=data: data))
    for share in (0.1, 0.5, 0.95):
        yield Fault(
            "model damaged", f"cut at {share:.0%}", content(lambda data, share=share: data[: int(share * len(data))])
        )
    yield Fault(
        "model damaged", "a NaN in it", content(lambda data: data.replace(b'"value": 0.', b'"value": NaN0.', 1))
    )
    yield Fault("model damaged", "an infinity in it", entry("prediction", "solution", 0, value=float("inf")))
    for key in ("robot", "joints", "recipe", "logs", "effects", "prediction", "ratios", "method"):
        yield Fault("model damaged", f"{key} missing", entry(key))
        yield Fault("model damaged", f"{key} a number", entry(key, value=7))
    for key in ("names", "solution", "covariance", "scales", "order"):
        yield Fault("model damaged", f"prediction's {key} empty", entry("prediction", key, value=[]))
        yield Fault("model damaged", f"prediction's {key} text", entry("prediction", key, value=["a", "b"]))
    yield Fault("model damaged", "a joint fewer", entry("joints", 1))
    yield Fault("model damaged", "a parameter's value text", entry("joints", 0, "parameters", 0, "value", value="0.3"))
    yield Fault("model of another arm", "another recipe", entry("recipe", "sha256", value="ab" * 32))
    yield Fault(
        "model of another arm",
        "an unknown effect",
        entry("effects", value=[{"effect": "warp", "joint": 1, "shape": {}}]),
    )
    yield Fault(
        "model of another arm",
        "a file as effect",
        entry("effects", value=[{"effect": "../x", "joint": 1, "shape": {}}]),
    )
    yield Fault(
        "model of another arm",
        "the recipe was changed since",
        lambda folder: (
            (folder / "recipe.yaml").write_text((folder / "recipe.yaml").read_text().replace("a: 0.3", "a: 0.31"))
            and None
        ),
    )
