"""What of a layer counts as not as planned: two in a hundred, and more powder than a tick feeds."""

from __future__ import annotations

from lmctl.report.layer_record import deviating_figures
from lmctl.run.journal.figures import ExecutionFigures


def marked(found_g, wanted_g=0.05, found_mm=20.0):
    planned = ExecutionFigures(20.0, 2.0, 800.0, 20.0, {"A": wanted_g})
    return deviating_figures(planned, ExecutionFigures(found_mm, 2.0, 800.0, 20.0, {"A": found_g}))


def test_a_tick_of_powder_at_the_end_of_a_layer_is_no_deviation():
    """Powder stops for a wait just as a layer of two seconds ends."""
    assert marked(0.023) == ()
    assert marked(0.12) == ("A",)


def test_powder_that_is_missing_is_a_deviation():
    assert marked(0.0, wanted_g=0.36) == ("A",)
    assert marked(4.80, wanted_g=5.0) == ("A",)
    assert marked(4.95, wanted_g=5.0) == ()


def test_the_path_has_no_such_tolerance():
    assert marked(0.05, found_mm=19.0) == ("path_mm",)
