"""Thousands of stages at once give what one at a time gives, to the last bit whatever the batch."""

from dataclasses import replace

import array_api_strict
import numpy as np
import pytest
from scipy.linalg import eigh

from flexstage.base.errors import ModelError
from flexstage.lumped import (
    StageArrays,
    assemble_batch,
    lumped_characteristics,
    lumped_system,
    stage_arrays,
    system_tangents,
)
from flexstage.stage import Drive, Probe, Stage
from flexstage.stage.designs import DESIGNS, design
from flexstage.stage.drive import AnyActuator, ScrewActuator, VoiceCoil, placed
from flexstage.stage.model import Axis
from flexstage.system import (
    SystemBatch,
    analyse,
    batch_characteristics,
    characteristic_derivatives,
)
from flexstage.system.characteristics import strongest
from flexstage.system.statics import solve_stiffness
from tests.varied_stages import rounding, tangents_of_necks, varied


def _scattered(name: str, count: int, share: float = 0.02, seed: int = 5) -> StageArrays:
    """Arrays of samples of which nothing is like in another."""
    arrays, draw = stage_arrays([design(name)]), np.random.default_rng(seed)

    def scaled(x):
        size = (count, x.shape[1], *(1,) * (x.ndim - 2))
        return x * np.exp(share * draw.standard_normal(size))

    def moved(x, by):
        return x + by * draw.standard_normal((count, *x.shape[1:]))

    return replace(
        arrays,
        mass=scaled(arrays.mass),
        inertia=scaled(arrays.inertia),
        centre=moved(arrays.centre, 1e-5),
        hinge_at=moved(arrays.hinge_at, 1e-5),
        hinge_direction=moved(arrays.hinge_direction, 1e-3),
        hinge_stiffness=scaled(arrays.hinge_stiffness),
        drive_at=moved(arrays.drive_at, 1e-5),
        stroke=scaled(arrays.stroke),
        probe_direction=moved(arrays.probe_direction, 1e-3),
    )


# Stiff directions of hinges cancel in the soft modes, which leaves frequencies 1e-11 of rounding;
# the shapes of two modes 1 % apart, as three-rrr has them, then mix by a part in 1e9 either way.
_CLOSE = 1e-8


@pytest.mark.parametrize("name", DESIGNS)
def test_every_figure_of_a_batch_is_that_of_the_single_analysis(name: str) -> None:
    nominal = design(name)
    stages = [nominal, varied(nominal, 1), varied(nominal, 2)]
    found = batch_characteristics(assemble_batch(stage_arrays(stages)))
    for i, stage in enumerate(stages):
        every = analyse(stage, lumped_system(stage)).characteristics
        # a batch has modes without drives alone
        rows = [row for row in every if row.quantity != "natural_frequency_with_stack_hz"]
        assert list(found) == [(row.quantity, row.axis) for row in rows]
        for row in rows:
            value = found[row.quantity, row.axis][i]
            rel = _CLOSE if row.quantity.startswith("effective_") else 1e-9
            assert value == pytest.approx(row.value, rel=rel, abs=rounding(row.quantity)), row


_COIL = VoiceCoil(largest_force=2.0)
_SCREW = ScrewActuator(pitch=0.5e-3, smallest_step=1e-7, travel=1e-4)
_SOFT_SCREW = ScrewActuator(pitch=0.5e-3, smallest_step=1e-7, travel=1e-4, stiffness=3e6)


def _driven(name: str, *actuators: AnyActuator) -> Stage:
    """A design with other drives."""
    stage = varied(design(name), 4)

    def drive(old: Drive, actuator: AnyActuator) -> Drive:
        place = {f: getattr(old, f) for f in ("name", "pushes", "reacts", "at", "direction")}
        return placed(actuator, **place)

    return replace(stage, drives=tuple(map(drive, stage.drives, actuators)))


def _relative() -> Stage:
    """Probes that read against a lever, and a drive of no axis."""
    stage = varied(design("vgtu-piezo"), 4)
    lever = next(body.name for body in stage.bodies if not body.fixed)
    probes = tuple(replace(probe, relative_to=lever) for probe in stage.probes)
    return replace(stage, probes=probes, axes=stage.axes[:1])


def _read_from_the_platform() -> Stage:
    """A probe on the ground that reads the platform of x."""
    stage = varied(design("vgtu-piezo"), 4)
    ground = next(body.name for body in stage.bodies if body.fixed)
    x, *others = stage.probes
    return replace(stage, probes=(replace(x, body=ground, relative_to=x.body), *others))


def _redundant() -> Stage:
    """Three drives that move two axes: each motion is a linear programme."""
    stage = varied(design("three-rrr"), 4)
    return replace(stage, axes=stage.axes[:2])


def _turning() -> Stage:
    """Two drives that move two displacements and turn the platform."""
    stage = varied(design("gantry"), 4)
    x = stage.probe("x")
    probe = Probe(name="t", body=x.body, at=x.at, reads="rotation")
    axis = Axis(name="t", drive="x", probe="t")
    return replace(stage, probes=(*stage.probes, probe), axes=(*stage.axes, axis))


@pytest.mark.parametrize(
    ("build", "left_out"),
    [
        (lambda: _driven("parallelogram", _COIL), 0),
        (lambda: _driven("vgtu-piezo", _COIL, _SOFT_SCREW), 0),
        (lambda: _driven("three-rrr", _COIL, _SCREW, _SOFT_SCREW), 0),
        (_relative, 0),
        (_read_from_the_platform, 0),
        # every figure of the two axes, with stacks too; and of the other stage the workspace
        (_redundant, 28),
        (_turning, 1),
    ],
)
def test_other_drives_probes_and_axes_than_the_designs_have(build, left_out: int) -> None:
    stage = build()
    found = batch_characteristics(assemble_batch(stage_arrays([stage])))
    rows = {
        (r.quantity, r.axis): r.value for r in analyse(stage, lumped_system(stage)).characteristics
    }
    assert set(found) <= set(rows)
    assert len(rows) - len(found) == left_out
    for key, value in found.items():
        rel = _CLOSE if key[0].startswith("effective_") else 1e-9
        assert value[0] == pytest.approx(rows[key], rel=rel, abs=rounding(key[0])), key
    slopes = characteristic_derivatives(*system_tangents(tangents_of_necks(stage)))
    assert all(np.isfinite(slope).all() for slope in slopes.values())


@pytest.mark.parametrize("name", ["vgtu-piezo", "three-rrr", "parallelogram"])
def test_a_sample_has_the_same_bits_whatever_is_beside_it(name: str, monkeypatch) -> None:
    arrays = _scattered(name, 90)
    whole = lumped_characteristics(arrays)
    for start, stop in ((0, 1), (17, 18), (3, 12), (30, 89)):
        part = lumped_characteristics(arrays.part(start, stop))
        for key, value in whole.items():
            np.testing.assert_array_equal(part[key], value[start:stop])
    monkeypatch.setattr("flexstage.lumped.batch._AT_ONCE", 7)
    for key, value in lumped_characteristics(arrays).items():
        np.testing.assert_array_equal(value, whole[key])


@pytest.mark.parametrize("name", ["vgtu-mechanical", "three-rrr", "cartwheel"])
def test_a_strict_library_of_arrays_gives_the_same_bits(name: str) -> None:
    arrays = _scattered(name, 5)
    ours = lumped_characteristics(arrays)
    theirs = lumped_characteristics(arrays.mapped(array_api_strict.asarray))
    for key, value in ours.items():
        assert type(theirs[key]).__module__.startswith("array_api_strict")
        np.testing.assert_array_equal(np.asarray(theirs[key]), value)


def _dense(batch: SystemBatch, i: int) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and mass of one sample as full matrices."""
    mass = batch.mass[min(i, batch.mass.shape[0] - 1)]
    k = np.zeros((mass.size, mass.size))
    for (row, column), block in zip(batch.blocks, batch.stiffness[i], strict=True):
        k[3 * row : 3 * row + 3, 3 * column : 3 * column + 3] = block
        k[3 * column : 3 * column + 3, 3 * row : 3 * row + 3] = block.T
    return k, np.diag(mass)


@pytest.mark.parametrize(("share", "seed"), [(0.02, 1), (0.3, 2), (1.5, 5)])
def test_frequencies_are_right_however_far_a_sample_is_from_the_nominal_stage(
    share: float, seed: int
) -> None:
    # at the last another mode than the nominal one moves an axis of some, outside of the subspace
    batch = assemble_batch(_scattered("vgtu-piezo", 60, share, seed))
    keys = [(name, axis) for name in ("natural_frequency_hz", "effective_mass") for axis in "xy"]
    found = batch_characteristics(batch, keys)
    for i in range(60):
        k, m = _dense(batch, i)
        # of M against K, which knows the softest modes best; K against M errs by rounding of the
        # stiffest one, here up to 1e-8 of a first squared frequency
        inverse, shape = eigh(m, k)
        value = 1.0 / inverse[::-1]
        shape = shape[:, ::-1] * np.sqrt(value)
        for j, axis in enumerate("xy"):
            (body, _), row = batch.drive_bodies[j], batch.drive[i, j, 0]
            d = row @ shape[3 * body : 3 * body + 3]
            back, against = batch.drive_bodies[j][1], batch.drive[i, j, 1]
            if back >= 0:
                d = d + against @ shape[3 * back : 3 * back + 3]
            (body, _), row = batch.probe_bodies[j], batch.probe[i, j, 0]
            p = row @ shape[3 * body : 3 * body + 3]
            mode = np.argmax((np.abs(p * d) / value)[:12])
            expected = np.sqrt(value[mode]) / (2.0 * np.pi)
            # forty digits say that either is right to 2e-13
            assert found["natural_frequency_hz", axis][i] == pytest.approx(expected, rel=2e-12)
            mass = found["effective_mass", axis][i]
            assert mass == pytest.approx(1.0 / p[mode] ** 2, rel=1e-8)


@pytest.mark.parametrize("name", ["parallelogram", "vgtu-piezo"])
def test_a_mechanism_is_no_number_and_disturbs_no_sample_beside_it(name: str) -> None:
    arrays = _scattered(name, 6)
    stiffness = arrays.hinge_stiffness.copy()
    stiffness[2] = 0.0
    # all hinges of one body gone; on the guide, all that turn freely: rounding leaves tiny pivots
    body = arrays.stage.hinges[0].bodies[1]
    stiffness[4, [i for i, h in enumerate(arrays.stage.hinges) if body in h.bodies]] = 0.0
    if name == "parallelogram":
        stiffness[2] = arrays.hinge_stiffness[2]
        stiffness[2, :, 2, :] = stiffness[2, :, :, 2] = 0.0
    broken = lumped_characteristics(replace(arrays, hinge_stiffness=stiffness))
    for key, value in lumped_characteristics(arrays).items():
        described = key[0] in ("mass", "moving_mass", "width", "height", "thickness")
        good = [0, 1, 3, 5]
        np.testing.assert_array_equal(broken[key][good], value[good])
        assert np.isnan(broken[key][[2, 4]]).all() != described


@pytest.mark.parametrize("name", ["parallelogram", "stacked-xy", "bridge"])
def test_pins_are_refused_whatever_pivots_rounding_leaves(name: str) -> None:
    # of 60 guides whose necks turn freely 16 have a factor, with pivots of up to 1e-8
    arrays = _scattered(name, 300)
    stiffness = arrays.hinge_stiffness.copy()
    stiffness[:, :, 2, :] = stiffness[:, :, :, 2] = 0.0
    batch = assemble_batch(replace(arrays, hinge_stiffness=stiffness))
    key = ("input_stiffness", arrays.stage.axes[0].name)
    assert np.isnan(batch_characteristics(batch, [key])[key]).all()
    for i in range(60):
        k, _ = _dense(batch, i)
        with pytest.raises(ModelError, match="without deforming a hinge"):
            solve_stiffness(0.5 * (k + k.T), np.eye(len(k))[:, :1], np.zeros((len(k), 0)))


@pytest.mark.parametrize("name", DESIGNS)
def test_necks_of_a_hundredth_of_the_usual_ones_make_no_mechanism(name: str) -> None:
    # of 3 to 14 um, thinner than any that is cut: K is positive definite, and both say so
    stage = varied(design(name), 3, share=0.0)
    thin = [
        replace(h.profile, neck_thickness=0.01 * h.profile.neck_thickness) for h in stage.hinges
    ]
    hinges = tuple(replace(h, profile=p) for h, p in zip(stage.hinges, thin, strict=True))
    stage = replace(stage, hinges=hinges)
    arrays = stage_arrays([stage], method="euler-bernoulli")
    key = ("natural_frequency_hz", stage.axes[0].name)
    rows = analyse(stage, lumped_system(stage, method="euler-bernoulli")).characteristics
    found = lumped_characteristics(arrays, [key])[key][0]
    assert found == pytest.approx(rows.value(*key), rel=1e-4)


def test_a_stage_whose_axes_are_coupled_otherwise_than_the_nominal_one_is_no_number() -> None:
    arrays = stage_arrays([design("vgtu-piezo")])
    # a probe of x that reads along y as much as along x: each drive moves both axes
    turned = arrays.probe_direction + np.array([[0.0, 0.0], [0.8, 0.0]])[:, :2]
    found = lumped_characteristics(replace(arrays, probe_direction=turned))
    value = found["transmission_ratio", "y"]
    assert np.isfinite(value[0])
    assert np.isnan(value[1])


def test_what_a_batch_does_not_know_it_says() -> None:
    batch = assemble_batch(stage_arrays([design("parallelogram")]))
    with pytest.raises(ModelError, match=r"does not give stroke of x.*transmission_ratio of x"):
        batch_characteristics(batch, [("stroke", "x")])
    with pytest.raises(ModelError, match="is not of the topology of 'parallelogram'"):
        stage_arrays([design("parallelogram"), design("bridge")])
    with pytest.raises(ModelError, match="at least one stage"):
        stage_arrays([])


def test_of_modes_that_give_as_much_the_lowest_is_that_of_the_axis() -> None:
    # both modes of two axes that are alike: rounding alone says which gives more
    shares = np.array([1e-9, 0.49999, 0.50001, np.nan, 0.2])
    assert strongest(shares) == strongest(shares[[0, 2, 1, 3, 4]]) == 1
    assert strongest(shares * [1.0, 0.99, 1.0, 1.0, 1.0]) == 2
