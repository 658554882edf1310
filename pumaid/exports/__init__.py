"""A model for other programs; the forms are found by looking into ``formats``."""

import functools
import importlib
import pkgutil
from collections.abc import Mapping

from pumaid import __version__
from pumaid.effect_spec import check_parameters
from pumaid.estimate import Estimate
from pumaid.exports import formats
from pumaid.exports.base import Exported, Form, Subject, identifier
from pumaid.exports.equivalent_bodies import bodies
from pumaid.exports.formulas import Formulas
from pumaid.results.documents import check_same_recipe
from pumaid.robot import Robot

__all__ = ["Exported", "Form", "Subject", "every_form", "export"]


@functools.cache
def every_form() -> Mapping[str, Form]:
    """Every form by its name, as ``--format`` takes it."""
    modules = [importlib.import_module(f"{formats.__name__}.{x.name}") for x in pkgutil.iter_modules(formats.__path__)]
    return {name: form for module in modules for name, form in module.FORMS.items()}


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
    estimate, robot
        The model, and the arm by the recipe that the model was made with.
    form
        ``c``, ``python``, ``json``, ``matlab``, ``urdf`` or ``mjcf``.
    name
        For functions and files; made from the robot's name where not given.
    torque_constants
        Joint (from 1) -> N m/A, or N/A of a slide, for forms with masses; where not given, those that known loads
        showed. Others follow from the ratios of gains.

    Raises
    ------
    ModelError [model-other-recipe], [unknown-effect], [effect-changed]
        The model is of another recipe, or holds an effect that is not here.
    ModelError [torque-constants]
        No masses have the weight that the model says.
    """
    check_same_recipe(estimate, robot)
    check_parameters(estimate, robot)
    chosen, formulas = every_form()[form], Formulas.of(estimate, robot)
    constants = [value for value in estimate.values if value.name.startswith("torque_constant.")]
    identified = {value.joint or 0: value.value for value in constants if value.value is not None}
    chain = bodies(formulas, torque_constants or identified) if chosen.has_bodies else None
    subject = Subject(formulas, identifier(name or robot.name), chain, estimate.version or __version__)
    files, left_out = chosen.write(subject)
    return Exported(
        form=form,
        name=subject.name,
        files=files,
        left_out=left_out,
        undetermined=formulas.undetermined,
        remarks=chain.remarks if chain else (),
    )
