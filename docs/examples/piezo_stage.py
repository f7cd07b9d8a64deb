r"""The piezo-driven stage with its stacks in place: less stroke, more frequency.

A stack of stiffness k_s whose free displacement is w pushes a stage of stiffness k_in at its input.
Both carry the same force, so

    k_s (w - u) = k_in u    ->    u = w k_s/(k_s + k_in),

and only this part of the free stroke arrives. The characteristics of the study impose the free
stroke itself. In motion the equations are

    M q'' + C q' + (K + k_s d d^T) q = k_s d w(t),

with d the elongation of the stack for each coordinate: the stage is as stiff against its mass as K
and the stacks together, so its frequencies in place are far above those without drives.
"""

import numpy as np

from flexstage.lumped import lumped_system
from flexstage.stage.designs import design
from flexstage.system import (
    drive_stiffness,
    modes,
    static_displacements,
    static_forces,
    time_response,
)


def main() -> dict[str, float]:
    """Compute and return the figures of the x axis."""
    system = lumped_system(design("vgtu-piezo"))
    stack = system.drive("x")
    assert stack.stiffness is not None
    assert stack.stroke is not None
    k_in = drive_stiffness(system, "x", others="in place")
    share = stack.stiffness / (stack.stiffness + k_in)

    imposed = static_displacements(system, {"x": stack.stroke})
    in_place = static_forces(system, {"x": stack.stiffness * stack.stroke}, drives="in place")

    # the whole free stroke within 2 ms, then held
    time = np.linspace(0.0, 0.02, 2001)
    ramp = stack.stroke * np.clip(time / 2e-3, 0.0, 1.0)
    motion = time_response(system, time, {"x": ramp}).readings["x"]

    figures = {
        "share of the free stroke [%]": 100.0 * share,
        "elongation in place [um]": in_place.drive_displacement["x"] * 1e6,
        "output, stroke imposed [um]": imposed.readings["x"] * 1e6,
        "output, stack in place [um]": in_place.readings["x"] * 1e6,
        "overshoot after the ramp [%]": 100.0 * (motion.max() / in_place.readings["x"] - 1.0),
        "frequency, drives removed [Hz]": modes(system, drives="removed").frequency_hz[0],
        "frequency, in place [Hz]": modes(system, drives="in place").frequency_hz[0],
        "frequency, locked [Hz]": modes(system, drives="locked").frequency_hz[0],
    }
    for name, value in figures.items():
        print(f"{name:32s} {value:10.4g}")
    return {name: float(value) for name, value in figures.items()}


if __name__ == "__main__":
    main()
