"""What is set aside leaves no trace: the fit is that of the samples that were kept."""

import numpy as np
import pytest

from flexstage.centring import fit_harmonics

COUNT = 3600


# a few are left out at once, many by weights that are lowered step by step
@pytest.mark.parametrize("many", [3, 60, 400])
@pytest.mark.parametrize("weighed", [False, True])
def test_the_fit_is_that_of_the_samples_kept(many: int, weighed: bool) -> None:
    rng = np.random.default_rng(4)
    theta = 0.3 + np.arange(COUNT) * 2.0 * np.pi / 720
    y = 1e-3 * np.sin(theta - 0.7) + 2e-5 * np.cos(3.0 * theta) + rng.normal(0.0, 5e-6, COUNT)
    wrong = rng.choice(COUNT, many, replace=False)
    y[wrong] += 3e-4
    u = rng.uniform(0.5, 1.5, COUNT) if weighed else None
    found = fit_harmonics(theta, y, orders=5, uncertainty=u)
    outliers = {o.index for o in found.outliers}
    assert outliers >= set(wrong.tolist())
    kept = np.setdiff1d(np.arange(COUNT), list(outliers))
    plain = fit_harmonics(
        theta[kept], y[kept], orders=5, uncertainty=None if u is None else u[kept], robust=False
    )
    assert found.samples == kept.size
    assert found.residual_rms == pytest.approx(plain.residual_rms, rel=1e-9)
    for own, other in zip(found.harmonics, plain.harmonics, strict=True):
        assert own.cosine.value == pytest.approx(other.cosine.value, abs=1e-14)
        assert own.sine.value == pytest.approx(other.sine.value, abs=1e-14)
    np.testing.assert_allclose(found.residual[kept], plain.residual, atol=1e-14)
