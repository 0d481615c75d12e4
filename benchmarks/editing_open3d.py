"""Open3D's as-rigid-as-possible deformation, in an interpreter that has Open3D and nothing of the package: EDIT.npz in, ANSWER.npz out.

Open3D factors anew in every call, so that an iteration is what calls of 1 and of more iterations differ by, and the set-up what is left.
"""

import sys
import time
from pathlib import Path

import numpy as np
import open3d as o3d


def spent(call):
    """What the call returns, its wall and its CPU seconds."""
    wall, cpu = time.perf_counter(), time.process_time()
    found = call()
    return found, np.array([time.perf_counter() - wall, time.process_time() - cpu])


def main(edit: Path, answer: Path) -> None:
    """One edit, by one of the two energies."""
    o3d.utility.set_verbosity_level(o3d.utility.VerbosityLevel.Error)
    given = np.load(edit)
    energies = o3d.geometry.DeformAsRigidAsPossibleEnergy
    energy = energies.Smoothed if str(given["energy"]) == "smoothed" else energies.Spokes
    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(given["vertices"]), o3d.utility.Vector3iVector(given["faces"].astype(np.int32))
    )
    held, places = o3d.utility.IntVector(given["held"].astype(np.int32)), o3d.utility.Vector3dVector(given["places"])

    def after(count: int) -> np.ndarray:
        found = mesh.deform_as_rigid_as_possible(held, places, max_iter=count, energy=energy)
        return np.asarray(found.vertices).copy()

    positions = [after(int(count)) for count in given["counts"]]
    more, first = int(given["timed"]), np.zeros(2)
    iteration = first
    if more:
        after(1)
        _, first = spent(lambda: after(1))
        _, longer = spent(lambda: after(1 + more))
        iteration = (longer - first) / more
    np.savez(answer, positions=np.reshape(positions, (-1, *given["vertices"].shape)), setup=first - iteration, iteration=iteration)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
