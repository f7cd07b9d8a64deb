"""The structural diagram of a whole stage: bodies, hinges, drives and probes as blocks."""

from flexstage.export.diagram.body_blocks import BodyBlocks, add_body
from flexstage.export.diagram.builder import DiagramBuilder
from flexstage.export.diagram.drive_chain import add_drive_chain, add_probe_chain
from flexstage.export.diagram.graph import Diagram
from flexstage.export.diagram.hinge_blocks import add_hinge
from flexstage.export.diagram.sight_blocks import add_drive, add_reading
from flexstage.export.diagram.springs import DriveSpring
from flexstage.export.diagram.twins import Twins
from flexstage.export.model import DynamicModel
from flexstage.lumped import Mechanism
from flexstage.system import RayleighDamping


def whole_stage(
    mechanism: Mechanism,
    model: DynamicModel,
    *,
    twins: Twins,
    springs: dict[str, DriveSpring],
    damping: RayleighDamping,
    title: str,
    notes: tuple[str, ...],
) -> Diagram:
    """Return the diagram of a whole stage.

    The signals of twins stand below one another in one line, so that the diagram holds the same
    equations whichever are drawn together.
    """
    builder = DiagramBuilder()
    drives = {sight.name: sight for sight in mechanism.drives}
    opened = {
        d.name: builder.group(
            f"d_{d.name}",
            title=f"Drive {d.name} ({d.kind})",
            kind="drive",
            place=drives[d.name].points[1],
        )
        for d in model.drives
    }
    bodies: dict[int, BodyBlocks] = {}
    for members in twins.bodies:
        made = add_body(builder, mechanism, members, damping)
        bodies |= dict.fromkeys(members, made)
    for members in twins.hinges:
        add_hinge(builder, mechanism, members, bodies, damping)
    for d in model.drives:
        free = add_drive_chain(builder, model, d, opened[d.name])
        add_drive(
            builder, mechanism, drives[d.name], bodies, springs[d.name], damping, free,
            opened[d.name],
        )  # fmt: skip
    by_probe = {sight.name: sight for sight in mechanism.probes}
    for probe in model.probes:
        sight = by_probe[probe.name]
        group = builder.group(
            f"p_{probe.name}", title=f"Probe {probe.name}", kind="probe", place=sight.points[1]
        )
        read = add_reading(builder, mechanism, sight, bodies, group)
        if read:
            add_probe_chain(builder, probe, read, group)
    return builder.diagram(title, notes)
