"""fTetWild as a program of its own: `tetwild_child.py INPUT.npz OUTPUT.npz`.

It is run by path, in a fresh interpreter, and imports nothing of this project: fTetWild may crash its process, and
it holds the interpreter's lock and replaces the interrupt handler for as long as it runs.
"""

from __future__ import annotations

import ctypes
import signal
import sys
from contextlib import suppress
from pathlib import Path


def main(source: Path, target: Path) -> None:
    """Read points, faces and parameters from `source`, write the points and tetrahedra to `target`."""
    _die_with_parent()
    _die_first()
    # Loading takes a second, in which a parent may be killed; it has to be followed from the start.
    import numpy as np  # noqa: PLC0415
    from pytetwild.pytetwild import tetrahedralize  # noqa: PLC0415

    with np.load(source, allow_pickle=False) as given:
        points, tets = tetrahedralize(
            np.ascontiguousarray(given["points"], dtype=np.float64),
            np.ascontiguousarray(given["faces"], dtype=np.int32),
            edge_length_abs=float(given["edge"]),
            epsilon=float(given["epsilon"]),
            stop_energy=float(given["stop_energy"]),
            num_opt_iter=int(given["iterations"]),
            num_threads=int(given["threads"]),
            vtk_ordering=True,  # positive orientation
            quiet=True,
        )
    partial = target.with_name(f"partial-{target.name}")
    np.savez(partial, points=points, tets=tets)
    partial.replace(target)


def _die_with_parent() -> None:
    # On Linux the kernel ends this process when its parent is killed without a chance to clean up.
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)


def _die_first() -> None:
    # Where memory runs out, Linux ends this process and none that may be printing.
    with suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("1000", encoding="ascii")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
