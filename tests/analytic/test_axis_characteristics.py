"""The figures that are quoted of a stage, on a body whose compliance is known by hand."""

from dataclasses import replace

import numpy as np
import pytest

from flexstage.base.provenance import content_hash
from flexstage.lumped import lumped_system
from flexstage.quantities.material import material
from flexstage.report.findings import summary
from flexstage.report.notebook.show import headline
from flexstage.stage import Axis, Body, Loop, PiezoStack, Probe, Stage
from flexstage.stage.designs import design
from flexstage.studies import run_study
from flexstage.system import (
    MechanicalSystem,
    ModalDamping,
    analyse,
    static_displacements,
)
from flexstage.system.characteristics import axis_mode
from flexstage.system.mechanical import (
    AxisPort,
    BodyPort,
    DrivePort,
    LoadPort,
    ProbePort,
)
from flexstage.system.stress_map import StressMap

# one body on springs that couple x, y and its rotation; y is softer, so its mode comes first
K = np.array([[9.0e5, 4.0e4, 700.0], [4.0e4, 2.0e5, -900.0], [700.0, -900.0, 60.0]])
M = np.diag([0.21, 0.21, 3.0e-6])
STROKE, STEP = 42e-6, 0.3e-6
STRESS = np.array([[2.0e12, 1.0e11, 4.0e9], [-3.0e12, 2.0e11, 1.0e9], [1.0e11, 5.0e12, 0.0]])
PLATE = Loop(((0.0, 0.0), (0.03, 0.0), (0.03, 0.02), (0.0, 0.02)))


def system() -> MechanicalSystem:
    x, y, _ = np.eye(3)
    return MechanicalSystem(
        name="body",
        model="lumped",
        M=M,
        K=K,
        coordinates=("x [m]", "y [m]", "rotation [rad]"),
        drives=(
            DrivePort(
                name="a", vector=2.0 * x, stiffness=None, stroke=STROKE, smallest_displacement=STEP
            ),
            DrivePort(name="b", vector=y, stiffness=3e6, stroke=STROKE),
        ),
        probes=(
            ProbePort(name="p", vector=x, body="body"),
            ProbePort(name="q", vector=y, body="body"),
        ),
        bodies=(BodyPort(name="body", centre=(0.0, 0.0), matrix=np.eye(3)),),
        stress=StressMap(hinges=("h", "g"), matrix=STRESS, owner=np.array([0, 0, 1])),
        axes=(
            AxisPort(name="x", drives=("a",), probe="p"),
            AxisPort(name="y", drives=("b",), probe="q"),
        ),
        damping=ModalDamping(ratio=0.01),
    )


def stage() -> Stage:
    return Stage(
        name="body",
        thickness=0.01,
        material=material("Ti-6Al-4V"),
        bodies=(Body(name="body", outline=PLATE),),
    )


def test_every_figure_of_an_axis() -> None:
    found = analyse(stage(), system()).characteristics
    # the drive of x has a lever of 2: its elongation is twice the displacement
    q = np.linalg.inv(K)[:, 0]
    q = q / q[0] * STROKE / 2
    value = {r.quantity: r.value for r in found.select(axis="x")}
    assert value["output_displacement"] == pytest.approx(STROKE / 2, rel=1e-12)
    assert value["transmission_ratio"] == pytest.approx(0.5, rel=1e-12)
    assert value["resolution"] == pytest.approx(STEP / 2, rel=1e-12)
    assert value["cross_coupling"] == pytest.approx(q[1] / q[0], rel=1e-10)
    assert value["parasitic_rotation"] == pytest.approx(q[2], rel=1e-10)
    stress = np.abs(STRESS @ q).max()
    assert value["max_stress"] == pytest.approx(stress, rel=1e-10)
    assert value["safety_factor"] == pytest.approx(880e6 / stress, rel=1e-10)
    stiffness = 1.0 / np.linalg.inv(K)[0, 0] / 4
    assert value["input_stiffness"] == pytest.approx(stiffness, rel=1e-10)
    # a stack has no smallest step
    assert not found.select("resolution", "y")
    # the resonance of an axis is that of the mode that moves it, not the lowest
    omega = np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)).real)
    low, middle, _ = np.sort(omega) / (2 * np.pi)
    assert found.value("natural_frequency_hz", "y") == pytest.approx(low, rel=1e-9)
    assert found.value("natural_frequency_hz", "x") == pytest.approx(middle, rel=1e-9)


def test_what_weight_and_temperature_do_to_a_probe() -> None:
    loads = (
        LoadPort(name="gravity x", vector=np.array([2.0, 0.0, 0.01]), unit="g"),
        LoadPort(name="gravity y", vector=np.array([0.3, 5.0, 0.0]), unit="g"),
        LoadPort(name="temperature", vector=np.array([7.0, -3.0, 0.02]), unit="K"),
    )
    angle = 0.6  # the weight falls along the probe, which reads x
    read = Probe(name="p", body="body", at=(0.0, 0.0), direction=angle)
    other = Probe(name="q", body="body", at=(0.0, 0.0), direction=np.pi / 2)
    rows = analyse(replace(stage(), probes=(read, other)), replace(system(), loads=loads))
    value = {r.quantity: r.value for r in rows.characteristics.select(axis="x")}
    # drive a is rigid and holds x, so the sag is nothing there; of y it is what b leaves
    assert abs(value["gravity_sag"]) < 1e-18
    held = K[1:, 1:] + np.diag([3e6, 0.0])
    sag = np.linalg.solve(held, loads[1].vector[1:])[0]
    assert rows.characteristics.value("gravity_sag", "y") == pytest.approx(sag, rel=1e-9)
    drift = np.linalg.solve(K, loads[2].vector)
    assert value["thermal_drift"] == pytest.approx(drift[0], rel=1e-10)
    # x is held by a rigid drive, so it has no stiffness to quote; y works against spring b
    assert "output_stiffness" not in value
    stiffness = 1.0 / np.linalg.inv(held)[0, 0]
    assert rows.characteristics.value("output_stiffness", "y") == pytest.approx(
        stiffness, rel=1e-10
    )
    # a stroke from nothing to full: half of the stress swings about the other half
    stress = value["max_stress"]
    fatigue = 1.0 / (stress / 2 / stage().material.fatigue_limit + stress / 2 / 880e6)
    assert value["fatigue_safety"] == pytest.approx(fatigue, rel=1e-12)


def test_stress_is_averaged_between_the_elements_about_a_point() -> None:
    # two elements share a point; hand-made components, so von Mises is known
    one = np.zeros((3, 6, 1))
    one[0, 0, 0], one[1, 0, 0] = 90.0, 110.0  # tension of 90 and 110 at the shared point
    one[2, 5, 0] = 40.0  # shear of 40 elsewhere: sqrt(3) 40 = 69.3
    found = StressMap(
        hinges=("h",), matrix=one, owner=np.zeros(3, dtype=int), point=np.array([0, 0, 1])
    )
    assert found.largest(np.array([-2.0])) == pytest.approx({"h": 200.0})
    assert found.scatter(np.array([-2.0])) == pytest.approx({"h": 20.0})
    shear = replace(found, matrix=one[2:], owner=np.zeros(1, dtype=int), point=np.array([0]))
    assert shear.largest(np.array([1.0]))["h"] == pytest.approx(np.sqrt(3.0) * 40.0)


def test_ratio_and_coupling_keep_their_sign() -> None:
    turned = replace(system(), probes=(replace(system().probes[0], vector=-np.eye(3)[0]),
                                       system().probes[1]))  # fmt: skip
    rows = analyse(stage(), turned).characteristics
    assert rows.value("transmission_ratio", "x") == pytest.approx(-0.5)
    assert rows.value("resolution", "x") == pytest.approx(STEP / 2)


def test_a_hash_sees_every_number_and_name() -> None:
    first = stage()
    assert content_hash(first) == content_hash(stage())
    others = (
        replace(first, thickness=np.nextafter(0.01, 1.0).item()),
        replace(first, name="other"),
        replace(first, bodies=(replace(first.bodies[0], fixed=True),)),
        replace(first, material=material("Invar 36")),
    )
    assert len({content_hash(s) for s in (first, *others)}) == 5


def test_a_relative_probe_reads_the_difference_at_its_point() -> None:
    from flexstage.lumped import lumped_system

    # two loose plates: only the kinematics is asked for
    near = Body(name="near", outline=PLATE)
    far = Body(name="far", outline=PLATE.mapped(lambda p: (p[0] + 0.05, p[1])))
    at = (0.041, 0.013)
    pair = Stage(
        name="pair",
        thickness=0.01,
        material=material("Al 7075-T6"),
        bodies=(near, far),
        drives=(
            PiezoStack(
                name="s",
                pushes="far",
                reacts="near",
                at=((0.05, 0.01), (0.03, 0.01)),
                direction=0.0,
                free_stroke=1e-5,
                stiffness=1e7,
            ),
        ),
        probes=(Probe(name="p", body="far", at=at, direction=np.pi / 2, relative_to="near"),),
        axes=(Axis(name="y", drive="s", probe="p"),),
    )
    vector = lumped_system(pair).probes[0].vector
    # centres at x = 15 and 65 mm: y - y', and the lever arms of the two rotations
    expected = [0.0, -1.0, -(at[0] - 0.015), 0.0, 1.0, at[0] - 0.065]
    assert vector == pytest.approx(expected, abs=1e-15)


def driven_at(*angles: float, probes: tuple[float, ...] = (0.0, np.pi / 2)) -> MechanicalSystem:
    """The body with a drive at each angle, through its middle, and an axis for each probe."""
    names = "abcd"[: len(angles)]

    def row(angle: float) -> np.ndarray:
        return np.array([np.cos(angle), np.sin(angle), 0.0])

    return replace(
        system(),
        drives=tuple(
            DrivePort(name=n, vector=row(a), stiffness=None, stroke=STROKE)
            for n, a in zip(names, angles, strict=True)
        ),
        probes=tuple(
            ProbePort(name=f"p{k}", vector=row(a), body="body") for k, a in enumerate(probes)
        ),
        axes=tuple(
            AxisPort(name=n, drives=(d,), probe=f"p{k}")
            for k, (n, d) in enumerate(zip("xyz", names, strict=False))
        ),
    )


def seen(of: MechanicalSystem) -> Stage:
    """The stage of such a system, as far as its figures need one."""
    probes = tuple(Probe(name=p.name, body="body", at=(0.0, 0.0), direction=0.0) for p in of.probes)
    return replace(stage(), probes=probes)


def percent_of_little(of: MechanicalSystem, axis: str) -> float:
    """What used to be printed: the other axis over this one, whatever that is, its drive alone."""
    port = next(a for a in of.axes if a.name == axis)
    other = next(a for a in of.axes if a.name != axis)
    read = static_displacements(of, {port.drive: 1e-6}).readings
    return 100.0 * read[other.probe] / read[port.probe]


def test_no_cross_coupling_in_percent_of_nothing() -> None:
    """A drive that moves the other axis 800 times as far as its own was said to couple -80 854 %.

    K has almost no cross-compliance when x and y are its own directions, so that the angle of the
    drive makes that figure.
    """
    plain = replace(driven_at(0.0, np.pi / 2 + 0.3), K=np.diag((9e5, 9e5, 60.0)))
    angle = np.pi / 2 + 1.0 / 808.54
    askew = replace(driven_at(angle, angle - 1.2), K=plain.K)
    assert percent_of_little(askew, "x") == pytest.approx(-80854.0, rel=1e-4)
    rows = analyse(seen(askew), askew).characteristics
    assert all(abs(row.value) < 1.0 for row in rows.select("cross_coupling"))
    # both drives together move x alone, until one of them is at the end of its stroke
    reach = STROKE / max(abs(np.cos(angle)), abs(np.cos(angle - 1.2)))
    assert rows.value("output_displacement", "x") == pytest.approx(reach, rel=1e-9)


@pytest.mark.parametrize("turned", [0.25 * np.pi, -0.25 * np.pi, 0.62])
def test_drives_askew_to_the_probes_are_decoupled(turned: float) -> None:
    """Two drives at right angles, turned against the probes: J is the matrix of that rotation.

    An axis alone then takes its share of both, cos and sin, and the larger one ends it.
    """
    made = driven_at(turned, turned + np.pi / 2)
    found = analyse(seen(made), made)
    assert found.coupling is not None
    assert found.coupling.coupled
    c, s = np.cos(turned), np.sin(turned)
    assert found.coupling.jacobian == pytest.approx(np.array([[c, -s], [s, c]]), abs=1e-12)
    rows = found.characteristics
    for axis in "xy":
        reach = STROKE / max(abs(c), abs(s))
        assert rows.value("output_displacement", axis) == pytest.approx(reach, rel=1e-9)
        assert abs(rows.value("cross_coupling", axis)) < 1e-12
    assert rows.value("condition_number", "stage") == pytest.approx(1.0)
    assert rows.value("isotropy", "stage") == pytest.approx(1.0)
    assert rows.value("workspace_area", "xy") == pytest.approx(STROKE**2, rel=1e-9)


def test_a_little_askew_is_cross_coupling_as_before() -> None:
    """Below half the axes are looked at one by one; the limit is where tan(turn) = 1/2."""
    for turned, coupled in ((0.463, False), (0.4645, True)):
        made = driven_at(turned, turned + np.pi / 2)
        assert analyse(seen(made), made).coupling.coupled is coupled
    made = driven_at(0.2, 0.2 + np.pi / 2)
    rows = analyse(seen(made), made).characteristics
    assert 100.0 * rows.value("cross_coupling", "x") == pytest.approx(percent_of_little(made, "x"))


def test_axes_that_name_each_others_drives_are_called_coupled() -> None:
    """The rule is fooled by a stage of which nothing couples: it is decoupled all the same."""
    made = driven_at(np.pi / 2, 0.0)
    found = analyse(seen(made), made)
    assert found.coupling.coupled
    assert np.abs(found.coupling.jacobian) == pytest.approx(np.array([[0, 1], [1, 0]]), abs=1e-12)
    assert found.characteristics.value("output_displacement", "x") == pytest.approx(STROKE)


def test_drives_that_cannot_be_told_apart_leave_absolute_figures() -> None:
    """Both along x: y is moved by what K couples, too little to be measured by."""
    made = driven_at(0.0, 0.0)
    made = replace(
        made, drives=(made.drives[0], replace(made.drives[1], stiffness=2e6)), K=np.diag(np.diag(K))
    )
    rows = analyse(seen(made), made).characteristics.select(axis="y")
    assert not rows.select("cross_coupling")
    assert rows.value("cross_displacement", "y") == pytest.approx(STROKE, rel=1e-9)


def test_a_rotation_is_in_radians() -> None:
    """Three drives about a body: figures of the rotation by hand from K, M and the arms."""
    arm = 17e-3
    rows = [(1.0, 0.0, 0.4 * arm), (0.0, 1.0, -0.7 * arm), (0.6, 0.8, arm)]
    base = system()
    made = replace(
        base,
        drives=tuple(
            DrivePort(
                name=n,
                vector=np.array(r),
                stiffness=None,
                stroke=STROKE,
                smallest_displacement=STEP,
            )
            for n, r in zip("abc", rows, strict=True)
        ),
        probes=(
            *base.probes,
            ProbePort(name="turn", vector=np.eye(3)[2], unit="rad", body="body"),
        ),
        axes=tuple(
            AxisPort(name=n, drives=("a", "b", "c"), probe=p)
            for n, p in (("x", "p"), ("y", "q"), ("theta", "turn"))
        ),
    )
    described = replace(
        stage(),
        drives=tuple(
            PiezoStack(
                name=n,
                pushes="body",
                reacts="body",
                at=((x, y), (0.0, 0.0)),
                direction=0.0,
                free_stroke=STROKE,
                stiffness=1e7,
            )
            for n, x, y in (("a", 6e-3, 8e-3), ("b", 12e-3, 5e-3), ("c", 0.0, 2e-3))
        ),
        probes=(
            Probe(name="p", body="body", at=(0.0, 0.0), direction=0.0),
            Probe(name="q", body="body", at=(0.0, 0.0), direction=np.pi / 2),
            Probe(name="turn", body="body", at=(0.0, 0.0), reads="rotation"),
        ),
    )
    found = analyse(described, made)
    # distances of the pushed points from the probe: 10, 13 and 2 mm
    assert found.coupling.length == pytest.approx(25e-3 / 3.0)
    J = np.linalg.inv(np.array(rows))
    value = {r.quantity: r.value for r in found.characteristics.select(axis="theta")}
    W = np.array(rows)
    assert value["rotation_stroke"] == pytest.approx(STROKE / np.abs(W[:, 2]).max(), rel=1e-9)
    assert value["rotation_resolution"] == pytest.approx(STEP * np.abs(J[2]).max(), rel=1e-9)
    assert {"output_displacement", "transmission_ratio", "gravity_sag"}.isdisjoint(value)
    assert abs(value["cross_displacement"]) < 1e-15
    # all three drives removed, the body turns on its springs: mode 3 has most of it
    lam, phi = np.linalg.eig(np.linalg.solve(M, K))
    phi = phi / np.sqrt(np.einsum("ij,ik,kj->j", phi, M, phi))
    force = K @ (np.linalg.inv(np.array(rows)) @ (W[:, 2]))
    mode = int(np.argmax(np.abs(phi[2] * (phi.T @ force)) / lam))
    assert value["effective_inertia"] == pytest.approx(1.0 / phi[2, mode] ** 2, rel=1e-9)
    assert value["natural_frequency_hz"] == pytest.approx(
        np.sqrt(lam[mode]) / (2.0 * np.pi), rel=1e-9
    )


def test_the_mass_that_moves_with_a_probe() -> None:
    """Of a body on separate springs it is its mass, and behind a lever of 3 a ninth of it."""
    made = replace(driven_at(0.0, np.pi / 2), K=np.diag(np.diag(K)))
    rows = analyse(seen(made), made).characteristics
    assert rows.value("effective_mass", "x") == pytest.approx(0.21)
    lever = replace(made, probes=tuple(replace(p, vector=3.0 * p.vector) for p in made.probes))
    rows = analyse(seen(made), lever).characteristics
    assert rows.value("effective_mass", "y") == pytest.approx(0.21 / 9.0)


@pytest.mark.parametrize("turned", [0.0, 0.4, 1.3])
def test_the_mass_that_moves_does_not_depend_on_how_equal_modes_are_mixed(turned: float) -> None:
    """Two modes of one frequency have no direction of their own: any probe moves the whole body.

    The probes are turned against the coordinates, along which a solver returns the two.
    """
    made = driven_at(turned, turned + np.pi / 2, probes=(turned, turned + np.pi / 2))
    made = replace(made, K=np.diag((9e5, 9e5 * (1.0 + 1e-6), 60.0)))
    rows = analyse(seen(made), made).characteristics
    for axis in "xy":
        assert rows.value("effective_mass", axis) == pytest.approx(0.21)


def test_size_and_mass_of_the_whole() -> None:
    rows = analyse(stage(), system()).characteristics.select(axis="stage")
    value = {r.quantity: r.value for r in rows}
    assert value["width"] == pytest.approx(30e-3)
    assert value["height"] == pytest.approx(20e-3)
    assert value["thickness"] == 0.01
    mass = 0.03 * 0.02 * 0.01 * material("Ti-6Al-4V").density
    assert value["mass"] == pytest.approx(mass)
    assert value["moving_mass"] == pytest.approx(mass)


def test_the_stress_of_one_hinge_is_that_of_the_whole_map() -> None:
    rng = np.random.default_rng(3)
    whole = StressMap(
        hinges=("a", "b", "c"),
        matrix=rng.normal(size=(12, 6, 4)),
        owner=np.array([2, 0, 0, 1, 1, 2, 2, 0, 1, 2, 0, 1]),
        point=np.array([5, 0, 0, 2, 2, 5, 4, 1, 3, 4, 1, 3]),
    )
    q = rng.normal(size=4)
    for name in whole.hinges:
        one = whole.of(name)
        assert one.largest(q) == {name: whole.largest(q)[name]}
        assert one.scatter(q) == {name: whole.scatter(q)[name]}


def test_an_own_piezo_stage_has_its_frequency_without_and_with_stack() -> None:
    stage = design("bridge")
    made = analyse(stage, lumped_system(stage))
    (bare,) = made.characteristics.select("natural_frequency", "y")
    (driven,) = made.characteristics.select("natural_frequency_with_stack", "y")
    assert "without stack" in bare.note
    assert "with stack" in driven.note
    mode = axis_mode(made.system, made.modes["in place"], "y", "y")
    assert driven.value == made.modes["in place"].frequency_hz[mode] > 2.0 * bare.value
    # they stand beside each other in every table and sentence
    quantities = [row.quantity for row in made.characteristics]
    at = quantities.index("natural_frequency_hz")
    assert quantities[at + 1] == "natural_frequency_with_stack_hz"
    shown = {line.partition(":")[0].strip() for line in headline(made.characteristics)}
    assert {"natural frequency", "natural frequency with stack"} <= shown
    motion = next(s for s in summary(run_study(stage)) if s.startswith("Motion"))
    assert (
        f"without stack {bare.value:.1f} Hz in y, with stack {driven.value:.0f} Hz in y" in motion
    )
    # a screw has no such choice, and a published frequency says its own condition
    for name in ("parallelogram", "vgtu-piezo"):
        rows = analyse(design(name), lumped_system(design(name))).characteristics
        assert not rows.select("natural_frequency_with_stack")
    assert analyse(
        replace(design("vgtu-piezo"), published=()), lumped_system(design("vgtu-piezo"))
    ).characteristics.select("natural_frequency_with_stack", "x")
