"""Working lines of stacks: what is left of stroke and force on the stage."""

from dataclasses import dataclass
from typing import Any

from flexstage.files.plain import picked
from flexstage.stage.drive import PiezoStack
from flexstage.stage.model import Stage
from flexstage.system.mechanical import MechanicalSystem
from flexstage.system.seated_drives import static_drives

# keys of the plain data of a working line
_KEYS = (
    "free_stroke=drive.free_stroke", "stiffness=drive.stiffness",
    "blocking_force=drive.blocked_force", "stage_stiffness", "preload_stiffness", "stroke",
    "stroke_share", "lost_on_seats", "force", "force_share", "contact_force",
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkingLine:
    r"""A stack at its full free stroke on its stage.

    .. math:: F = k_p (L_0 - x_p), \quad F = (k_s + k_0)\,x, \quad x = x_p - a(F)

    The line of the stack has its stiffness k_p and free stroke L0; the load is the stage with k_s
    and the preload spring with k_0, and the seats approach by a(F). Without seats
    :math:`x = L_0 k_p/(k_p + k_s + k_0)`.
    """

    drive: PiezoStack
    """The stack."""
    stroke: float
    """Elongation between both bodies [m]."""
    force: float
    """Force of the stack on stage and preload spring [N]."""
    contact_force: float
    """Force on the seats, that of the preload included [N]."""

    @property
    def stroke_share(self) -> float:
        """Stroke over free stroke [1]."""
        return self.stroke / self.drive.free_stroke

    @property
    def force_share(self) -> float:
        """Force over blocking force [1]."""
        return self.force / self.drive.blocked_force

    @property
    def preload_stiffness(self) -> float:
        """Stiffness of the preload spring [N/m]."""
        return self.drive.preload.spring_stiffness if self.drive.preload else 0.0

    @property
    def stage_stiffness(self) -> float:
        """Stiffness of the stage at the stack, other drives in place [N/m]."""
        return self.force / self.stroke - self.preload_stiffness

    @property
    def lost_on_seats(self) -> float:
        """Part of the stroke by which the seats approach [m]."""
        return self.seat_approach(self.force)

    def seat_approach(self, force: float) -> float:
        """Return by how much the seats approach from rest under a force of the stack [m]."""
        return (
            self.drive.compression(force) - force / self.drive.stiffness
            if self.drive.seats
            else 0.0
        )

    def data(self) -> dict[str, Any]:
        """Return the working line as plain data."""
        return picked(self, *_KEYS)


def working_lines(stage: Stage, system: MechanicalSystem) -> tuple[WorkingLine, ...]:
    """Return the working line of each stack of a stage, with all other drives at rest in place.

    Parameters
    ----------
    stage : Stage
        The stage.
    system : MechanicalSystem
        A model of it.

    Returns
    -------
    tuple of WorkingLine
        One of each stack.

    Raises
    ------
    ModelError
        Two drives are redundant, or the stage is a mechanism.

    Notes
    -----
    Validity: as `static_drives`.
    """
    lines = []
    for drive in stage.drives:
        if isinstance(drive, PiezoStack):
            state = static_drives(stage, system, {drive.name: drive.free_stroke})
            there = state.drives[drive.name]
            lines.append(
                WorkingLine(
                    drive=drive,
                    stroke=there.elongation,
                    force=there.force,
                    contact_force=there.contact_force,
                )
            )
    return tuple(lines)
