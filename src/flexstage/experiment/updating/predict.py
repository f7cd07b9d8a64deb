"""What a model of a stage says of the quantities that were measured on it."""

from collections.abc import Sequence

import numpy as np

from flexstage.arrays import Array
from flexstage.choose import has_no
from flexstage.errors import ModelError
from flexstage.system import AxisAnalysis, DriveCondition, MechanicalSystem, analyse_axis, modes
from flexstage.system.analysis import axis_mode
from flexstage.system.mechanical import AxisPort

_MODAL = ("natural_frequency_hz", "damping_ratio")
_STATIC = ("transmission_ratio", "output_displacement", "input_stiffness")
#: Quantities that a stage can be fitted to.
UPDATABLE: tuple[str, ...] = (*_MODAL, *_STATIC)


def predict(
    system: MechanicalSystem,
    wanted: Sequence[tuple[str, str]],
    *,
    drives: DriveCondition = "removed",
) -> Array:
    """Return what a model says of quantities of its axes.

    Parameters
    ----------
    system : MechanicalSystem
        The model.
    wanted : sequence of tuple of str
        Quantity, one of `UPDATABLE`, and name of an axis.
    drives : str
        Condition of the drives that frequencies and damping belong to; ratios and strokes are those
        of one drive over its stroke, the others removed.

    Returns
    -------
    numpy.ndarray
        The values [Hz, 1, m, N/m], shape (n,).

    Raises
    ------
    ModelError
        A quantity cannot be had, or the stage has no such axis.

    Examples
    --------
    >>> from flexstage.designs import design
    >>> from flexstage.lumped import lumped_system
    >>> system = lumped_system(design("parallelogram"))
    >>> round(float(predict(system, [("natural_frequency_hz", "x")])[0]), 1)
    193.7
    """
    axes = {axis.name: axis for axis in system.axes}
    for quantity, name in wanted:
        if quantity not in UPDATABLE:
            raise ModelError(
                f"a stage cannot be fitted to '{quantity}': expected one of {', '.join(UPDATABLE)}"
            )
        if name not in axes:
            raise ModelError(has_no("the stage", "axis", name, axes))
    bare = modes(system, count=None)
    found = bare if drives == "removed" else modes(system, drives=drives, count=None)
    pushed: dict[str, AxisAnalysis] = {
        name: analyse_axis(system, axes[name])
        for name in sorted({name for quantity, name in wanted if quantity in _STATIC})
    }

    def value(quantity: str, axis: AxisPort) -> float:
        if quantity in _STATIC:
            one = pushed[axis.name]
            if quantity == "transmission_ratio":
                return one.output_displacement / one.input_displacement
            return getattr(one, quantity)
        mode = axis_mode(system, found, axis.drive, axis.probe)
        return float((found.frequency_hz if quantity == _MODAL[0] else found.damping_ratio)[mode])

    return np.array([value(quantity, axes[name]) for quantity, name in wanted])
