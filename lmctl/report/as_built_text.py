"""An as-built comparison as text for a terminal."""

from __future__ import annotations

from collections.abc import Iterator

from lmctl.as_built.figures import TOLERANCES, AsBuiltSummary, CompositionError

#: Rows of the table of layers; more layers are shown in even steps.
_MOST_LAYERS = 12
#: What the figures are, by how they came about.
BUILT_BY = {
    "simulated": "as built by the simulated process",
    "predicted": "predicted by the model that the profile names, not measured",
}


def as_built_as_text(title: str, found: AsBuiltSummary) -> str:
    """The figures in a few tables. title : of the run and its part"""
    return "\n".join([f"{title}: {BUILT_BY[found.built_by]}", *_volume(found),
                      *_composition(found), *_layers(found), *_powder(found),
                      *(f"note: {note}" for note in found.notes)])


def _volume(found: AsBuiltSummary) -> Iterator[str]:
    yield (f"  volume    {found.built_mm3:,.0f} of {found.design_mm3:,.0f} mm³ designed "
           f"({found.built_over_design:.1%}): {found.missing_mm3:,.0f} missing, "
           f"{found.surplus_mm3:,.0f} beside it")
    if found.core_void is not None:
        yield (f"  core      {found.core_void:.2%} void in the {found.core_mm3:,.0f} mm³ deeper "
               "than a bead")
    if found.height_mm is not None and found.planned_height_mm:
        off = found.height_mm / found.planned_height_mm - 1
        yield (f"  height    {found.height_mm:.2f} of {found.planned_height_mm:.2f} mm over the "
               f"core ({off:+.1%})")


def _composition(found: AsBuiltSummary) -> Iterator[str]:
    tolerances = "".join(f"{f'±{t:g}':>9}" for t in TOLERANCES)
    yield f"\n  composition error     mean      RMS     95 %     99 %   within{tolerances}"
    for name, error in (("by volume", found.by_volume), ("by path", found.by_path)):
        if error is None:
            yield f"    {name:<15}  nothing to compare"
        else:
            yield f"    {name:<15}{_figures(error)}"


def _figures(error: CompositionError) -> str:
    values = "".join(f"{v:9.4f}" for v in (error.mean, error.rms, error.p95, error.p99))
    return values + " " * 9 + "".join(f"{error.within[t]:9.1%}" for t in TOLERANCES)


def _layers(found: AsBuiltSummary) -> Iterator[str]:
    known = [layer for layer in found.layers if layer.built_mm is not None]
    if not known:
        return
    step = -(-len(known) // _MOST_LAYERS)
    yield "\n  layer   planned     built       off   [mm above the plate]"
    for layer in [*known[:-1:step], known[-1]]:
        assert layer.built_mm is not None
        yield (f"  {layer.number:>5}{layer.planned_mm:10.2f}{layer.built_mm:10.2f}"
               f"{layer.built_mm - layer.planned_mm:+10.2f}")


def _powder(found: AsBuiltSummary) -> Iterator[str]:
    if not found.balance:
        return
    yield "\n  powder [g]           fed   in part  overspray  beam off  unaccounted"
    for one in found.balance:
        yield (f"    {one.material[:14]:<14}{one.fed_g:10.1f}{one.deposited_g:10.1f}"
               f"{one.overspray_g:11.1f}{one.beam_off_g:10.1f}{one.unaccounted_g:9.1f} "
               f"({one.closure:+.2%})")
