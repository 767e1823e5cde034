"""The head of a VTK image file (.vti) with raw appended arrays, as ParaView reads it."""

from __future__ import annotations

from collections.abc import Sequence

#: What follows the last array.
VTI_TAIL = b"\n  </AppendedData>\n</VTKFile>\n"


def vti_head(
    shape: tuple[int, int, int], origin_mm: Sequence[float], spacing_mm: Sequence[float],
    names: Sequence[str],
) -> bytes:
    """Everything before the arrays: float32 point data, each led by its length as uint64.

    shape : (nz, ny, nx) nodes; names : of the arrays; the first is shown at first
    """
    nz, ny, nx = shape
    block = 4 * nz * ny * nx
    extent = f"0 {nx - 1} 0 {ny - 1} 0 {nz - 1}"
    origin = " ".join(f"{v:.9g}" for v in origin_mm)
    spacing = " ".join(f"{v:.9g}" for v in spacing_mm)
    arrays = "".join(
        f'        <DataArray type="Float32" Name="{name}" format="appended" '
        f'offset="{number * (8 + block)}"/>\n'
        for number, name in enumerate(names)
    )
    return (
        '<?xml version="1.0"?>\n<VTKFile type="ImageData" version="1.0" '
        'byte_order="LittleEndian" header_type="UInt64">\n'
        f'  <ImageData WholeExtent="{extent}" Origin="{origin}" Spacing="{spacing}">\n'
        f'    <Piece Extent="{extent}">\n      <PointData Scalars="{names[0]}">\n{arrays}'
        "      </PointData>\n    </Piece>\n  </ImageData>\n"
        '  <AppendedData encoding="raw">\n_'
    ).encode("ascii")
