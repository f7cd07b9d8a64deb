"""A stage as one mesh, of its plane or of layers of prisms, and the refinement of the mesh."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from flexstage.base import progress
from flexstage.base.errors import ConvergenceError, ModelError
from flexstage.base.short_repr import short_repr
from flexstage.elasticity import Continuum
from flexstage.elasticity.resources import require_memory
from flexstage.fem.geometry import MOUNTING, either, notch_region, stage_faces
from flexstage.fem.mesh import MIDDLE, MeshSettings, mesh_without_slivers, prism_mesh
from flexstage.fem.model import StageModel, assemble
from flexstage.fem.stage_system import Supports, region_materials
from flexstage.fem.substructure import notch_states
from flexstage.hinges.hinge_spring import PLANE_RULE, PlaneState
from flexstage.quantities.characteristic import Characteristics
from flexstage.quantities.quantity import QUANTITIES
from flexstage.stage import Stage
from flexstage.stage.assumptions import DAMPING_RATIO
from flexstage.stage.contour import has_sharp_root, short_halves
from flexstage.system import Analysis, analyse
from flexstage.system.characteristics import NO_LIMIT, scatter_at_points

#: Number of modes that are retained besides the static responses.
PLANE_MODES = 16


def plane_model(
    stage: Stage,
    settings: MeshSettings | None = None,
    *,
    plane: PlaneState | Literal["auto"] = "auto",
    modes: int = PLANE_MODES,
    supports: Supports = "rigid",
) -> StageModel:
    """Return the finite-element model of a stage in its plane.

    Parameters
    ----------
    stage : Stage
        The stage.
    settings : MeshSettings, optional
        Mesh settings; order 4 with elements of 0.8 necks where not given.
    plane : str
        ``stress`` or ``strain`` in all notches, or ``auto`` to choose by width against neck; the
        bodies are in plane stress.
    modes : int
        Number of modes that are kept besides the static responses.
    supports : str
        ``rigid`` where a drive that reacts on a fixed body reacts on the ground, as in lumped and
        most published models; ``elastic`` where the frame is compliant.

    Returns
    -------
    StageModel
        The model; its `system` is exact in statics for drives, probes and loads.

    Raises
    ------
    StageError
        Bodies overlap, a body is not attached, or a fixed one cannot be supported.
    ModelError
        The mesher failed, or the memory does not suffice.

    Notes
    -----
    Validity: small displacements; motion in the plane only. Against three dimensions, the study's
    stages are within 0.1 % in transmission ratio and 1 % in frequency.
    """
    settings = settings or MeshSettings()
    progress.update("mesh")
    faces = stage_faces(stage)
    mesh = mesh_without_slivers(stage, faces, settings)
    states = notch_states(stage, plane)
    words = " and ".join(sorted(set(states))) or "stress"
    wide = [h.name for h, s in zip(stage.hinges, states, strict=True) if s == "strain"]
    continuum = Continuum(
        mesh,
        stage.material,
        order=settings.order,
        thickness=stage.thickness,
        strain=either(notch_region(n, i) for n in wide for i in (0, 1)),
        fixed=MOUNTING,
        regions=region_materials(stage),
    )
    require_memory(continuum.size, 2, settings.order)
    return assemble(
        stage,
        faces,
        [(continuum, modes, False)],
        settings,
        validity=(
            f"Plane finite elements: plane {words} at the notches ({PLANE_RULE}), plane stress in "
            "the bodies; out-of-plane motion is not modelled.",
            *common_validity(stage, faces.supports),
        ),
        choices={
            "model": "plane",
            "plane": words,
            "order": str(settings.order),
            "neck size": f"{settings.neck_size:g}",
            "elements": str(mesh.ne),
            "unknowns": str(continuum.size),
            "held": faces.supports,
        },
        supports=supports,
    )


def common_validity(stage: Stage, supports_note: str) -> tuple[str, ...]:
    """Return the limits of validity of every finite-element model of a stage."""
    ratio = 100.0 * DAMPING_RATIO
    sharp = [h.name for h in stage.hinges if has_sharp_root(stage, h)]
    corners = (
        f"The stress at the sharp root of {', '.join(sharp[:4])}"
        f"{', ...' if len(sharp) > 4 else ''} grows with the mesh without a limit; give a fillet, "
        "such as kind corner-filleted, for a finite one.",
    )
    early = ", ".join(f"{n} from {100.0 * s:.0f} %" for n, s in short_halves(stage).items())
    steep = f"Of the length of a half notch the end is of its body, where that is another: {early}."
    return (
        f"Linear elasticity, small displacements; {supports_note or 'nothing is fixed'}.",
        "Natural frequencies belong to the bare stage, drives removed, unless labelled otherwise.",
        f"Damping of {ratio:g} % in every mode is an assumption: it sets the height of the "
        "resonances.",
        *(corners if sharp else ()),
        *stage.material_notes,
        *((steep,) if early else ()),
        *stage.own_notes,
    )


#: Numbers of modes that are retained besides the static responses, in the plane and out of it.
SOLID_MODES = (12, 8)


def solid_model(
    stage: Stage,
    settings: MeshSettings | None = None,
    *,
    modes: tuple[int, int] = SOLID_MODES,
    supports: Supports = "rigid",
) -> StageModel:
    """Return the finite-element model of a stage in three dimensions.

    A plate that is driven in its middle plane has two decoupled motions: one symmetric about that
    plane, which is motion in the plane, and one antisymmetric, which is motion out of it. Each is
    solved on half of the thickness.

    Parameters
    ----------
    stage : Stage
        The stage.
    settings : MeshSettings, optional
        Mesh settings; order 4 with elements of 0.8 necks and one layer of prisms through
        half of the thickness where not given.
    modes : tuple of int
        Numbers of modes in the plane and out of it that are kept besides the static responses.
    supports : str
        ``rigid`` where a drive that reacts on a fixed body reacts on the ground, as in lumped and
        most published models; ``elastic`` where the frame is compliant.

    Returns
    -------
    StageModel
        The model, with modes and stiffness out of the plane.

    Raises
    ------
    StageError
        Bodies overlap, a body is not attached, or a fixed one cannot be supported.
    ModelError
        The mesher failed, or the memory does not suffice.

    Notes
    -----
    Validity: small displacements; drives, probes and extra masses act in the middle plane; the
    mounting holes are fixed over their full depth.
    """
    settings = settings or MeshSettings()
    progress.update("mesh")
    faces = stage_faces(stage)
    mesh = prism_mesh(stage, faces, settings)
    inside = Continuum(
        mesh,
        stage.material,
        order=settings.order,
        fixed=MOUNTING,
        fixed_components={"z": MIDDLE},
        copies=2,
        regions=region_materials(stage),
    )
    outside = inside.with_supports(MOUNTING, dict.fromkeys("xy", MIDDLE))
    low, high = mesh.ngmesh.bounding_box
    require_memory(
        inside.size,
        3,
        settings.order,
        box=[high[c] - low[c] for c in range(3)],
        layered=settings.layers == 1,
    )
    return assemble(
        stage,
        faces,
        [(inside, modes[0], False), (outside, modes[1], True)],
        settings,
        validity=(
            "3D finite elements: drives, probes and extra masses act in the middle plane of the "
            "plate; mounting holes are fixed over their full depth.",
            *common_validity(stage, faces.supports),
        ),
        choices={
            "model": "solid",
            "order": str(settings.order),
            "neck size": f"{settings.neck_size:g}",
            "layers": f"{settings.layers} through half the thickness",
            "elements": str(mesh.ne),
            "unknowns": str(inside.size),
            "held": faces.supports,
        },
        supports=supports,
    )


#: Meshes of rising accuracy, by model: order, then element size at the necks.
REFINEMENT_MESHES: Mapping[str, tuple[MeshSettings, ...]] = {
    "plane": tuple(
        MeshSettings(order=p, neck_size=h)
        for p, h in ((3, 1.2), (4, 0.8), (5, 0.8), (6, 0.6), (7, 0.5), (8, 0.4))
    ),
    "solid": tuple(
        MeshSettings(order=p, neck_size=h) for p, h in ((2, 1.5), (3, 1.2), (4, 0.8), (5, 0.8))
    ),
}

# How much smaller the change at the next step can be taken to be than at the last one.
_BEST_RATE, _WORST_RATE = 0.15, 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class RefinementStep:
    """One mesh of a refinement."""

    settings: MeshSettings
    """Settings of the mesh."""
    unknowns: int
    """Number of unknowns."""
    seconds: float
    """Computing time [s]."""
    values: Mapping[tuple[str, str], float]
    """Value of each quantity and axis."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Refinement:
    """A refined model, with the meshes of the refinement."""

    model: StageModel
    """The last model."""
    analysis: Analysis
    """Analysis; each characteristic has the estimate of its error as its uncertainty."""
    steps: tuple[RefinementStep, ...]
    """The meshes, coarsest first."""
    quantity: str
    """The requested quantity."""
    accuracy: float
    """The requested relative accuracy [1]."""

    __repr__ = short_repr

    @property
    def estimate(self) -> float:
        """Estimate of the relative error of the requested quantity [1]."""
        return estimate(self.steps, self.quantity)


def estimate(steps: Sequence[RefinementStep], quantity: str) -> float:
    r"""Estimate the relative error of a quantity on the last mesh, the largest over the axes.

    Every mesh of a refinement raises the order, so that changes decrease as in a geometric series
    with the rate r of the last two: the remaining change is :math:`|d_k|\,r/(1-r)`. r counts as
    0.15 at least, because an accidentally small change must not make the estimate small, and as 0.5
    where only one change is known or the changes do not decrease; the estimate is the last change
    itself then.

    It is infinite from one mesh alone.
    """
    if len(steps) < 2:
        return math.inf
    return max(
        (
            _left(steps, key) / abs(value) if value else 0.0
            for key, value in steps[-1].values.items()
            if key[0] == quantity and key in steps[-2].values
        ),
        default=math.inf,
    )


def _left(steps: Sequence[RefinementStep], key: tuple[str, str]) -> float:
    """Estimate the distance of the last value of a quantity from its limit."""
    values = [step.values[key] for step in steps[-3:]]
    last = abs(values[-1] - values[-2])
    rate = _WORST_RATE
    if len(values) == 3 and (before := abs(values[-2] - values[-3])) > 0.0:
        rate = min(max(last / before, _BEST_RATE), _WORST_RATE)
    return last * rate / (1.0 - rate)


def refine(
    build: Callable[[MeshSettings], StageModel],
    meshes: Sequence[MeshSettings],
    *,
    accuracy: float,
    quantity: str = "natural_frequency_hz",
) -> Refinement:
    """Refine the mesh and raise the order until a quantity has converged.

    It has converged when `estimate` is within the accuracy. Errors that all meshes share, of
    geometry, material and supports, are not included.

    Parameters
    ----------
    build : callable
        Returns the model for mesh settings.
    meshes : sequence of MeshSettings
        The meshes, coarsest first; see `REFINEMENT_MESHES`.
    accuracy : float
        Required relative accuracy, above 0 [1].
    quantity : str
        One of the quantities of a stage, such as ``natural_frequency_hz`` or ``max_stress``.

    Returns
    -------
    Refinement
        The first model that is accurate enough.

    Raises
    ------
    ModelError
        The accuracy or the quantity is invalid.
    ConvergenceError
        The finest mesh was not accurate enough.
    """
    if not 0.0 < accuracy < 1.0:
        raise ModelError(
            f"the accuracy must lie between 0 and 1 (0.001 is 0.1 %), got {accuracy!r}"
        )
    if quantity not in QUANTITIES:
        raise ModelError(f"unknown quantity '{quantity}': expected one of {', '.join(QUANTITIES)}")
    steps: list[RefinementStep] = []
    for k, settings in enumerate(meshes):
        # each step costs about twice the one before; how many there will be is not known
        with progress.subtask(1.0 - 0.5**k, 1.0 - 0.5 ** (k + 1)):
            begun = time.perf_counter()
            model = build(settings)
            analysis = analyse(model.stage, model.system)
        values = {(r.quantity, r.axis): r.value for r in analysis.characteristics}
        if any(r.quantity == quantity and NO_LIMIT in r.note for r in analysis.characteristics):
            raise ConvergenceError(
                f"{quantity} grows with the mesh without a limit at a sharp root: give a fillet "
                "there, or another quantity"
            )
        if not any(name == quantity for name, _ in values):
            raise ModelError(
                f"the model gives no {quantity}, so its accuracy cannot be reached: choose one of "
                f"{', '.join(sorted({name for name, _ in values})) or 'none'}"
            )
        seconds = time.perf_counter() - begun
        steps.append(
            RefinementStep(
                settings=settings, unknowns=model.unknowns, seconds=seconds, values=values
            )
        )
        if len(steps) > 1 and estimate(steps, quantity) <= accuracy:
            return Refinement(
                model=model,
                analysis=_with_changes(analysis, steps, quantity, accuracy),
                steps=tuple(steps),
                quantity=quantity,
                accuracy=accuracy,
            )
    left = estimate(steps, quantity)
    raise ConvergenceError(
        f"the finest mesh leaves {quantity} uncertain by {left:.2g}, more than the {accuracy:.2g} "
        "requested: request less, or look for a corner without a radius, where the stress is "
        "singular"
    )


def _with_changes(
    analysis: Analysis, steps: Sequence[RefinementStep], quantity: str, accuracy: float
) -> Analysis:
    rows = []
    for row in analysis.characteristics:
        if NO_LIMIT in row.note:
            rows.append(row)
            continue
        key = (row.quantity, row.axis)
        estimates = [] if row.uncertainty is None else [row.uncertainty]
        if all(key in step.values for step in steps):
            # several meshes tell how the largest stress moves between their points
            estimates = [
                scatter_at_points(row) if row.quantity == "max_stress" else k for k in estimates
            ]
            estimates.append(_left(steps, key))
        rows.append(replace(row, uncertainty=max(estimates) if estimates else None))
    words = (
        f"Mesh refined until {quantity} converged to {100.0 * estimate(steps, quantity):.2g} % "
        f"(requested: {100.0 * accuracy:.2g} %). Uncertainties are estimated from the changes "
        "between meshes and exclude errors of geometry, material and supports."
    )
    return replace(
        analysis,
        characteristics=Characteristics(rows),
        validity=(*analysis.validity, words),
    )
