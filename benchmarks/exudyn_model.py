"""A mechanism built in EXUDYN, from its own bodies, markers and joint springs.

Nothing of our matrices goes in: EXUDYN gets masses, centres, neck positions and the 3 x 3 stiffness
of each hinge, and derives and linearises the equations itself.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from flexstage.base.arrays import Array
from flexstage.lumped import Mechanism

__all__ = ["ExudynModel"]


class ExudynModel:
    """A mechanism in EXUDYN, with a force at some drives."""

    def __init__(self, mechanism: Mechanism, forces: Mapping[str, float] | None = None) -> None:
        import exudyn
        from exudyn import itemInterface as item  # noqa: N813

        self.mechanism = mechanism
        self._exudyn = exudyn
        self._container = exudyn.SystemContainer()
        self.system: Any = self._container.AddSystem()
        system = self.system
        ground = system.AddObject(item.ObjectGround())
        self.nodes: list[Any] = []
        objects: list[tuple[Any, tuple[float, float]]] = []
        for body in mechanism.bodies:
            if body.fixed:
                objects.append((ground, (0.0, 0.0)))
                continue
            node = system.AddNode(item.NodeRigidBody2D(referenceCoordinates=[*body.centre, 0.0]))
            self.nodes.append(node)
            made = system.AddObject(
                item.ObjectRigidBody2D(mass=body.mass, inertia=body.inertia, nodeNumber=node)
            )
            objects.append((made, body.centre))

        def marker(body: int, point: tuple[float, float], turn: Array) -> Any:
            number, centre = (ground, (0.0, 0.0)) if body < 0 else objects[body]
            place = np.eye(4)
            place[:3, :3] = turn
            place[:2, 3] = np.subtract(point, centre)
            return system.AddMarker(item.MarkerBodyRigid(bodyNumber=number, localHT=place))

        plane = np.ix_([0, 1, 5], [0, 1, 5])
        for hinge in mechanism.hinges:
            c, s = np.cos(hinge.direction), np.sin(hinge.direction)
            turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
            stiffness = np.zeros((6, 6))
            stiffness[plane] = hinge.stiffness
            system.AddObject(
                item.ObjectConnectorRigidBodySpringDamper(
                    markerNumbers=[marker(b, hinge.at, turn) for b in hinge.bodies],
                    stiffness=stiffness,
                    damping=np.zeros((6, 6)),
                )
            )
        for name, force in (forces or {}).items():
            drive = mechanism.drive(name)
            along = force * np.array([np.cos(drive.direction), np.sin(drive.direction), 0.0])
            for side, sign in ((0, -1.0), (1, 1.0)):
                where = marker(drive.bodies[side], drive.points[side], np.eye(3))
                system.AddLoad(item.Force(markerNumber=where, loadVector=list(sign * along)))
        system.Assemble()

    def frequencies(self) -> Array:
        """Natural frequencies of the unloaded mechanism [Hz], lowest first."""
        settings = self._exudyn.SimulationSettings()
        values = self.system.ComputeODE2Eigenvalues(
            simulationSettings=settings, convert2Frequencies=True
        )[0]
        return np.sort(np.asarray(values))

    def static(self, *, steps: int = 1, tolerance: float = 1e-10) -> Array:
        """Coordinates in equilibrium with the forces, with finite rotations, shape (n,)."""
        settings = self._exudyn.SimulationSettings()
        settings.staticSolver.numberOfLoadSteps = steps
        settings.staticSolver.newton.relativeTolerance = tolerance
        settings.solution.file.write = False
        settings.staticSolver.verboseMode = 0
        self.system.SolveStatic(settings)
        return np.concatenate(
            [
                self.system.GetNodeOutput(node, self._exudyn.OutputVariableType.Coordinates)
                for node in self.nodes
            ]
        )
