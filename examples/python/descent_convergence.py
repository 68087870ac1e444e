"""The five descent algorithms compared with a Jacobian method: the picture of docs/ik.md.

Writes a PNG into the folder that is named, or a temporary one. Needs matplotlib (`pip install '.[plot]'`).
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import redundancy as rd
from redundancy import plot

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp(prefix="redundancy-"))
folder.mkdir(parents=True, exist_ok=True)

# The arm of the paper's experiments without joint limits, random targets, random starts, no restarts.
chain = rd.catalog.load("puma560").with_limits(lower=-np.inf, upper=np.inf)
targets, starts = np.random.default_rng(0).uniform(-np.pi, np.pi, (2, 100, 6))
traces = plot.convergence_traces(chain, chain.forward(targets), starts, iterations=300)
for name, runs in traces.items():
    error = np.array([max(run.position_error[-1], run.orientation_error[-1]) for run in runs])
    rough, fine = 100 * (error < 1e-3).mean(), 100 * (error <= 1e-6).mean()
    print(f"{name:22} after 300 iterations within 1e-3: {rough:3.0f} %, within 1e-6: {fine:3.0f} %")

plot.convergence(traces).savefig(folder / "descent_convergence.png", dpi=100)
print("picture in", folder)
