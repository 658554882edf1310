"""What URDF and MJCF share: names, numbers and the head of an XML file, and what masses leave out."""

import textwrap
import xml.etree.ElementTree as ET
from typing import Any

import numpy as np

from pumaid.exports.base import Subject, commented
from pumaid.exports.equivalent_bodies import Bodies
from pumaid.exports.formulas import Lack
from pumaid.exports.source_code import WIDTH, head

_PHYSICS = (
    "masses, Coulomb and viscous friction have no place for it; c, python, json and matlab have where it can be written"
)


def xml_name(text: str) -> str:
    """A name without what XML cannot hold, such as control characters."""
    return "".join(letter if letter.isprintable() else "_" for letter in text)


def add(parent: ET.Element, tag: str, **attributes: Any) -> ET.Element:
    """A new element in `parent`; no number is rounded, and zero has no sign."""
    out = ET.SubElement(parent, tag)
    for name, value in attributes.items():
        out.set(name, value if isinstance(value, str) else " ".join(repr(x + 0.0) for x in np.ravel(value).tolist()))
    return out


def bodies_of(subject: Subject) -> Bodies:
    """The masses, which every form that asks for them is given."""
    assert subject.bodies is not None
    return subject.bodies


def written(root: ET.Element, subject: Subject, *, left_out: tuple[Lack, ...], remark: str) -> str:
    """A whole XML file, with a comment at its head that says what it is and what is not in it."""
    lines = [*head(subject, left_out), ""]
    lines += [
        part
        for line in (*subject.remarks, remark)
        for part in textwrap.wrap(commented(line), WIDTH, subsequent_indent="    ")
    ]
    ET.indent(root)
    comment = "\n".join(f"  {line}".rstrip() for line in lines)
    return f'<?xml version="1.0" encoding="utf-8"?>\n<!--\n{comment}\n-->\n{ET.tostring(root, encoding="unicode")}\n'


def weights_only(subject: Subject) -> tuple[Lack, ...]:
    """What a chain of masses with friction leaves out of a model."""
    formulas, held = subject.formulas, bodies_of(subject)
    lacks = {lack.name: lack for lack in formulas.left_out}
    for term in formulas.terms:
        lacks.setdefault(term.effect, Lack(term.effect, _PHYSICS))
    uneven = [
        f"{off:.3g} {'N m' if formulas.robot.joint(joint).is_revolute else 'N'} at joint {joint}"
        for joint, (off, both) in enumerate(zip(held.uneven, held.friction, strict=True), start=1)
        if off > 0.005 * max(both, 1e-300)
    ]
    if uneven or (formulas.viscous[:, 0] != formulas.viscous[:, 1]).any():
        off = f"; Coulomb friction of each is off it by {', '.join(uneven)}" if uneven else ""
        lacks["direction"] = Lack("direction of friction", f"the mean of forward and backward is written{off}")
    if (formulas.shaft != 0).sum() > len(formulas.shaft):
        lacks["shaft"] = Lack("coupled gears", "friction follows each joint's own velocity, not its motor shaft's")
    lacks["inertia"] = Lack("inertia", "moments of inertia are made up (balls of aluminium); no current showed them")
    return tuple(lacks.values())
