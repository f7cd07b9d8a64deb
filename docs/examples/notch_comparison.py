r"""One length, one neck, several contours: how stiff a notch is, and how far it may turn.

Under a moment M a notch of height h(x) turns by

    theta = integral of 12 M / (E b h(x)^3) dx

by beam theory; the stress at its neck is K 6 M/(b t^2). So what a contour gives in rotation before
it yields is

    theta_max = sigma_y b t^2 / (6 K) * C_tt,

with the compliance C_tt = theta/M (and 1/sqrt(1 - nu + nu^2) more for
a wide neck, which is in plane strain).
A long flat neck turns furthest and holds the centre of rotation worst: that is what the root of its
rotational over its shear stiffness, a length, tells. `wedge` is the integral corrected for stress
that needs length to spread.
"""

from flexstage.hinges import (
    CornerFilleted,
    Elliptical,
    Parabolic,
    RightCircular,
    compliance,
    largest_rotation,
)
from flexstage.quantities.material import material

NECK, HALF_LENGTH, WIDTH = 0.4e-3, 2.0e-3, 10e-3


def main() -> dict[str, tuple[float, float, float, float]]:
    """Print a table, and return its rows.

    For each contour: rotational stiffness by beam theory and by `wedge` [N m/rad], largest rotation
    before yield [mrad], length from rotational and shear stiffness [mm].
    """
    common = {"half_length": HALF_LENGTH, "notch_depth": 1.5e-3}
    contours = {
        "circular": RightCircular(neck_thickness=NECK, radius=HALF_LENGTH),
        "elliptical": Elliptical(neck_thickness=NECK, **common),
        "parabolic": Parabolic(neck_thickness=NECK, **common),
        "corner-filleted": CornerFilleted(
            neck_thickness=NECK, notch_length=2.0 * HALF_LENGTH, fillet_radius=0.5e-3
        ),
    }
    metal = material("Al 7075-T6")
    elastic = (metal.youngs_modulus, metal.poissons_ratio, WIDTH)
    rows = {}
    print(f"{'':16s} {'beam':>8s} {'wedge':>8s} N m/rad {'yield at':>9s} mrad {'length':>8s} mm")
    for name, notch in contours.items():
        beam = 1.0 / compliance(notch, *elastic, method="timoshenko").matrix[2, 2]
        spring = compliance(notch, *elastic)
        turn = 1.0 / spring.matrix[2, 2]
        allowed = largest_rotation(notch, metal, WIDTH).before_yield
        assert allowed is not None
        length = (turn * spring.matrix[1, 1]) ** 0.5
        rows[name] = (float(beam), float(turn), allowed * 1e3, float(length) * 1e3)
        print("{:16s} {:8.3f} {:8.3f}         {:9.2f}      {:8.3f}".format(name, *rows[name]))
    return rows


if __name__ == "__main__":
    main()
