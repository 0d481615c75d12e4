"""Many meshes: a verb over each of them, or the map between every two, on one machine or on a cluster.

`manifest` holds what became of each item, `limits` what an item may take, `server` the process that does one item after another, `items`
one item from start to end, `runner` all of them, `all_pairs` distances between meshes, `picture` the meshes as points in the plane.
"""
