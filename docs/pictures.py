"""The pictures of the index, and those of the pages that no command of the page draws.

``python -m docs.pictures [NAME ...]`` writes them into ``docs/images``; without names all of them.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np

from flexstage.report.figures.style import (
    CYCLE,
    FIXED,
    GRID,
    INK,
    MUTED,
    encode,
    new_figure,
)  # fmt: skip
from flexstage.stage.designs import DESIGNS, design

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from flexstage.experiments import VerifiedStep
    from flexstage.stage import Stage

IMAGES = Path(__file__).parent / "images"
_MM = 1e3
_CARD = (3.6, 2.4)


def card() -> tuple["Figure", "Axes"]:
    """A picture of the index: one drawing, no axes."""
    figure = new_figure(*_CARD)
    axes = figure.subplots()
    axes.set_axis_off()
    return figure, axes


def plate(
    axes: "Axes", stage: "Stage", *, moved: dict[str, tuple[float, float, float]] | None = None
) -> None:
    """Draw the bodies of a stage, in place or moved about their centres."""
    from matplotlib.patches import PathPatch
    from matplotlib.transforms import Affine2D

    from flexstage.report.figures.drawing import fill_of
    from flexstage.report.figures.shapes import body_shapes
    from flexstage.stage import mass_properties

    masses = mass_properties(stage)
    for shape in body_shapes(stage):
        name = shape.body.name
        x, y, angle = (moved or {}).get(name, (0.0, 0.0, 0.0))
        place = Affine2D()
        if moved and name in masses:
            centre = [_MM * c for c in masses[name].centre]
            place = place.rotate_around(*centre, angle).translate(_MM * x, _MM * y)
        fill = fill_of(stage, name)
        axes.add_patch(
            PathPatch(
                shape.path(), facecolor=fill, edgecolor=INK, linewidth=0.4,
                transform=place + axes.transData, zorder=1 if fill == FIXED else 2,
            )
        )  # fmt: skip
    axes.set_aspect("equal")
    axes.autoscale_view()


def ports(axes: "Axes", stage: "Stage", length: float) -> None:
    """Draw drives and probes as arrows of a length [mm]; a rotation that is read as a ring."""
    from matplotlib.patches import Circle

    def arrow(x: float, y: float, direction: float, size: float, colour: str) -> None:
        to = x + size * np.cos(direction), y + size * np.sin(direction)
        style = {"arrowstyle": "-|>", "color": colour, "lw": 1.8}
        axes.annotate("", to, (x, y), arrowprops=style, zorder=4)

    for drive in stage.drives:
        x, y = (0.5 * _MM * (a + b) for a, b in zip(*drive.at, strict=True))
        c, s = np.cos(drive.direction), np.sin(drive.direction)
        arrow(x - length * c, y - length * s, drive.direction, 2.0 * length, CYCLE[1])
    for probe in stage.probes:
        x, y = (_MM * c for c in probe.at)
        if probe.direction is None:
            ring = {"fill": False, "color": CYCLE[2], "linewidth": 1.4, "zorder": 4}
            axes.add_patch(Circle((x, y), 0.8 * length, **ring))
        else:
            arrow(x, y, probe.direction, 1.6 * length, CYCLE[2])


def card_stage() -> "Figure":
    """The piezo stage with its drives and probes."""
    figure, axes = card()
    stage = design("vgtu-piezo")
    plate(axes, stage)
    ports(axes, stage, 14.0)
    return figure


def one_design(name: str) -> "Figure":
    """A built-in design with its drives, its probes and the length of 10 mm."""
    figure, axes = card()
    stage = design(name)
    plate(axes, stage)
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    ports(axes, stage, 0.06 * max(x1 - x0, y1 - y0))
    low = y0 - 0.03 * (y1 - y0)
    axes.plot((x0, x0 + 10.0), (low, low), color=MUTED, linewidth=1.4)
    axes.annotate("10 mm", (x0 + 11.5, low), color=MUTED, fontsize=7.0, va="center")
    return figure


def card_mode() -> "Figure":
    """The first mode of the piezo stage, by rigid bodies."""
    from flexstage.lumped import lumped_system
    from flexstage.report.figures.body_motion import mode_motion
    from flexstage.system import modes

    stage = design("vgtu-piezo")
    system = lumped_system(stage)
    shape = modes(system, drives="removed", count=1).shapes[:, 0]
    size = 0.008  # largest displacement in the picture [m]
    motion = mode_motion(system, shape, stage)
    figure, axes = card()
    plate(axes, stage, moved={n: (size * x, size * y, size * a) for n, (x, y, a) in motion.items()})
    return figure


def card_hysteresis() -> "Figure":
    """Loops of a piezo stack within each other."""
    from flexstage.virtual import virtual_stack

    t = np.linspace(0.0, 7.0, 7000)
    size = np.interp(t, [0.0, 1.0, 7.0], [60.0, 60.0, 10.0])
    volts = 60.0 - size * np.cos(2.0 * np.pi * t)
    moved = virtual_stack((0.0, 120.0), 38e-6, 0.16).simulate(volts).values
    figure, axes = card()
    axes.plot(volts[1000:], 1e6 * moved[1000:], color=CYCLE[0], linewidth=1.3)
    return figure


def card_response() -> "Figure":
    """Frequency responses of both axes of the piezo stage, drives removed."""
    from flexstage.fem import superelement_model
    from flexstage.system import frequency_response

    system = superelement_model(design("vgtu-piezo")).system
    f = np.geomspace(60.0, 2000.0, 1200)
    figure, axes = card()
    for axis, colour in zip("xy", CYCLE, strict=False):
        axes.loglog(f, np.abs(frequency_response(system, f, axis, axis).value), color=colour)
    return figure


def card_centring() -> "Figure":
    """The error of an eccentric scale over a turn, before and after the move."""
    from flexstage.centring import ARCSEC, exact_error
    from flexstage.virtual import scale_errors

    theta = np.linspace(0.0, 2.0 * np.pi, 721)
    graduation = scale_errors(range(2, 20), 8.0 * ARCSEC, seed=3).at(theta)
    figure = new_figure(*_CARD)
    axes = figure.add_subplot(projection="polar")
    for place, colour in (((50e-6, -20e-6), CYCLE[1]), ((0.0, 0.0), CYCLE[0])):
        error = (exact_error(theta, place, 50e-3) + graduation) / ARCSEC
        axes.plot(theta, error, color=colour, linewidth=1.4)
    axes.plot(theta, 0.0 * theta, color=MUTED, linewidth=0.8, linestyle="--")
    axes.set(ylim=(-450.0, 280.0), xticklabels=[], yticklabels=[])
    axes.grid(color=GRID, linewidth=0.6)
    axes.spines["polar"].set_color(GRID)
    return figure


def _twin_steps(step: float, dwell: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Targets and readings of a staircase of the twin under position control."""
    from flexstage.instruments.connect import connect
    from flexstage.instruments.protocol import Signal, Waveform
    from flexstage.instruments.record_run import run_waveform

    rate, start = 1000.0, 30e-6
    levels = [0, 0, 1, 2, 3, 4, 3, 2, 1, 0]
    target = start + step * np.repeat(levels, round(dwell * rate)).astype(float)
    twin = connect("twin://vgtu-piezo?model=lumped&seed=3")
    try:
        x = twin.axes["x"]
        x.set_closed_loop(True)
        x.move_to(start)
        twin.pause(2.0)
        wave = Waveform(values={"x": target}, sample_rate_hz=rate, quantity="position")
        signal = Signal(kind="position", source="x", name="x")
        record = run_waveform(twin, wave, [signal], rate_hz=rate)
    finally:
        twin.close()
    return record.time, target, record.channel("x").values


def card_twin() -> "Figure":
    """Steps of 50 nm of the twin under position control: target, and what its sensor reads."""
    time, target, reading = _twin_steps(50e-9, 0.1)
    figure, axes = card()
    axes.plot(time, 1e9 * (reading - target[0]), color=CYCLE[0], linewidth=0.7)
    axes.plot(time, 1e9 * (target - target[0]), color=CYCLE[1], linewidth=1.2)
    return figure


def card_control() -> "Figure":
    """A step of a stage with a mode, plain and by a ZVD shaper."""
    from flexstage.control import shaped, shaper
    from flexstage.control.loop_plant import LoopPlant
    from flexstage.control.moves import MovePlant
    from flexstage.hysteresis import StageModes

    modes = StageModes(frequency_hz=[320.0], damping_ratio=[0.01])
    plant = LoopPlant(gain=1.0, gain_range=(1.0, 1.0), modes=modes)
    stage, step = MovePlant(plant, None, reading_delay=0.0, seconds=0.3), np.ones(1)
    figure, axes = card()
    for command, colour in (
        (step, CYCLE[1]),
        (shaped(step, [shaper("zvd", 320.0, 0.01)], plant.sample_rate_hz), CYCLE[0]),
    ):
        motion = stage.motion(command)
        early = motion.time < 0.03
        axes.plot(1e3 * motion.time[early], motion.position[early], color=colour, linewidth=1.2)
    return figure


def _cut() -> dict[str, list[np.ndarray]]:
    """Lines of the layers of the DXF of the piezo stage [mm]."""
    import io

    import ezdxf
    from ezdxf.path import make_path

    from flexstage.export import dxf_files

    (content,) = dxf_files(design("vgtu-piezo"), kerf=0.28e-3).values()
    drawing = ezdxf.read(io.StringIO(content.decode() if isinstance(content, bytes) else content))
    paths: dict[str, list[np.ndarray]] = {}
    for entity in drawing.modelspace():
        if entity.dxftype() in {"LWPOLYLINE", "LINE", "ARC", "CIRCLE"}:
            points = np.array([(p.x, p.y) for p in make_path(entity).flattening(0.01)])
            paths.setdefault(entity.dxf.layer, []).append(points)
    return paths


_LAYERS = {
    "OUTLINE": INK,
    "SLOTS": INK,
    "WIRE_PATH": CYCLE[1],
    "START_HOLES": CYCLE[0],
    "LEAD_IN": CYCLE[0],
}


def card_cut() -> "Figure":
    """The path of the wire about a lever."""
    figure, axes = card()
    cut = _cut()
    for layer, colour in _LAYERS.items():
        for points in cut[layer]:
            axes.plot(*points.T, color=colour, linewidth=1.1)
    axes.set_aspect("equal")
    axes.set(xlim=(-17.0, 14.0), ylim=(-18.0, 2.6))
    return figure


def guide() -> "Figure":
    """The guide of the first tutorial, as `flexstage show` draws it."""
    from flexstage.report.figures.drawing import draw_stage
    from flexstage.stage import read_stage
    from tests.meta.test_docs_snippets import run

    page = Path(__file__).parent / "tutorials" / "first-stage.md"
    with in_new_folder():
        run(page.read_text("utf-8"), page.name)
        return draw_stage(read_stage("guide.yaml"))


def piezo_stage() -> "Figure":
    """The piezo stage of the study, as `flexstage show` draws it."""
    from flexstage.report.figures.drawing import draw_stage

    return draw_stage(design("vgtu-piezo"))


def published_stages() -> "Figure":
    """The published stages and parts, the parts from a corner."""
    from matplotlib.collections import LineCollection

    from examples.published import parts
    from flexstage.elasticity.shapes import face
    from flexstage.fem.part import Part, part_surface
    from flexstage.stage import read_stage
    from tests.published_stages import arm_outline, gripper_outline

    figure = new_figure(9.0, 5.0)
    panels = iter(figure.subplots(3, 4).flat)
    for file in sorted((Path(parts.__file__).parent).glob("*.yaml")):
        axes = next(panels)
        plate(axes, read_stage(file))
        axes.set_title(file.stem.replace("-", " "), fontsize=7.0)
    shapes = {name: make() for name, make in parts.PARTS.items()}
    for name, outline in (("gripper", gripper_outline()), ("arm on two beams", arm_outline())):
        shapes[name] = face(*outline).Extrude(1.0).solids[0]
    # x, y and z of a drawing as seen from a corner
    corner = np.array([[0.87, -0.5], [0.87, 0.5], [0.0, 1.0]])
    for name, shape in shapes.items():
        axes = next(panels)
        view = corner if name in parts.PARTS else np.eye(3)[:, :2]
        lines = _MM * part_surface(Part.from_shape(shape)).lines @ view
        axes.add_collection(LineCollection(lines, colors=INK, linewidths=0.5))
        axes.set_title(name.replace("-", " "), fontsize=7.0)
        axes.set_aspect("equal")
        axes.autoscale_view()
    for axes in figure.axes:
        axes.set_axis_off()
    return figure


def moving_necks() -> "Figure":
    """The necks of the piezo stage that its frequencies and stresses hang on."""
    from flexstage.report.figures.sensitivity import draw_moving_necks
    from flexstage.stage.designs import StageTemplate
    from flexstage.studies.explore import known_figures, sensitivities
    from flexstage.studies.explore.figures import default_figures
    from flexstage.studies.explore.sensitivity import hinge_variables

    template = StageTemplate.of("vgtu-piezo")
    stage = template.stage()
    family = hinge_variables(template, ["*.neck"])
    return draw_moving_necks(stage, sensitivities(family, default_figures(known_figures(stage))))


@cache
def _followed() -> "dict[str, VerifiedStep]":
    """How the twin followed references in the plan of the study, by step."""
    from flexstage.experiments import find_plan, plan_stage, read_plan, run_plan
    from flexstage.instruments.connect import connect

    plan = read_plan(find_plan("vgtu-piezo"))
    stage = plan_stage(plan)
    with in_new_folder(), connect("twin://?seed=0", stage) as twin:
        result = run_plan(plan, twin, "run", stage=stage)
    return {step.name: step for step in cast("tuple[VerifiedStep, ...]", result.of("verify"))}


def inverse_on_twin() -> "Figure":
    """The twin with the inverse of its hysteresis."""
    from flexstage.report.figures.tracking import draw_following

    return draw_following(_followed()["inverse-preisach-x"])


def control_on_twin() -> "Figure":
    """The twin under control."""
    from flexstage.report.figures.tracking import draw_following

    return draw_following(_followed()["control-x"])


@contextmanager
def in_new_folder() -> Iterator[Path]:
    """Work in a folder that is removed afterwards."""
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            yield Path(folder)
        finally:
            os.chdir(before)


def card_sweep() -> "Figure":
    """Stress of the piezo stage in colours over two dimensions of a lever, frequency in lines."""
    import matplotlib as mpl

    from flexstage.stage.designs import StageTemplate
    from flexstage.studies.explore import Family, Figure, SweepPlan, sweep, variables_of

    figure, axes = card()
    template = StageTemplate.of("vgtu-piezo")
    ranges = ["x.lever_neck=0.35..0.75 mm", "x.lever_arm_input=8.1..12 mm"]
    family = Family(template=template, variables=variables_of(template, ranges))
    looked_at = [Figure(quantity=q, axis="x") for q in ("max_stress", "natural_frequency_hz")]
    swept = sweep(family, looked_at, SweepPlan(sampling="grid", samples=121))
    x, y = (swept.points[:, i].reshape(swept.counts) * _MM for i in range(2))
    axes.contourf(x, y, swept.on_grid(0), levels=11, cmap=mpl.colormaps["YlGnBu"], alpha=0.75)
    axes.contour(x, y, swept.on_grid(1), levels=7, colors=INK, linewidths=1.1)
    axes.plot(*(_MM * family.usual), "D", color=CYCLE[1], markersize=9, markeredgecolor="white")
    return figure


#: Every picture that is drawn here, by the name of its file in `docs/images`.
PICTURES: dict[str, Callable[[], "Figure"]] = {
    "card-stage.png": card_stage,
    "card-mode.png": card_mode,
    "card-hysteresis.png": card_hysteresis,
    "card-response.png": card_response,
    "card-centring.png": card_centring,
    "card-twin.png": card_twin,
    "card-control.png": card_control,
    "card-cut.png": card_cut,
    "card-sweep.png": card_sweep,
    "guide.png": guide,
    "vgtu-piezo.png": piezo_stage,
    "moving-necks.png": moving_necks,
    "published-stages.png": published_stages,
    "inverse-on-twin.png": inverse_on_twin,
    "control-on-twin.png": control_on_twin,
    **{f"design-{name}.png": partial(one_design, name) for name in DESIGNS},
}
#: Pictures that a page makes: the page, and the file that its Python and its commands write.
PAGES = {
    "centring.png": ("how-to/centre.md", "turn.png"),
    "frequency-response.png": ("how-to/frequency-response.md", "response.png"),
    "quiet.png": ("how-to/how-quiet.md", "quiet.png"),
    "optimised.png": ("how-to/optimise.md", "better.png"),
    "piezo-hysteresis.png": ("tutorials/piezo-hysteresis.md", "piezo-hysteresis.png"),
    "reconstructed.png": ("how-to/update-model.md", "ranges.png"),
    "sweep-map.png": ("how-to/sweep.md", "map.png"),
    "tolerance.png": ("how-to/tolerance.md", "parts.png"),
}
#: Pictures that commands make, the last of which writes the file.
COMMANDS = {
    "diagram-vgtu-piezo-x.svg": ["equations vgtu-piezo --axis x --to svg --out"],
    "found-in-drawing.png": [
        "export vgtu-piezo --to dxf --folder .",
        "import vgtu-piezo.dxf --figure",
    ],
    "part-faces.png": [
        "export parallelogram --to step --folder .",
        "part parallelogram.step --order 0 --figure",
    ],
    "sensitivity.png": ["sensitivity vgtu-piezo --quiet --figure"],
}
#: Pictures of other programs, made by hand: VTK, and the contours of the DXF with a filled part.
BY_HAND = ("mode-vgtu-piezo.png", "wire-path.png")


def flexstage(*words: str) -> None:
    """Run a command."""
    subprocess.run([sys.executable, "-m", "flexstage", *words], check=True, capture_output=True)


def from_page(name: str, folder: Path) -> Path:
    """Run the Python of a page, and the command that writes its picture; return the picture."""
    import shlex

    from tests.meta.test_docs_snippets import blocks, run
    from tests.printed_commands import commands

    page, file = PAGES[name]
    text = (Path(__file__).parent / page).read_text("utf-8")
    run(text, page)
    for block in blocks(text):
        for command in commands(block.code) if block.language == "console" else []:
            if file in command.line:
                flexstage(*shlex.split(command.line)[1:])
    return folder / file


def write(name: str) -> None:
    """Write one picture."""
    if name in PICTURES:
        content = encode(PICTURES[name](), "png")
        (IMAGES / name).write_bytes(content)
        return
    with in_new_folder() as folder:
        if name in PAGES:
            picture = from_page(name, folder)
        else:
            *before, last = COMMANDS[name]
            picture = folder / name
            for command in before:
                flexstage(*command.split())
            flexstage(*last.split(), str(picture))
        shutil.copy(picture, IMAGES / name)


def main(names: list[str]) -> None:
    """Write the pictures."""
    for name in names or [*PICTURES, *PAGES, *COMMANDS]:
        write(name)


if __name__ == "__main__":
    main(sys.argv[1:])
