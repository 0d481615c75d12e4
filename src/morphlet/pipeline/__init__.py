"""The paper on one page: two meshes in, a correspondence out, and the morph along it.

1. Map both meshes to the sphere, one to one (step 1; the maps may be made beforehand and passed in).
2. Grow feature regions on both and match them (steps 2 and 10), unless enough vertices were paired by hand. Where several matchings are
   nearly as good, coarse maps decide.
3. Turn the source's sphere so that paired vertices come near each other (section 6.2, Eq. 7), and let a wavelet network move
   them further, smoothly (section 6.2).
4. Lay the source into the target's sphere from there, coarse to fine, pairs onto each other, without folds.
5. Compose: up from the source, down to the target; move the source's vertices to their images (section 7.2), on straight lines,
   with each resolution at its own time, or so that faces turn and stretch.

`candidates` decides which regions go together, `correspond` makes the map, `results` measures it, `morph` moves along it; `placed` takes
markers anywhere on the faces, `several` brings many meshes to one sphere.
"""
