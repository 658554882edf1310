"""MJCF files: bodies and joints as MuJoCo reads them, as links and joints of a URDF."""

import html
import re
from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import numpy as np

from pumaid.errors import RecipeError, Where
from pumaid.robot import roll_pitch_yaw

#: The attribute of the element <robot> that holds gravity; with its blanks it stands in no file.
GRAVITY = "gravity in m/s2"
#: What MuJoCo's types of joints, by number, are in a URDF.
_TYPES = ("floating", "spherical", "prismatic", "revolute")
#: What does not place joints, so that meshes need not be there; nothing is deleted before what refers to it.
_DELETED = (
    *("keys", "sensors", "actuators", "tendons", "equalities", "pairs", "excludes", "tuples", "skins", "flexes"),
    *("geoms", "sites", "cameras", "lights", "meshes", "hfields", "materials", "textures"),
)


#: An element <include> of MJCF as groups 1 and 2, outside comments; and what stands around what a file has to include.
_INCLUDE = re.compile(
    r"""<!--.*?-->|<include\b[^>]*?\bfile\s*=\s*("([^"]*)"|'([^']*)')[^>]*>(?:\s*</include>)?""", re.S
)
_AROUND = re.compile(r"\A.*?<mujoco\w*\b[^>]*>|</mujoco\w*>\s*\Z", re.S)


def with_includes(path: Path, *above: Path) -> str:
    """The text of a URDF or MJCF file; what MJCF includes, if it is there, stands in its place.

    `above` are the files by which it is included.
    """

    def content(match: re.Match[str]) -> str:
        name = html.unescape(match[2] or match[3] or "")
        files = [file for place in (path, *above) if match[1] and (file := place.parent / name).is_file()]
        is_there = bool(files) and files[0] not in (path, *above)
        return _AROUND.sub("", with_includes(files[0], path, *above)) if is_there else match[0]

    return _INCLUDE.sub(content, path.read_bytes().decode("utf-8", "replace"))


def urdf_of_mjcf(path: Path, content: bytes, file: str) -> ElementTree.Element:
    """The bodies and joints of an MJCF file as a URDF's element ``<robot>``, bodies being links, the root ``world``.

    It has the attribute `GRAVITY`, joints the `gear` of their actuators; a link is on the axis of its last joint.

    Parameters
    ----------
    path, content, file
        The file, to which includes are relative (``-`` where there are none), its bytes, and its name for messages.

    Raises
    ------
    RecipeError [urdf-refused]
        MuJoCo cannot read it.
    """
    from mujoco import FatalError, MjData, MjSpec, mj_kinematics, mjtEq, mjtTrn

    try:
        spec = MjSpec.from_string(content.decode()) if str(path) == "-" else MjSpec.from_file(str(path.resolve()))
        gears = {drive.target: f"{drive.gear[0]:g}" for drive in spec.actuators if drive.trntype == mjtTrn.mjTRN_JOINT}
        leaders = {tie.name1: tie.name2 for tie in spec.equalities if tie.type == mjtEq.mjEQ_JOINT}
        for element in [element for kind in _DELETED for element in getattr(spec, kind)]:
            spec.delete(element)
        spec.compiler.boundmass = spec.compiler.boundinertia = 1.0  # where they came from shapes; they have no use here
        model = spec.compile()
    except (ValueError, FatalError) as error:
        raise RecipeError(
            "urdf-refused",
            f"MuJoCo cannot read this MJCF file: {' '.join(str(error).split())}"[:200],
            Where(file=file),
            "mend it until MuJoCo loads it; files that it includes must lie where it says",
        ) from error
    data = MjData(model)
    data.qpos[:] = 0.0
    mj_kinematics(model, data)
    parts, ends = ["<link name='world'/>"], {0: ("'world'", np.eye(4))}  # by body its link, where it is in the world
    for body in range(1, model.nbody):
        first, count = model.body_jntadr[body], model.body_jntnum[body]
        for joint in range(first, first + count) or [None]:
            link, before = ends.get(body, ends[model.body_parentid[body]])
            inner = f"/{joint}" * (joint not in (None, first + count - 1))
            child = quoteattr((model.body(body).name or f"body{body}") + inner)
            frame = np.eye(4)
            frame[:3, :3], frame[:3, 3] = data.xmat[body].reshape(3, 3), data.xpos[body]
            name, kind, axis, limits = f"to body {body}", "fixed", frame[0, :3], (np.inf, np.inf)
            if joint is not None:
                name, kind = model.joint(joint).name or f"joint{joint + 1}", _TYPES[model.jnt_type[joint]]
                frame[:3, 3], axis = data.xanchor[joint], data.xaxis[joint] @ frame[:3, :3]
                limits = model.jnt_range[joint] if model.jnt_limited[joint] else limits
            offset = np.linalg.inv(before) @ frame
            parts.append(
                f"<link name={child}/><joint name={quoteattr(name)} type='{kind}' gear='{gears.get(name, 1)}'>"
                f"<parent link={link}/><child link={child}/><limit lower='{limits[0]}' upper='{limits[1]}'/>"
                f"<origin xyz={_text(offset[:3, 3])} rpy={_text(roll_pitch_yaw(offset[:3, :3]))}/>"
                f"<axis xyz={_text(axis)}/><mimic joint={quoteattr(leaders.get(name, ''))}/></joint>"
            )
            ends[body] = child, frame
    robot = ElementTree.fromstring(f"<robot name={quoteattr(spec.modelname)}>{''.join(parts)}</robot>")
    robot.set(GRAVITY, " ".join(map(str, model.opt.gravity)))
    return robot


def _text(values: Iterable[float]) -> str:
    return quoteattr(" ".join(map(str, values)))
