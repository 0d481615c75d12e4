"""A mesh, or a field on it, as wavelet networks: block by block over its geometry image, or whole over its sphere."""
