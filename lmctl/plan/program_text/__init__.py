"""The text stage: the timed lines of one layer become the bytes of a job.

A pure function of the layer, so layers run in parallel."""

from lmctl.plan.program_text.layer_text import LayerLines, packed_layer

__all__ = ["LayerLines", "packed_layer"]
