"""Signed distance on grids: kernels are array functions that know no tree and no material."""
