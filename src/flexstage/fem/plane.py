"""A stage in its plane: curved triangles, plane strain in wide notches, plane stress elsewhere."""

from typing import Literal

from flexstage import progress
from flexstage.elasticity import Continuum
from flexstage.elasticity.resources import require_memory
from flexstage.fem.geometry import MOUNTING, either, notch_region, stage_faces
from flexstage.fem.mesh import MeshSettings, sound_mesh
from flexstage.fem.model import StageModel, assemble
from flexstage.fem.ports import Supports
from flexstage.hinges import Leaf, plane_state
from flexstage.hinges.hinge_spring import PLANE_RULE, PlaneState
from flexstage.stage import Stage
from flexstage.stage.assumptions import DAMPING_RATIO

#: Modes that are kept besides the static responses.
MODES = 16


def strained_notches(stage: Stage, plane: PlaneState | Literal["auto"]) -> tuple[str, str]:
    """Choose the regions in plane strain.

    Returns their regular expression, empty for none, and the choice in words.
    """
    chosen = {
        h.name: plane_state(stage.thickness, h.profile.neck_thickness) if plane == "auto" else plane
        for h in stage.hinges
    }
    wide = [n for n, state in chosen.items() if state == "strain"]
    words = " and ".join(sorted(set(chosen.values()))) or "stress"
    return either(notch_region(n, i) for n in wide for i in (0, 1)), words


def plane_model(
    stage: Stage,
    settings: MeshSettings | None = None,
    *,
    plane: PlaneState | Literal["auto"] = "auto",
    modes: int = MODES,
    supports: Supports = "rigid",
) -> StageModel:
    """Return the finite-element model of a stage in its plane.

    Parameters
    ----------
    stage : Stage
        The stage.
    settings : MeshSettings, optional
        How fine the mesh is; order 4 with elements of 0.8 necks where not given.
    plane : str
        ``stress`` or ``strain`` in all notches, or ``auto`` to choose by width against neck; the
        bodies are in plane stress.
    modes : int
        Number of modes that are kept besides the static responses.
    supports : str
        ``rigid`` where a drive that reacts on a fixed body stands on the ground, as lumped models
        and most published ones have it; ``elastic`` where the frame gives way under it.

    Returns
    -------
    StageModel
        The model; its `system` is exact in statics for drives, probes and loads.

    Raises
    ------
    StageError
        Bodies overlap, nothing holds a body, or a fixed one has nothing to be held by.
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
    mesh = sound_mesh(stage, faces, settings)
    strain, words = strained_notches(stage, plane)
    continuum = Continuum(
        mesh,
        stage.material,
        order=settings.order,
        thickness=stage.thickness,
        strain=strain,
        held=MOUNTING,
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
            *common_validity(stage, faces.held),
        ),
        choices={
            "model": "plane",
            "plane": words,
            "order": str(settings.order),
            "neck size": f"{settings.neck_size:g}",
            "elements": str(mesh.ne),
            "unknowns": str(continuum.size),
            "held": faces.held,
        },
        supports=supports,
    )


def common_validity(stage: Stage, held: str) -> tuple[str, ...]:
    """Return what holds for every finite-element model of a stage."""
    ratio = 100.0 * DAMPING_RATIO
    sharp = [h.name for h in stage.hinges if isinstance(h.profile, Leaf)]
    corners = (
        f"Leaves end in sharp corners ({', '.join(sharp[:4])}"
        f"{', ...' if len(sharp) > 4 else ''}): the stress there is singular and its largest value "
        "depends on the mesh; corner-filleted leaves have a finite one.",
    )
    return (
        f"Linear elasticity, small displacements; {held or 'nothing is fixed'}.",
        "Natural frequencies belong to the bare stage, drives removed, unless labelled otherwise.",
        f"Damping of {ratio:g} % in every mode is an assumption: it sets the height of the "
        "resonances.",
        *(corners if sharp else ()),
        *stage.own_notes,
    )
