"""A model in a form that other programs use."""

from __future__ import annotations

from collections.abc import Mapping

from pumaid import __version__
from pumaid.choices import check_known
from pumaid.chosen import check_parameters
from pumaid.exports import Exported, Subject, every_form
from pumaid.exports.bodies import Bodies, bodies
from pumaid.exports.formulas import Formulas
from pumaid.exports.names import identifier
from pumaid.exports.torque import constants_of
from pumaid.records import Estimate
from pumaid.results.model_file import check_same_recipe
from pumaid.robot import Robot


def export(
    estimate: Estimate,
    robot: Robot,
    *,
    form: str,
    name: str = "",
    torque_constants: Mapping[int, float] | None = None,
) -> Exported:
    """Write a model down for another program; nothing is written to disk.

    Parameters
    ----------
    estimate
        The model.
    robot
        The arm, by the recipe that the model was made with.
    form
        ``c``, ``python``, ``json``, ``matlab``, ``urdf`` or ``mjcf``.
    name
        For functions and files; made from the robot's name where not given.
    torque_constants
        Joint (from 1) -> N m/A, or N/A of a slide, for forms with masses; those that are not given follow from the
        ratios of gains.

    Returns
    -------
    exported
        Its files' texts, what they leave out, and which parameters the data did not tell.

    Raises
    ------
    ModelError [model-other-recipe], [unknown-effect], [effect-changed]
        The model is of another recipe, or holds an effect that is not here.
    ModelError [export-masses]
        No masses have the weight that the model says.
    """
    check_same_recipe(estimate, robot)
    check_known(estimate.effects)
    check_parameters(estimate, robot)
    chosen, told = every_form()[form], Formulas.of(estimate, robot)
    held: Bodies | None = None
    remarks: tuple[str, ...] = ()
    if chosen.has_bodies:
        torques, remarks = constants_of(told, torque_constants or {})
        held = bodies(told, torques)
        remarks = (*remarks, *held.remarks)
    subject = Subject(told, identifier(name or robot.name), held, estimate.version or __version__, remarks)
    return Exported(
        form=form,
        title=chosen.title,
        name=subject.name,
        files=chosen.texts(subject),
        left_out=chosen.left_out(subject),
        undetermined=told.undetermined,
        remarks=remarks,
    )
