"""Wavelet networks on samples of any kind: the mothers, the library of candidates, the network, and its fit."""
