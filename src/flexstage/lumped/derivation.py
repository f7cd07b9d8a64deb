"""The equations of a stage, derived, reduced, and with transfer functions."""

from dataclasses import dataclass
from typing import Any

from flexstage.base.errors import ModelError
from flexstage.lumped.latex import SheetSection, sheet_data
from flexstage.lumped.reduction import ReducedModel, condense, find_mirror, reduce_by_symmetry
from flexstage.lumped.requests import EquationsRequest
from flexstage.lumped.sheet import equation_sheet
from flexstage.lumped.symbolic import SymbolicModel, symbolic_model
from flexstage.lumped.transfer import LARGEST_ORDER, TransferFunction, transfer_function
from flexstage.stage import Stage

# a stage whose stiffness differs from its image by less is reduced as a symmetric one, which the
# output says: the frequencies change by the square of it
_ASYMMETRY = 0.02


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Derivation:
    """The equations of a stage."""

    stage: Stage
    """The stage."""
    model: SymbolicModel
    """All of them."""
    reduced: ReducedModel | None
    """The same in fewer coordinates; None where not requested, or of no use."""
    transfer: tuple[TransferFunction, ...]
    """Transfer functions of the reduced model, where they are short enough to read."""

    @property
    def sheet(self) -> tuple[SheetSection, ...]:
        """All of it as a sheet of equations."""
        return equation_sheet(self.model, reduced=self.reduced, transfer=self.transfer)

    def to_dict(self) -> dict[str, Any]:
        """Return the equations as plain data, as `flexstage equations --json` prints them."""
        reduced = self.reduced
        return {
            "stage": self.stage.name,
            "order": self.model.order,
            "coordinates": [x.name for x in self.model.coordinates],
            "values": {x.name: v for x, v in self.model.values.items()},
            "reduced": None
            if reduced is None
            else {"how": reduced.how, "coordinates": [x.name for x in reduced.coordinates]},
            "transfer_functions": [
                {
                    "drive": tf.drive,
                    "probe": tf.probe,
                    "input_kind": tf.input_kind,
                    "numerator": top.tolist(),
                    "denominator": bottom.tolist(),
                    "poles_hz": sorted({round(abs(p) / 6.283185307179586, 9) for p in tf.poles()}),
                }
                for tf in self.transfer
                for top, bottom in [tf.coefficients()]
            ],
            "sections": sheet_data(self.sheet),
        }


def derive(stage: Stage, request: EquationsRequest) -> Derivation:
    """Derive the equations of a stage, and reduce them for the transfer functions of its axes.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> derive(design("parallelogram"), EquationsRequest()).reduced.order
    5
    """
    model = symbolic_model(stage, damping=request.damping)
    reduced = _reduced(model, stage, request)
    return Derivation(
        stage=stage,
        model=model,
        reduced=reduced,
        transfer=() if reduced is None else _transfer(reduced, stage, request.axis),
    )


def _reduced(model: SymbolicModel, stage: Stage, request: EquationsRequest) -> ReducedModel | None:
    how = request.reduce
    if how == "none":
        return None
    drive = stage.drive_of(request.axis).name if request.axis is not None else None
    mirror = None if how == "condense" else find_mirror(model.source, tolerance=_ASYMMETRY)
    if how == "symmetry":
        return reduce_by_symmetry(model, drive=drive, mirror=mirror)
    if mirror is not None and model.drives:
        try:
            found = reduce_by_symmetry(model, drive=drive, mirror=mirror)
        except ModelError:
            found = None
        if found is not None and found.order <= LARGEST_ORDER:
            return found
    if not (model.drives or model.probes):
        return None
    return condense(model)


def _transfer(
    reduced: ReducedModel, stage: Stage, axis: str | None
) -> tuple[TransferFunction, ...]:
    if reduced.order > LARGEST_ORDER:
        return ()
    drives = {p.name for p in reduced.drives}
    probes = {p.name for p in reduced.probes}
    return tuple(
        transfer_function(reduced, drive, a.probe)
        for a in stage.axes
        for drive in a.moved_by
        if axis in (None, a.name) and drive in drives and a.probe in probes
    )
