"""All benchmarks, one after the other: python -m benchmarks. Public meshes are used where MORPHLET_DATA names their folder."""

import subprocess
import sys
from pathlib import Path

SCRIPTS = (
    *("first_run.py", "reading.py", "factorization.py", "point_location.py", "sphere_map.py", "sphere_torture.py"),
    *("mothers.py", "wavelet_rows.py", "wavelet_mesh.py", "correspondence.py", "confidence.py", "editing.py", "motion.py"),
    *("codec.py", "studio.py"),
)


def main() -> int:
    """Run each script in a process of its own; the worst exit code."""
    here = Path(__file__).parent
    worst = 0
    for script in SCRIPTS:
        print(f"\n# {script}", flush=True)
        worst = max(worst, subprocess.run([sys.executable, here / script], check=False).returncode)
    return worst


if __name__ == "__main__":
    sys.exit(main())
