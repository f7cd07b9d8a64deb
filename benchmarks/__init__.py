"""Speed, as ratios against named alternatives in the same run: `python -m benchmarks`."""

import os

# Matrices of some hundred rows gain nothing from threads and wait for them where cores are busy:
# one thread each, for every route alike. It has to be said before NumPy is imported.
for _name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
