"""A stage as one mesh: of its plane, or of layers of prisms through half of its thickness."""

from typing import Literal

from flexstage.base import progress
from flexstage.elasticity import Continuum
from flexstage.elasticity.resources import require_memory
from flexstage.fem.geometry import MOUNTING, either, notch_region, stage_faces
from flexstage.fem.mesh import MIDDLE, MeshSettings, mesh_without_slivers, prism_mesh
from flexstage.fem.model import StageModel, assemble
from flexstage.fem.stage_system import Supports
from flexstage.fem.substructure import notch_states
from flexstage.hinges import Leaf
from flexstage.hinges.hinge_spring import PLANE_RULE, PlaneState
from flexstage.stage import Stage
from flexstage.stage.assumptions import DAMPING_RATIO

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
    sharp = [h.name for h in stage.hinges if isinstance(h.profile, Leaf)]
    corners = (
        f"Leaves end in sharp corners ({', '.join(sharp[:4])}"
        f"{', ...' if len(sharp) > 4 else ''}): the stress there is singular and its largest value "
        "depends on the mesh; corner-filleted leaves have a finite one.",
    )
    return (
        f"Linear elasticity, small displacements; {supports_note or 'nothing is fixed'}.",
        "Natural frequencies belong to the bare stage, drives removed, unless labelled otherwise.",
        f"Damping of {ratio:g} % in every mode is an assumption: it sets the height of the "
        "resonances.",
        *(corners if sharp else ()),
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
