"""Random stages for property tests; a new field or kind belongs in here too.

Numbers are awkward on purpose (many digits, tiny, asymmetric): the file must bring back every bit.
The stages are well formed but need not be buildable: bodies may overlap.
"""

import math
import string

from hypothesis import strategies as st

from flexstage.hinges import AsDrawn, Profile, RightCircular
from flexstage.hinges.conic import Elliptical, Hyperbolic, Parabolic, PowerFunction
from flexstage.hinges.straight import CornerFilleted, Leaf, VFillet
from flexstage.quantities.characteristic import ORIGINS, Characteristic
from flexstage.quantities.material import CATALOGUE, Material
from flexstage.quantities.quantity import QUANTITIES
from flexstage.stage import (
    Axis,
    Bench,
    Body,
    Circle,
    Drive,
    ExtraMass,
    Force,
    Hinge,
    Loop,
    Manufacture,
    PiezoStack,
    Probe,
    Screw,
    Stage,
)
from flexstage.stage.drive import DriveHeat
from flexstage.stage.seat import BallSeat, FlatSeat, Preload, Seat, TipSeat

lengths = st.floats(1e-7, 0.9, allow_subnormal=False)
coordinates = st.one_of(
    st.floats(-0.9, 0.9), st.integers(-90_000, 90_000).map(lambda um: um * 1e-6), st.just(-0.0)
)
positive = st.floats(1e-12, 1e12, allow_subnormal=False)
points = st.tuples(coordinates, coordinates)
angles = st.one_of(
    st.floats(-4.0, 4.0), st.integers(-360, 360).map(math.radians), st.just(math.pi / 2)
)
# what YAML could take for something else, and what it must quote
names = st.one_of(
    st.sampled_from(
        [
            "no",
            "null",
            "1e5",
            "12:30",
            "0x1F",
            "- a",
            "a: b",
            "#",
            "~",
            "<<",
            "true",
            "Ä µ",
            "1.",
            "=",
        ]
    ),
    st.text(
        string.ascii_letters + string.digits + " _-.:'\"#&*!|>%@`{}[],?", min_size=1, max_size=12
    ),
    st.text(st.characters(exclude_categories=("C", "Z")), min_size=1, max_size=6),
).filter(lambda name: bool(name.strip()) and name.isprintable())
texts = st.text(st.characters(exclude_categories=("Cs",)), max_size=30)


@st.composite
def loops(draw: st.DrawFn) -> Loop:
    corners = tuple(draw(st.lists(points, min_size=3, max_size=7)))
    bulges = st.tuples(*(st.one_of(st.just(0.0), st.floats(-2.0, 2.0)) for _ in corners))
    return Loop(corners, draw(st.one_of(st.just(()), bulges)))


circles = st.builds(Circle, centre=points, radius=lengths)
coefficients = st.floats(-1e-5, 1e-4)
benches = st.builds(Bench, base=coefficients) | st.builds(
    Bench,
    base=coefficients,
    holder=coefficients,
    holder_length=lengths | lengths.map(lambda v: -v),
    temperature_change=st.none() | st.floats(1e-3, 50.0),
    film_coefficient=st.floats(0.1, 100.0),
    mount_conductance=st.none() | positive,
    air_change=st.floats(0.1, 30.0),
    base_change=st.floats(-30.0, 30.0),
    period=st.none() | positive,
)
heats = st.builds(
    DriveHeat,
    capacity=positive,
    conductance=positive,
    surface=st.floats(0.0, 1.0),
    power=st.none() | st.floats(0.0, 100.0),
)
extra_masses = st.builds(ExtraMass, mass=positive, at=points, inertia=st.floats(0.0, 1.0))


@st.composite
def profiles(draw: st.DrawFn) -> Profile:
    t, a, d = draw(st.floats(1e-4, 2e-3)), draw(st.floats(1e-3, 9e-3)), draw(st.floats(2e-3, 5e-3))
    common = {"neck_thickness": t, "one_sided": draw(st.booleans())}
    curved = {**common, "half_length": a, "notch_depth": d}
    choices = [
        lambda: RightCircular(**common, radius=a),
        lambda: Elliptical(**curved),
        lambda: Parabolic(**curved),
        lambda: Hyperbolic(**curved),
        lambda: PowerFunction(**curved, exponent=draw(st.floats(2.0, 8.0))),
        lambda: CornerFilleted(**common, notch_length=2.0 * a, fillet_radius=0.3 * a),
        lambda: Leaf(**common, leaf_length=a, notch_depth=d),
        lambda: AsDrawn(
            **common,
            distances=(0.4 * a, 0.7 * a, a),
            depths=(0.0, 0.3 * d, d),
            bulges=(0.0, draw(st.floats(0.0, 0.1)), 0.0),
        ),
        lambda: VFillet(
            **common,
            half_opening_angle=draw(st.floats(0.3, 1.2)),
            fillet_radius=0.2e-3,
            notch_depth=d,
        ),
    ]
    return draw(st.sampled_from(choices))()


materials = st.one_of(
    st.sampled_from(sorted(CATALOGUE.values(), key=lambda m: m.name)),
    st.builds(
        Material,
        name=names,
        youngs_modulus=st.floats(1e3, 1e14),
        poissons_ratio=st.floats(-0.9, 0.49),
        density=st.floats(1e-2, 1e5),
        yield_strength=st.none() | st.floats(1.0, 1e12),
        fatigue_limit=st.none() | st.floats(1.0, 1e12),
        fatigue_cycles=st.none() | positive,
        thermal_expansion=st.none() | st.floats(-1e-5, 1e-4),
        thermal_conductivity=st.none() | st.floats(1e-4, 1e5),
        specific_heat=st.none() | st.floats(1.0, 1e5),
        source=texts,
    ),
)


def seats() -> st.SearchStrategy[Seat]:
    return st.one_of(
        st.builds(
            BallSeat, radius=lengths, second_radius=st.none() | lengths, contact_modulus=positive
        ),
        st.builds(FlatSeat, roughness_length=lengths),
        st.builds(TipSeat, axial_stiffness=positive),
    )


def drives(name: str, bodies: list[str]) -> st.SearchStrategy[Drive]:
    common = {
        "name": st.just(name),
        "pushes": st.sampled_from(bodies),
        "reacts": st.sampled_from(bodies),
        "at": st.tuples(points, points),
        "direction": angles,
        "patch_half_width": lengths,
        "mass": st.none() | positive,
        "thermal_expansion": st.none() | st.floats(-1e-4, 1e-4),
        "length": st.none() | lengths,
        "heat": st.none() | heats,
    }
    seated = common | {
        "seats": st.lists(seats(), max_size=2).map(tuple),
        "preload": st.builds(Preload, force=positive, spring_stiffness=positive),
    }
    return st.one_of(
        st.builds(
            Screw,
            **seated,
            pitch=lengths,
            smallest_step=lengths,
            travel=lengths,
            stiffness=st.none() | positive,
        ),
        st.builds(
            PiezoStack,
            **seated,
            free_stroke=lengths,
            stiffness=positive,
            blocking_force=st.none() | positive,
            capacitance=st.none() | positive,
            voltage_range=st.none() | st.tuples(st.floats(-99.0, 0.0), st.floats(0.1, 999.0)),
        ),
        st.builds(Force, **common, largest_force=positive),
    )


characteristics = st.sampled_from(sorted(QUANTITIES)).flatmap(
    lambda quantity: st.builds(
        Characteristic,
        quantity=st.just(quantity),
        axis=names,
        origin=st.sampled_from(ORIGINS),
        value=st.floats(-1e9, 1e9, allow_subnormal=False),
        unit=st.just(QUANTITIES[quantity].unit),
        uncertainty=st.none() | positive,
        note=texts,
    )
)


@st.composite
def stages(draw: st.DrawFn) -> Stage:
    body_names = draw(st.lists(names, min_size=2, max_size=4, unique=True))
    bodies = tuple(
        Body(
            name=name,
            outline=draw(loops()),
            holes=tuple(draw(st.lists(st.one_of(loops(), circles), max_size=2))),
            mounting_holes=tuple(draw(st.lists(circles, max_size=2))),
            fixed=draw(st.booleans()),
            extra_masses=tuple(draw(st.lists(extra_masses, max_size=1))),
            material=draw(st.none() | materials),
            rigid=draw(st.booleans()),
        )
        for name in body_names
    )
    pairs = st.permutations(body_names).map(lambda order: (order[0], order[1]))
    hinges = tuple(
        Hinge(
            name=name,
            bodies=draw(pairs),
            at=draw(points),
            direction=draw(angles),
            profile=draw(profiles()),
        )
        for name in draw(st.lists(names, max_size=3, unique=True))
    )
    driven = tuple(
        draw(drives(name, body_names)) for name in draw(st.lists(names, max_size=2, unique=True))
    )
    probes = tuple(
        Probe(
            name=name,
            body=draw(st.sampled_from(body_names)),
            at=draw(points),
            relative_to=draw(st.none() | st.sampled_from(body_names)),
            **draw(st.fixed_dictionaries({"direction": angles}) | st.just({"reads": "rotation"})),
        )
        for name in draw(st.lists(names, max_size=2, unique=True))
    )
    axes = (
        (
            Axis(
                name=draw(names),
                drives=tuple(d.name for d in draw(st.sampled_from((driven, driven[:1])))),
                probe=probes[0].name,
            ),
        )
        if driven and probes
        else ()
    )
    return Stage(
        name=draw(names),
        title=draw(texts),
        thickness=draw(lengths),
        material=draw(materials),
        bodies=bodies,
        hinges=hinges,
        drives=driven,
        probes=probes,
        axes=axes,
        manufacture=draw(st.builds(Manufacture, wire_width=lengths, minimum_neck=lengths)),
        bench=draw(st.none() | benches),
        published=tuple(draw(st.lists(characteristics, max_size=2))),
        notes=tuple(draw(st.lists(texts, max_size=2))),
    )
