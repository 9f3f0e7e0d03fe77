"""One thread of linear algebra a worker: the workers already take every core.

Arrays here are small. With a thread a core each, the workers wait for one another, which costs a
third more processor time. Set before numpy is first imported; what is set already stays.
"""

from __future__ import annotations

import os

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
