"""What the once-per-turn harmonics of several heads say together: where the scale's centre is."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexstage.arrays import Array
from flexstage.centring.harmonic_fit import HarmonicFit
from flexstage.centring.turns import find_turns
from flexstage.centring.vector_interval import direction_estimate, length_estimate
from flexstage.estimate import Component, Estimate

#: Turns from which their scatter gives the covariance.
_MANY_TURNS = 8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Combined:
    """Eccentricity and what else the once-per-turn harmonics hold."""

    vector: Array
    """Eccentricity, in the unit of the harmonics, shape (2,)."""
    covariance: Array
    """Of it, shape (2, 2)."""
    degrees_of_freedom: float
    """Of the covariance."""
    common: Estimate | None
    """Amplitude of what all share; None where it cannot be told."""
    counter_motion: Estimate | None
    """Radius of the motion of the axis against the sense of turning; None where it cannot be told.
    """
    notes: tuple[str, ...]
    """What a reader should know."""


def combined(
    fits: Sequence[HarmonicFit], angles: Array, table: Array | None, *, radial: bool = False
) -> Combined:
    """Combine the once-per-turn harmonics of heads or indicators by weighted least squares.

    They stand at `angles` in the room [rad]. `table` is the angle of the table at each sample [rad]
    where all were sampled together: what disturbs several at once is then told from what disturbs
    one. `radial` ones are indicators that look along the radius, not heads that read angles.
    """
    # chance of heads that differ as much, below which their noise does not explain it.
    chance = 0.005
    found = [f.harmonic(1) for f in fits]
    together = table is not None and len(fits) > 1
    c = np.array([p for h in found for p in (h.cosine.value, h.sine.value)])
    v = _covariance(fits, table)
    own = _eccentric(angles, radial)
    counter = _counter(angles, radial)
    # all indicators at once move only with a rim that grows and shrinks, which none does
    common = np.tile(np.eye(2), (len(fits), 1))
    extra = {"counter": counter} if radial else {"common": common, "counter": counter}
    design, kept = _design(own, extra, v)
    weighted = _inverse(v)
    inverse = np.linalg.inv(design.T @ weighted @ design)
    estimator = inverse @ design.T @ weighted
    x, cov = estimator @ c, estimator @ v @ estimator.T
    freedom = _pooled_freedom(fits) if together else _least_freedom(fits, estimator, v)
    notes: list[str] = []
    free = c.size - x.size
    if free > 0:
        left = c - design @ x
        ratio = float(left @ weighted @ left) / free
        if _chance(ratio, free, freedom) < chance:
            cov, freedom = cov * ratio, float(free)
            notes.append(
                f"the heads differ by {math.sqrt(ratio):.1f} times what their noise explains: the "
                "uncertainty is larger by that; check their angles and that of the axis"
            )
    by_turns = all(f.noise == "turns" and f.with_all is None for f in fits)
    if table is not None and together and by_turns:
        cov, freedom = _by_turns(fits, table, estimator, cov, freedom)
    pairs = {name: x[i : i + 2] for name, i in kept.items()}
    covs = {name: cov[i : i + 2, i : i + 2] for name, i in kept.items()}
    return Combined(
        vector=x[:2],
        covariance=cov[:2, :2],
        degrees_of_freedom=freedom,
        common=_length(pairs, covs, "common", fits[0].unit, freedom),
        counter_motion=_length(pairs, covs, "counter", fits[0].unit, freedom),
        notes=tuple(notes),
    )


def _eccentric(angles: Array, radial: bool) -> Array:
    """Cosine and sine that eccentricity in x and in y gives each head, shape (2 m, 2)."""
    c, s = np.cos(angles), np.sin(angles)
    # a head sees x sin(theta + alpha) - y cos(theta + alpha), an indicator the part along it
    rows = [[c, s], [-s, c]] if radial else [[s, -c], [c, s]]
    return np.moveaxis(np.array(rows), 2, 0).reshape(-1, 2)


def _counter(angles: Array, radial: bool) -> Array:
    """The same of a motion of the axis that turns, seen from the table, twice as fast forward."""
    c, s = np.cos(angles), np.sin(angles)
    rows = [[c, s], [s, -c]] if radial else [[s, -c], [-c, -s]]
    return np.moveaxis(np.array(rows), 2, 0).reshape(-1, 2)


def _design(own: Array, extra: dict[str, Array], v: Array) -> tuple[Array, dict[str, int]]:
    """Return the functions that the heads can tell apart, and where each begins."""
    # times that a part may make the eccentricity more uncertain before it is left out.
    most_growth = 3.0
    weighted = _inverse(v)
    base = _spread(own, weighted)
    design, kept = own, {}
    for name, block in extra.items():
        wider = np.hstack((design, block))
        if wider.shape[1] > wider.shape[0] or np.linalg.cond(wider) > 1e6:
            continue
        if _spread(wider, weighted) <= most_growth * base:
            kept[name] = design.shape[1]
            design = wider
    return design, kept


def _inverse(v: Array) -> Array:
    # heads that are disturbed together make it singular
    return np.asarray(np.linalg.pinv(v, hermitian=True), dtype=np.float64)


def _spread(design: Array, weighted: Array) -> float:
    return math.sqrt(float(np.trace(np.linalg.inv(design.T @ weighted @ design)[:2, :2])))


def _covariance(fits: Sequence[HarmonicFit], table: Array | None) -> Array:
    """Return the covariance of cosine and sine of all heads, shape (2 m, 2 m)."""
    m = len(fits)
    blocks = [f.harmonic(1).covariance for f in fits]
    if table is not None and m > 1 and all(f.residual_rms > 0.0 for f in fits):
        # how noise lasts is found better from all heads: by chance one would weigh too much
        pooled = np.mean([b / f.residual_rms**2 for b, f in zip(blocks, fits, strict=True)], axis=0)
        blocks = [f.residual_rms**2 * pooled for f in fits]
    shared = np.eye(m)
    if table is not None and m > 1:
        keep = np.ones(table.size, dtype=bool)
        for f in fits:
            keep[[o.index for o in f.outliers]] = False
        whole = bool(keep.all())
        left = np.stack([f.residual if whole else f.residual[keep] for f in fits])
        size = np.sqrt(np.einsum("ij,ij->i", left, left))
        if size.min() > 0.0:
            likeness = left @ left.T / np.outer(size, size)
            count = left.shape[1]
            limit = 4.0 / math.sqrt(count)
            apart = np.abs(likeness - np.diag(np.diag(likeness)))
            # of heads with noise of their own, likeness is chance and is left out
            shared = likeness if apart.max() > limit and count > 10 * m else shared
    roots = [_root(block) for block in blocks]
    out = np.zeros((2 * m, 2 * m))
    for i in range(m):
        for j in range(m):
            out[2 * i : 2 * i + 2, 2 * j : 2 * j + 2] = shared[i, j] * roots[i] @ roots[j].T
    # exact readings have no noise, and all weigh the same
    scale = float(np.trace(out)) / (2 * m)
    return out + (1e-9 * scale or np.finfo(float).tiny ** 0.5) * np.eye(2 * m)


def _pooled_freedom(fits: Sequence[HarmonicFit]) -> float:
    """Degrees of freedom of the mean of the relative variances of all heads."""
    found = [f.harmonic(1) for f in fits]
    relative = [
        float(np.trace(h.covariance)) / (f.residual_rms**2 or 1.0)
        for h, f in zip(found, fits, strict=True)
    ]
    return _satterthwaite(relative, [h.cosine.degrees_of_freedom for h in found])


def _least_freedom(fits: Sequence[HarmonicFit], estimator: Array, v: Array) -> float:
    """Degrees of freedom of what is combined, from the share that each head has in it."""
    shares = []
    for i in range(0, v.shape[0], 2):
        part = estimator[:2, i : i + 2]
        shares.append(float(np.trace(part @ v[i : i + 2, i : i + 2] @ part.T)))
    return _satterthwaite(shares, [f.harmonic(1).cosine.degrees_of_freedom for f in fits])


def _satterthwaite(variances: Sequence[float], freedoms: Sequence[float]) -> float:
    total = sum(variances)
    if total == 0.0:
        return min(freedoms)
    inverse = sum((s / total) ** 2 / n for s, n in zip(variances, freedoms, strict=True))
    # exact readings have no noise to know
    return 1.0 / inverse if inverse > 0.0 else math.inf


def _root(block: Array) -> Array:
    values, vectors = np.linalg.eigh(block)
    return vectors @ np.diag(np.sqrt(np.maximum(values, 0.0))) @ vectors.T


def _by_turns(
    fits: Sequence[HarmonicFit], table: Array, estimator: Array, cov: Array, freedom: float
) -> tuple[Array, float]:
    """Return the covariance that the scatter of single turns gives what is combined from heads."""
    turns = find_turns(table)
    starts = np.array(turns.bounds[:-1])
    if starts.size < _MANY_TURNS:
        return cov, freedom
    waves = (np.cos(turns.angle), np.sin(turns.angle))
    parts = np.empty((starts.size, 2 * len(fits)))
    for j, f in enumerate(fits):
        left = f.residual.copy()
        left[[o.index for o in f.outliers]] = 0.0
        for i, wave in enumerate(waves):
            parts[:, 2 * j + i] = 2.0 / left.size * np.add.reduceat(left * wave, starts)
    pulls = parts @ estimator.T
    count = starts.size
    scatter = pulls.T @ pulls * count / (count - 1)
    grown = np.ones(cov.shape[0])
    for i in range(0, cov.shape[0], 2):
        own = np.trace(cov[i : i + 2, i : i + 2])
        grown[i : i + 2] = math.sqrt(np.trace(scatter[i : i + 2, i : i + 2]) / own)
    return cov * np.outer(grown, grown), 2.0 * (count - 1.0)


def _chance(ratio: float, free: int, freedom: float) -> float:
    from scipy.special import chdtrc, fdtrc

    if not math.isfinite(freedom):
        return float(chdtrc(free, ratio * free))
    return float(fdtrc(free, max(freedom, 1.0), ratio))


def _length(
    pairs: dict[str, Array], covs: dict[str, Array], name: str, unit: str, freedom: float
) -> Estimate | None:
    if name not in pairs:
        return None
    return length_estimate(pairs[name], covs[name], unit, degrees_of_freedom=freedom)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Eccentricity:
    """Where the centre of a scale is, in the frame that turns with the table."""

    x: Estimate
    """Its coordinate x [m]."""
    y: Estimate
    """Its coordinate y [m]."""
    amplitude: Estimate
    """Its distance from the axis [m]."""
    phase: Estimate
    """Its direction, from x towards y [rad]."""
    covariance: Array
    """Of x and y [m^2], shape (2, 2)."""
    radius: float
    """Radius at which the scale is read [m]."""
    common: Estimate | None
    """Amplitude of the once-per-turn error that all heads share, as of the reference [rad]; None
    where the heads cannot tell it from eccentricity.
    """
    counter_motion: Estimate | None
    """Radius of the once-per-turn motion of the axis against the sense of turning [m]; None where
    the heads cannot tell.
    """
    fits: tuple[HarmonicFit, ...]
    """Of each head, less what exact geometry adds to the first order."""
    notes: tuple[str, ...]
    """What a reader should know."""

    @property
    def vector(self) -> Array:
        """Coordinates x and y [m], shape (2,)."""
        return np.array([self.x.value, self.y.value])


def centre_from(
    found: Combined,
    fits: Sequence[HarmonicFit],
    radius: float,
    given: tuple[float, float, float],
    *,
    radial: bool = False,
) -> Eccentricity:
    """Return the eccentricity that once-per-turn harmonics stand for.

    It is read at `radius` [m]. `given` are standard uncertainties: of the scale's once-per-turn
    error [rad], or of the rim's [m], of the radius [m], and of the angle of the heads [rad].
    Harmonics of indicators are `radial`, displacements [m] and not angles.
    """
    graduation, own_radius, turned = given
    factor = 1.0 if radial else radius
    v = factor * found.vector
    noise = factor**2 * found.covariance
    grid = factor * graduation
    length = math.hypot(v[0], v[1])
    # the run-out of a rim is the eccentricity, whatever its radius
    scale = 0.0 if radial else own_radius / radius

    def with_others(plain: Estimate, along: float, across: float, own: float) -> Estimate:
        others = (
            Component(name="graduation", uncertainty=own, kind="B"),
            Component(name="radius", uncertainty=abs(along), kind="B"),
            Component(name="head angle", uncertainty=abs(across), kind="B"),
        )
        return plain.plus(*(c for c in others if c.uncertainty > 0.0))

    parts = []
    for i in (0, 1):
        own = math.sqrt(noise[i, i])
        plain = Estimate.of(float(v[i]), own, "m", degrees_of_freedom=found.degrees_of_freedom)
        parts.append(with_others(plain, scale * v[i], turned * v[1 - i], grid))
    freedom = found.degrees_of_freedom
    amplitude = length_estimate(v, noise, "m", degrees_of_freedom=freedom)
    phase = direction_estimate(v, noise, degrees_of_freedom=freedom)
    swing = min(math.pi, grid / length) if length > 0.0 else 0.0
    across = np.array([-v[1], v[0]])
    return Eccentricity(
        x=parts[0],
        y=parts[1],
        amplitude=with_others(amplitude, scale * length, 0.0, grid),
        phase=with_others(phase, 0.0, turned, swing),
        covariance=noise
        + (grid) ** 2 * np.eye(2)
        + scale**2 * np.outer(v, v)
        + turned**2 * np.outer(across, across),
        radius=radius,
        common=found.common,
        counter_motion=None
        if found.counter_motion is None
        else replace(found.counter_motion.times(factor), unit="m"),
        fits=tuple(fits),
        notes=_notes(found, graduation, len(fits), radial),
    )


def _notes(found: Combined, graduation: float, heads: int, radial: bool) -> tuple[str, ...]:
    notes = list(found.notes)
    if radial:
        if found.counter_motion is None:
            notes.append(
                "a once-per-turn motion of the axis counts as eccentricity, with "
                + ("one indicator" if heads == 1 else "indicators at these angles")
            )
        return tuple(notes)
    if graduation == 0.0:
        notes.append(
            "a once-per-turn error of the scale's own graduation counts as eccentricity: heads "
            "cannot tell them apart"
        )
    if found.common is None:
        also = "one head" if heads == 1 else "heads at these angles"
        notes.append(f"a once-per-turn error of the reference counts as eccentricity, with {also}")
    return tuple(notes)
