"""viser as a peer of the studio: shows a mesh and moves its vertices at each line that comes in. Run by `studio_page.py`.

A process of its own, since viser pins libraries that morphlet does not. Nothing is solved here: positions are made ready
before, so that only the way to the page is measured. The first coordinate tells the page which positions it has got.

    python benchmarks/studio_viser.py mesh.npz
"""

import sys

import numpy as np

WAYS = 16
"""Different positions, one after the other and again."""


def main() -> None:
    """Show the mesh; at a line with a number, move it."""
    import viser

    mesh = np.load(sys.argv[1])
    vertices, faces = mesh["vertices"], mesh["faces"]
    server = viser.ViserServer(host="127.0.0.1", verbose=False)
    shown = server.scene.add_mesh_simple("/mesh", vertices.astype(np.float32), faces.astype(np.uint32))
    bent = [vertices + 0.05 * np.sin(2 * np.pi * way / WAYS) * np.sin(vertices[:, [2, 0, 1]]) for way in range(WAYS)]
    bent = [positions.astype(np.float32) for positions in bent]
    print("peer", server.get_port(), viser.__version__, flush=True)  # viser prints by itself, too
    for line in sys.stdin:
        number = int(line)
        positions = bent[number % WAYS].copy()
        positions[0, 0] = number
        shown.vertices = positions
        server.flush()


if __name__ == "__main__":
    main()
