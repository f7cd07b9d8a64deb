"""Layout of the diagram of an axis on a page by one fixed template.

An axis has one mass, or two with a transmission below the drive. Blocks of a row are placed in
series; each line between rows is defined by its turns.
"""

from dataclasses import dataclass
from itertools import pairwise

from flexstage.base.errors import ModelError
from flexstage.export.diagram.graph import BlockGroup, Diagram
from flexstage.export.diagram.symbols import SMALL, PlacedBlock, Point, block_cell, plain
from flexstage.export.svg import text_width

Segment = tuple[Point, Point]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedLabel:
    """Name of a signal on the page."""

    text: str
    """Name."""
    x: float
    """Beginning, or end [px]."""
    y: float
    """Base line [px]."""
    end: bool = False
    """`x` is its end."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """A group on the page."""

    group: BlockGroup
    """The group."""
    x: float
    """Left edge [px]."""
    y: float
    """Top [px]."""
    right: float
    """Right edge [px]."""
    bottom: float
    """Bottom [px]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PageLayout:
    """A diagram on a page."""

    width: float
    """Width [px]."""
    height: float
    """Height [px]."""
    frames: tuple[Frame, ...]
    """The groups."""
    blocks: tuple[PlacedBlock, ...]
    """The blocks."""
    wires: dict[str, tuple[Segment, ...]]
    """Horizontal and vertical segments of the line from each block."""
    labels: tuple[PlacedLabel, ...]
    """Names of signals."""


@dataclass(frozen=True, slots=True)
class _Template:
    """Sizes of the template [px]."""

    head: float = 56.0
    """Top of a frame to the blocks of its first row."""
    row: float = 78.0
    """Distance of rows of blocks."""
    gap: float = 24.0
    """Gap between blocks of a row."""
    branch: float = 44.0
    """Gap between blocks of a row at a branch."""
    apart: float = 9.0
    """Distance of parallel lines."""
    clearance: float = 14.0
    """Distance of a line from a frame."""
    entry: float = 46.0
    """Space at the left of a group for the names of incoming signals."""
    exit: float = 66.0
    """Space at the right of a group for the names of outgoing signals."""
    below: float = 30.0
    """Distance of an incoming line below its row."""
    turn: float = 12.0
    """Distance of its upward turn before a sum."""
    between: float = 44.0
    """Distance of frames, with space for a line."""
    left: float = 55.0
    """Left edge of the first column, with space for feedback lines."""
    second: float = 278.0
    """Top of the second row, below an input with damper and spring."""


_AT = _Template()

_DRIVE = ("command", "amplifier", "hysteresis", "scale", "gain", "creep", "compression", "spring",
          "force")  # fmt: skip


def layout(diagram: Diagram) -> PageLayout:
    """Return the layout of the diagram of an axis on a page.

    Examples
    --------
    >>> from flexstage.stage.designs import design
    >>> from flexstage.export.diagram.stage_diagram import stage_diagram
    >>> page = layout(stage_diagram(design("parallelogram"), axis="x"))
    >>> len(page.frames), len(page.blocks)
    (3, 11)
    """
    page = _Page(diagram)
    if "output_motion" in page.blocks:
        page.two_masses()
    elif "input_motion" in page.blocks:
        page.one_mass()
    if len(page.placed) != len(page.blocks):
        raise ModelError("only the diagram of a single axis can be drawn")
    return page.done()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Mass:
    """Connections of a mass on the page."""

    frame: Frame
    axis: float
    """Line of its blocks, the height of the outgoing motion."""
    rate_x: float
    """Position of the branch of the rate."""
    rate_y: float
    """Height of the outgoing rate."""


class _Page:
    """A page under construction."""

    def __init__(self, diagram: Diagram) -> None:
        self.blocks = {b.name: b for b in diagram.blocks}
        self.groups = {g.name: g for g in diagram.groups}
        self.lines = {(x.source, x.target): x for x in diagram.lines}
        self.placed: dict[str, PlacedBlock] = {}
        self.wires: dict[str, list[Segment]] = {}
        self.labels: list[PlacedLabel] = []
        self.frames: list[Frame] = []

    def done(self) -> PageLayout:
        """Return the page in the size of its content."""
        points = [p for segments in self.wires.values() for segment in segments for p in segment]
        points += [(f.right, f.bottom) for f in self.frames]
        return PageLayout(
            width=max(x for x, _ in points) + _AT.clearance,
            height=max(y for _, y in points) + _AT.clearance,
            frames=tuple(self.frames),
            blocks=tuple(self.placed.values()),
            wires={name: tuple(segments) for name, segments in self.wires.items()},
            labels=tuple(self.labels),
        )

    # elements of pages

    def put(self, name: str, x: float, axis: float, *, flipped: bool = False) -> PlacedBlock:
        """Place a block at its left edge, or a flipped one at its right edge."""
        cell = block_cell(self.blocks[name], flipped=flipped)
        left = x - cell.width if flipped else x
        placed = PlacedBlock(block=self.blocks[name], x=left, y=axis - cell.axis, cell=cell)
        self.placed[name] = placed
        return placed

    def row(self, group: str, names: tuple[str, ...], x: float, axis: float) -> PlacedBlock:
        """Place the existing blocks of a group in series; return the last."""
        present = [f"{group}_{n}" for n in names if f"{group}_{n}" in self.blocks]
        last = self.put(present[0], x, axis)
        for source, target in pairwise(present):
            signal = self.lines[source, target].signal.partition(" [")[0]
            if signal:
                self.labels.append(PlacedLabel(text=signal, x=last.right + 3.0, y=axis - 5.0))
            room = _AT.branch if self.branches(source) else _AT.gap
            last = self.put(
                target, last.right + max(room, text_width(plain(signal), SMALL) + 10.0), axis
            )
            self.lead(source, target)
        return last

    def branches(self, source: str) -> bool:
        """Return whether a block has more than one outgoing line."""
        return sum(s == source for s, _ in self.lines) > 1

    def lead(self, source: str, target: str, *turns: float) -> None:
        """Route the line between two blocks, if there is one.

        It turns at x, y, x and so on [px]; the last turn is at an x.
        """
        if (source, target) not in self.lines:
            return
        points = [self.placed[source].pin("out")]
        for k, at in enumerate(turns):
            x, y = points[-1]
            points.append((x, at) if k % 2 else (at, y))
        end = self.placed[target].pin(f"in{self.lines[source, target].port}")
        points += [(points[-1][0], end[1]), end]
        self.wires.setdefault(source, []).extend(
            (min(a, b), max(a, b)) for a, b in pairwise(points) if a != b
        )

    def frame(self, group: str, x: float, y: float, right: float, bottom: float) -> Frame:
        """Add the frame of a group."""
        frame = Frame(group=self.groups[group], x=x, y=y, right=right, bottom=bottom)
        self.frames.append(frame)
        return frame

    def entry(self, frame: Frame, source: str, target: str, y: float | None = None) -> None:
        """Add the name of an incoming signal of a group, at the height of its target."""
        if (source, target) in self.lines:
            line = self.lines[source, target]
            at = self.placed[target].pin(f"in{line.port}")[1] if y is None else y
            name = line.signal.partition(" [")[0]
            self.labels.append(PlacedLabel(text=name, x=frame.x + 5.0, y=at - 5.0))

    def exit(self, frame: Frame, source: str, target: str, y: float | None = None) -> None:
        """Add the name and unit of an outgoing signal of a group."""
        if (source, target) in self.lines:
            at = self.placed[source].pin("out")[1] if y is None else y
            signal = self.lines[source, target].signal
            self.labels.append(PlacedLabel(text=signal, x=frame.right - 5.0, y=at - 5.0, end=True))

    # groups

    def drive(self, x: float, top: float) -> Frame:
        """Place the drive: its chain, and its spring with a damper below."""
        axis = top + _AT.head
        last = self.row("drive", _DRIVE, x + _AT.entry, axis)
        bottom = axis + _AT.below + 2.0 * _AT.turn
        if "drive_damper" in self.blocks:
            self.put("drive_damper", self.placed["drive_spring"].x, axis + _AT.row)
            self.lead("drive_damper", "drive_force", last.x - _AT.turn)
            bottom = axis + _AT.row + _AT.below
        return self.frame("drive", x, top, last.right + _AT.exit, bottom)

    def mass(self, name: str, x: float, level: float, *, rate_below: bool) -> _Mass:
        """Place a mass with its first force at a level, and feedbacks below it."""
        cell = block_cell(self.blocks[f"{name}_forces"])
        axis = level + cell.axis - cell.pins["in0"].y
        motion = self.row(name, ("forces", "inverse_mass", "rate", "motion"), x + 60.0, axis)
        total, rate = self.placed[f"{name}_forces"], self.placed[f"{name}_rate"]
        rate_x, motion_x = rate.right + 0.5 * _AT.branch, motion.right + 0.5 * _AT.branch
        y = bottom = axis + max(0.5 * cell.height + 24.0, 58.0)
        outer = _AT.turn + _AT.apart
        backs = ((rate, "damper", rate_x, _AT.turn), (motion, "spring", motion_x, outer))
        for source, back, branch, left in backs:
            block = f"{name}_{back}"
            if block in self.blocks:
                self.put(block, branch - _AT.clearance, y, flipped=True)
                self.lead(source.block.name, block, branch)
                self.lead(block, f"{name}_forces", total.x - left)
                bottom, y = y + _AT.below, y + 48.0
        frame = self.frame(name, x, level - _AT.head, motion_x + _AT.exit, bottom)
        rate_y = axis + _AT.below if rate_below else axis - 34.0
        return _Mass(frame=frame, axis=axis, rate_x=rate_x, rate_y=rate_y)

    def transmission(self, x: float, top: float) -> Frame:
        """Place lever, spring and damper between two masses: returned force above, rates below."""
        axis = top + _AT.head + 52.0
        group = "transmission"
        names = ("motion_ratio", "deformation", "spring", "force")
        last = self.row(group, names, x + _AT.entry, axis)
        bottom = axis + _AT.below + _AT.clearance
        if "transmission_rate" in self.blocks:
            self.row(group, ("rate_ratio", "rate", "damper"), x + _AT.entry, axis + _AT.row)
            self.lead("transmission_damper", "transmission_force", last.x - _AT.turn)
            bottom += _AT.row
        back = self.put("transmission_back", last.right + _AT.gap + _AT.clearance, top + _AT.head)
        self.lead(last.block.name, "transmission_back", last.right + _AT.clearance)
        return self.frame(group, x, top, back.right + _AT.exit, bottom)

    def probe(self, x: float, axis: float) -> Frame:
        """Place the probe."""
        last = self.row("probe", ("ratio", "sensor", "reading"), x + _AT.entry, axis)
        return self.frame("probe", x, axis - _AT.head, last.right + _AT.clearance, axis + 52.0)

    # pages

    def one_mass(self) -> None:
        """Place drive, mass and probe in a row."""
        drive = self.drive(_AT.left, 0.0)
        head = self.mass("input", drive.right + _AT.between, _AT.head, rate_below=False)
        self.force(drive, head)
        self.to_drive(drive, head, max(drive.bottom, head.frame.bottom) + _AT.clearance)
        self.to_probe("input_motion", head)

    def two_masses(self) -> None:
        """Place drive and input above, transmission, output and probe below."""
        drive = self.drive(_AT.left, 0.0)
        lever = self.transmission(_AT.left, _AT.second)
        x = max(drive.right, lever.right) + _AT.between
        head = self.mass("input", x, _AT.head, rate_below=False)
        self.force(drive, head)
        self.to_drive(drive, head, _AT.second - _AT.between + _AT.clearance)
        level = self.placed["transmission_motion_ratio"].pin("in0")[1]
        tail = self.mass("output", x, level, rate_below=True)
        self.to_probe("output_motion", tail)
        # forces of the transmission
        force = self.feeding("output_forces")
        self.lead(force, "output_forces")
        self.exit(lever, force, "output_forces")
        self.entry(tail.frame, force, "output_forces")
        self.lead("transmission_back", "input_forces", x - 0.5 * _AT.between)
        self.exit(lever, "transmission_back", "input_forces")
        self.entry(head.frame, "transmission_back", "input_forces")
        # motions and rates that deform it, those of the output from below
        y = max(lever.bottom, tail.frame.bottom) + _AT.clearance
        right, left = tail.frame.right + _AT.clearance, _AT.left - _AT.clearance
        for kind, at, low, to, track in (
            ("rate", right, y, "rate", left),
            ("motion", right + _AT.apart, y + _AT.apart, "deformation", left - _AT.apart),
        ):
            source, target = f"output_{kind}", f"transmission_{to}"
            if (source, target) in self.lines:
                sum_ = self.placed[target]
                enters = sum_.pin("out")[1] + _AT.below
                self.lead(
                    source, target, *self.exit_turns(tail, kind), at, low, track, enters,
                    sum_.x - _AT.turn,
                )  # fmt: skip
                self.exit(tail.frame, source, target, self.exit_height(tail, kind))
                self.entry(lever, source, target, enters)
        for kind, to in (("motion", "motion_ratio"), ("rate", "rate_ratio")):
            self.entry(lever, f"input_{kind}", f"transmission_{to}")

    # lines between groups

    def feeding(self, target: str) -> str:
        """Return the source of the first input of a block."""
        return next(s for (s, t), x in self.lines.items() if t == target and x.port == 0)

    def exit_height(self, mass: _Mass, kind: str) -> float:
        """Return the height of the outgoing motion or rate of a mass."""
        return mass.axis if kind == "motion" else mass.rate_y

    def exit_turns(self, mass: _Mass, kind: str) -> tuple[float, ...]:
        """Return the turns inside a mass: a rate leaves above or below the blocks."""
        return () if kind == "motion" else (mass.rate_x, mass.rate_y)

    def force(self, drive: Frame, head: _Mass) -> None:
        """Route the force of the drive to the input."""
        source = self.feeding("input_forces")
        self.lead(source, "input_forces")
        self.exit(drive, source, "input_forces")
        self.entry(head.frame, source, "input_forces")

    def to_drive(self, drive: Frame, head: _Mass, y: float) -> None:
        """Route motion and rate of the input back to the drive and to the transmission."""
        right, left = head.frame.right + _AT.clearance, _AT.clearance
        for kind, at, low, to, track in (
            ("motion", right, y, "compression", left),
            ("rate", right + _AT.apart, y + _AT.apart, "damper", left + _AT.apart),
        ):
            way = (*self.exit_turns(head, kind), at, low, track)
            source, target = f"input_{kind}", f"drive_{to}"
            if kind == "motion" and (source, target) in self.lines:
                sum_ = self.placed[target]
                enters = sum_.pin("out")[1] + _AT.below + _AT.turn
                self.lead(source, target, *way, enters, sum_.x - _AT.turn)
                self.entry(drive, source, target, enters)
            else:
                self.lead(source, target, *way)
                self.entry(drive, source, target)
            self.lead(source, f"transmission_{kind}_ratio", *way)
            outside = [t for s, t in self.lines if s == source and not t.startswith("input_")]
            if outside:
                self.exit(head.frame, source, outside[0], self.exit_height(head, kind))

    def to_probe(self, source: str, mass: _Mass) -> None:
        """Route the motion of a mass straight to the probe."""
        frame = self.probe(mass.frame.right + _AT.between, mass.axis)
        target = next(t for s, t in self.lines if s == source and t.startswith("probe_"))
        self.lead(source, target)
        self.entry(frame, source, target)
